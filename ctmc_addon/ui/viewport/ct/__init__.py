# SPDX-License-Identifier: GPL-3.0-or-later
"""Show the CT in the 3D viewport: its slices, and objects of it."""
