# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the page Results."""
