# SPDX-License-Identifier: GPL-3.0-or-later
"""Place pegs, drains, feet and thicker walls."""
