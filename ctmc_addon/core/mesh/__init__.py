# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangle meshes and the measurements on them."""

from typing import TYPE_CHECKING

from ..later import lazy_names
from .angles.triangle_angles import TriangleQuality
from .coarse import coarse_mesh, light_faces_steps
from .face_normals import vertex_normals, vertex_normals_steps
from .measures import Measures, measures_steps
from .pieces.kept_pieces import bodies_steps, keep_components_steps, with_faces
from .topology import Edges, Groups, Topology, edges_steps, topology_steps
from .triangle_mesh import blend

if TYPE_CHECKING:
    from .diameter import largest_diameter, largest_diameter_steps
    from .distance.signed_distance import SignedSurface
    from .distance.subdivision import mean_longest_edge_steps, subdivided_steps
    from .distance.surface_distance import (
        LostComponents,
        OneWayDistance,
        ReferenceSurface,
        SurfaceDistance,
        surface_distance,
        surface_distance_steps,
        vertex_distances_steps,
    )
    from .intersections import self_intersections, self_intersections_steps
    from .quality import SAMPLES, SEED, roughness, triangle_shapes
    from .rulers import angle_at, distance_between, where_ray_hits

__getattr__ = lazy_names(__name__)
