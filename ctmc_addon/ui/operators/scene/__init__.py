# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators for objects beside the surfaces: slices, volume, rulers."""
