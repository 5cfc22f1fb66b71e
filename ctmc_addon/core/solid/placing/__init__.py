# SPDX-License-Identifier: GPL-3.0-or-later
"""Places of pegs, drains, feet and thicker walls."""
