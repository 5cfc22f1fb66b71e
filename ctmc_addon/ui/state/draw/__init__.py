# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep drawn structures."""
