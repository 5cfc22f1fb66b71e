# SPDX-License-Identifier: GPL-3.0-or-later
"""Which triangles of a mesh cross each other, decided exactly."""

from .meeting_pairs import self_intersections, self_intersections_steps
