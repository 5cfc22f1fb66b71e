# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the components of a surface that enclose enough, or the largest of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError
from ..progress import PAUSE, Steps
from .cavities import owners_steps
from .measures import component_volumes_steps
from .topology import component_numbers_steps
from .triangle_mesh import Surface, TriangleMesh


def keep_components_steps(surface: Surface, mesh: TriangleMesh, largest: int, min_volume: float) -> Steps[Surface]:
    """The surface without small components; the walls of a cavity belong to the component around it.

    Parameters
    ----------
    surface : Surface
        What to choose from.
    mesh : TriangleMesh
        The same faces at the alpha and in the space in which to measure.
    largest : int
        Keep this many with their cavities; 0 keeps all. A component counts by what its outer wall encloses,
        equal ones in the order of their numbers.
    min_volume : float
        Drop components and fill cavities below it, mm3 of a mesh in mm; applied together with `largest`.

    Returns
    -------
    Surface
        A cavity with no component around it, as may be where the surface is open, counts as a component.

    Raises
    ------
    MeshError
        If nothing would be left.
    """
    if not len(mesh.faces) or (largest == 0 and min_volume <= 0):
        return surface
    component = yield from component_numbers_steps(mesh.faces, len(mesh.vertices))
    yield PAUSE
    volumes = yield from component_volumes_steps(mesh.vertices, mesh.faces, component)
    owner = yield from owners_steps(mesh, component, volumes)
    keep = kept_components(volumes, owner, largest, min_volume)
    return surface if keep.all() else surface.with_faces(keep[component])


def kept_components(
    volumes: NDArray[np.float64], owner: NDArray[np.intp], largest: int, min_volume: float
) -> NDArray[np.bool_]:
    """Which components `keep_components_steps` keeps, (components,), from their signed volumes and owners.

    Raises
    ------
    MeshError
        If nothing would be left.
    """
    sizes, bodies = np.abs(volumes), owner == np.arange(len(owner))
    keep = sizes >= min_volume
    if not keep[bodies].any():
        raise MeshError(
            f"no component has a volume of {min_volume:g} mm3 or more: the largest of {bodies.sum()} has "
            f"{sizes.max():.4g} mm3; lower the minimum volume"
        )
    if largest:
        keep[np.flatnonzero(bodies)[np.argsort(-sizes[bodies], kind="stable")[largest:]]] = False
    return np.asarray(keep & keep[owner])
