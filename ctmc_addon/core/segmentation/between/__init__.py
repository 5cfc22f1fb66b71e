# SPDX-License-Identifier: GPL-3.0-or-later
"""Structures drawn on some slices, interpolated between them."""
