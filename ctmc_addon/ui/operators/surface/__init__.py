# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces: making, changing, measuring and exporting them."""
