# SPDX-License-Identifier: GPL-3.0-or-later
"""Change, measure and export finished surfaces."""
