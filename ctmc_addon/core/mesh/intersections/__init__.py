# SPDX-License-Identifier: GPL-3.0-or-later
"""Find exactly which triangles of a mesh cross each other."""

from .meeting_pairs import self_intersections, self_intersections_steps
