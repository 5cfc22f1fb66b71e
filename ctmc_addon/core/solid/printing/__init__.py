# SPDX-License-Identifier: GPL-3.0-or-later
"""Facts about parts for a print lab."""
