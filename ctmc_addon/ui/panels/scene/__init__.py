# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the panels of objects other than surfaces."""
