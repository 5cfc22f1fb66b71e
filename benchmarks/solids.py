# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut and hollow organs: time, open edges, crossings and volumes against Blender's modifiers and Manifold.

    make bench ARGS="--only solids"

The peers work on the surface that CTMC makes of the label; CTMC's time begins with the label and ends with the facts
for print.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core import ReconstructionSettings, Volume, reconstruct
from ctmc_addon.core.mesh.intersections import self_intersections
from ctmc_addon.core.mesh.triangle_mesh import TriangleMesh
from ctmc_addon.core.solid import Cut, SolidRequest, solid_parts
from ctmc_addon.readers import read_volume

from . import scenes
from .measuring import Row, Session

LABELS = "ts_nifti/example_seg_fast_force_split.nii.gz"
ORGANS = {"vertebra": 29, "kidney": 2, "hip": 77}
NORMAL = (0.1, 0.2, 1.0)
WALL_MM = 2.0
FAR_MM = 500.0
Meshes = list[TriangleMesh]


def measure(session: Session) -> None:
    """Measure all rows of this part."""
    for name, volume, label in organs(session):
        settings = ReconstructionSettings(label=label, close_border=True)
        mesh = reconstruct(volume, settings).mesh
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        cut = Cut(tuple(((low + high) / 2).astype(float).tolist()), NORMAL)
        work = f"{name}, {len(mesh.faces) / 1e3:.0f}k triangles"
        cuts = {
            "Blender's Boolean, exact": blender_cut(mesh, cut, "EXACT"),
            "Blender's Boolean, Manifold": blender_cut(mesh, cut, "MANIFOLD"),
            "manifold3d, split_by_plane": manifold_cut(mesh, cut),
        }
        compare(session, f"{work}, cut in two", ours(volume, label, SolidRequest(cuts=(cut,))), cuts)
        hollows = {"Blender's Solidify": solidify(mesh)}
        compare(session, f"{work}, hollow {WALL_MM:g} mm", ours(volume, label, SolidRequest(hollow=WALL_MM)), hollows)


def organs(session: Session) -> Iterator[tuple[str, Volume, int]]:
    """Yield a patient's organs at 3 mm; where these are not there, the phantom's liver."""
    path = session.data / LABELS
    if not path.exists():
        yield "the phantom's liver", scenes.abdomen_phantom(60).labels, 1
        return
    volume = replace(read_volume(path), kind="label")
    for name, label in ORGANS.items():
        yield f"a patient's {name}", volume, label


def ours(volume: Volume, label: int, solid: SolidRequest) -> Callable[[], Meshes]:
    """Return a call that makes the parts of a label."""
    return lambda: [part.mesh for part in solid_parts(volume, ReconstructionSettings(), solid, [label])]


def compare(session: Session, work: str, call: Callable[[], Meshes], peers: dict[str, Callable[[], Meshes]]) -> None:
    """Add a row of seconds for every peer, with what the surfaces are."""
    own = defects(call())
    seconds = session.race({"CTMC": call, **peers}, max(1, session.repeats // 3))
    typical = {name: session.typical(taken) for name, taken in seconds.items()}
    for name, peer in peers.items():
        note = f"{own}; the peer {defects(peer())}"
        session.add(Row(session.part, work, name, typical["CTMC"], typical[name], note=note))


def defects(meshes: Meshes) -> str:
    """Return open and non-manifold edges, crossings and volume of parts, a word each."""
    edges = crossings = 0
    for mesh in meshes:
        ends = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges += int(np.count_nonzero(np.unique(ends, axis=0, return_counts=True)[1] != 2))
        crossings += len(self_intersections(mesh.vertices, mesh.faces))
    volume = sum(mesh.volume for mesh in meshes) / 1000
    return f"{edges} edges without two triangles, {crossings} crossings, {volume:.2f} ml"


def manifold_cut(mesh: TriangleMesh, cut: Cut) -> Callable[[], Meshes]:
    """Return a call that cuts with manifold3d."""
    import manifold3d

    given = manifold3d.Mesh(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    unit = np.array(cut.normal) / np.linalg.norm(cut.normal)

    def call() -> Meshes:
        parts = manifold3d.Manifold(given).split_by_plane(unit, float(unit @ cut.point))
        made = [part.to_mesh() for part in parts]
        return [TriangleMesh(each.vert_properties[:, :3], each.tri_verts.astype(np.int32)) for each in made]

    return call


def blender_cut(mesh: TriangleMesh, cut: Cut, solver: str) -> Callable[[], Meshes]:
    """Return a call that cuts with Blender's Boolean modifier and a box whose side is the plane: both parts."""
    import bpy
    from mathutils import Matrix, Vector

    thing = blender_object(mesh.vertices, mesh.faces)
    corners = np.array([[x, y, z] for z in (0, 1) for y in (-1, 1) for x in (-1, 1)], float) * FAR_MM
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    turn = Vector(cut.normal).to_track_quat("Z", "Y").to_matrix().to_4x4()
    place = np.array(Matrix.Translation(cut.point) @ turn)
    box = blender_object(corners @ place[:3, :3].T + place[:3, 3], quads)
    modifier = thing.modifiers.new("cut", "BOOLEAN")
    modifier.object, modifier.solver = box, solver

    def call() -> Meshes:
        parts = []
        for operation in ("INTERSECT", "DIFFERENCE"):
            modifier.operation = operation
            bpy.context.view_layer.update()
            parts.append(evaluated(thing))
        return parts

    return call


def solidify(mesh: TriangleMesh) -> Callable[[], Meshes]:
    """Return a call that hollows with Blender's Solidify modifier, inward and with even thickness."""
    thing = blender_object(mesh.vertices, mesh.faces)
    modifier = thing.modifiers.new("hollow", "SOLIDIFY")
    modifier.offset, modifier.use_even_offset = -1.0, True

    def call() -> Meshes:
        modifier.thickness = WALL_MM - 0.5  # Another value first, so that it is evaluated anew.
        modifier.thickness = WALL_MM
        return [evaluated(thing)]

    return call


def blender_object(vertices: NDArray[Any], faces: Any) -> Any:
    """Return a new object in Blender's scene."""
    import bpy

    data = bpy.data.meshes.new("surface")
    data.from_pydata(np.asarray(vertices, float).tolist(), [], np.asarray(faces).tolist())
    thing = bpy.data.objects.new("surface", data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def evaluated(thing: Any) -> TriangleMesh:
    """Return what the modifiers of an object make, as triangles."""
    import bpy

    thing.update_tag()
    graph = bpy.context.evaluated_depsgraph_get()
    owner = thing.evaluated_get(graph)
    data = owner.to_mesh()
    data.calc_loop_triangles()
    vertices = np.empty(3 * len(data.vertices), np.float32)
    faces = np.empty(3 * len(data.loop_triangles), np.int32)
    data.vertices.foreach_get("co", vertices)
    data.loop_triangles.foreach_get("vertices", faces)
    owner.to_mesh_clear()
    return TriangleMesh(vertices.reshape(-1, 3), faces.reshape(-1, 3))
