# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the component of a surface at a point, and keep or separate it."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import MeshError, Reconstruction, Surface, TriangleMesh, distances, finish
from ...core.mesh import bodies_steps, with_faces
from .objects import require_updatable, update_reconstruction
from .provenance import Provenance, require_provenance
from .readback import own_mesh, read_back, reconstruction_of

ON_SURFACE = 1e-2  # Tolerance in mm for a click on the surface.
PICKED = "Components were picked by hand."
"""The note of a surface that its settings do not reproduce."""


def own_surface(obj: bpy.types.Object) -> Reconstruction:
    """Return an object's surface before modifiers, RAS+ mm, with both ends of alpha where it has them."""
    provenance = require_provenance(obj)
    return read_back(obj) or reconstruction_of(own_mesh(obj), None, provenance.settings, provenance)


def component_at(result: Reconstruction, point_mm: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which triangles, (F,), belong to the component at a point, cavity walls included.

    Parameters
    ----------
    result : Reconstruction
    point_mm : (3,) float64
        RAS+ mm, on the surface as the patient has it.
    """
    triangle = _nearest_triangle(result.mesh, point_mm)
    bodies = finish(bodies_steps(surface_of(result), result.settings.alpha_number))
    return np.asarray(bodies == bodies[triangle])


def _nearest_triangle(mesh: TriangleMesh, point: NDArray[np.float64]) -> int:
    """Return the triangle at a point; for a point off the surface, one at the nearest vertex."""
    corners = mesh.vertices[mesh.faces]  # (F, 3, 3)
    low, high = corners.min(axis=1) - ON_SURFACE, corners.max(axis=1) + ON_SURFACE
    around = np.flatnonzero(((low <= point) & (point <= high)).all(axis=1))
    if not len(around):
        around = np.flatnonzero((mesh.faces == mesh.faces.ravel()[near(corners, point)]).any(axis=1))
    far = [distances(point[None], TriangleMesh(mesh.vertices, mesh.faces[[face]]))[0] for face in around]
    return int(around[int(np.argmin(far))])


def near(corners: NDArray[np.float32], point: NDArray[np.float64]) -> int:
    """Return the index of the corner, of all (F, 3, 3), nearest to a point."""
    return int(((corners.reshape(-1, 3) - point) ** 2).sum(axis=1).argmin())


def surface_of(result: Reconstruction) -> Surface:
    """Return both ends of alpha, which are equal where alpha is settled."""
    mesh = result.mesh
    return result.surface or Surface(mesh.vertices, mesh.vertices, mesh.faces, mesh.normals)


def _with_triangles(result: Reconstruction, selected: NDArray[np.bool_]) -> Reconstruction:
    """Return a reconstruction of some of the triangles, (F,).

    Raises
    ------
    MeshError
        If none would be left.
    """
    if not selected.any():
        raise MeshError("this is the only component; nothing would be left")
    surface = with_faces(surface_of(result), selected)
    mesh = surface.at(result.settings.alpha_number)
    is_full = result.full_faces == len(result.mesh.faces)
    notes = (*(note for note in result.notes if note != PICKED), PICKED)
    return replace(
        result,
        mesh=mesh,
        surface=None if result.surface is None else surface,
        full_faces=len(mesh.faces) if is_full else result.full_faces,
        notes=notes,
    )


def give_triangles(obj: bpy.types.Object, result: Reconstruction, selected: NDArray[np.bool_]) -> None:
    """Reduce an object to some of its triangles; transform, materials and modifiers stay."""
    require_updatable(obj)
    provenance: Provenance = require_provenance(obj)
    update_reconstruction(obj, _with_triangles(result, selected), fingerprint=provenance.fingerprint)


def separated(obj: bpy.types.Object, result: Reconstruction, selected: NDArray[np.bool_]) -> bpy.types.Object:
    """Move some triangles of an object into a new one, which is otherwise equal.

    Raises
    ------
    MeshError
        If the object would be left without any.
    """
    require_updatable(obj)
    if selected.all():
        raise MeshError("this is the only component; nothing would be left")
    new = obj.copy()
    new.data = obj.data.copy()
    for slot, material in enumerate(obj.data.materials):  # The new object's color is its own.
        new.data.materials[slot] = None if material is None else material.copy()
    for collection in obj.users_collection:
        collection.objects.link(new)
    give_triangles(new, result, selected)
    give_triangles(obj, result, ~selected)
    return new
