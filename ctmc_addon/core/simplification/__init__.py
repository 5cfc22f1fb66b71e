# SPDX-License-Identifier: GPL-3.0-or-later
"""Fewer triangles by quadric error metrics, to a count or within a distance."""
