# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces as binary STL and PLY, in millimeters: the same bytes from the sidebar, the command line and Python.

A space is named by where its axes run in the patient: in RAS+ x runs to the right, y to the front and z to the head, in
LPS+ (DICOM's) x runs to the left and y to the back.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ..core import OutputError, TriangleMesh
from ..core.mesh import vertex_normals
from .atomic_write import whole_file

SPACES = {  # and where their axes run
    "ras": "x to the patient's right, y to the front, z to the head",
    "lps": "x to the patient's left, y to the back, z to the head, as in DICOM",
}
BLENDER_SUFFIXES = (".obj", ".glb", ".blend")  # of files that Blender writes, in blender/export.py
ROWS_AT_ONCE = 1 << 16
STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
PLY_FACE = np.dtype([("count", "u1"), ("vertices", "<i4", 3)])


def write_mesh(mesh: TriangleMesh, path: str | os.PathLike[str], space: str = "ras") -> None:
    """Write a surface to an STL or PLY, whole or not at all; the suffix chooses the format.

    Parameters
    ----------
    mesh : TriangleMesh
        RAS+ mm.
    space : {"ras", "lps"}
        Axes of the file.

    Raises
    ------
    OutputError
        For another suffix, or a place that cannot be written to.
    """
    target = Path(path)
    if target.suffix.lower() not in WRITERS:
        raise OutputError(f"{target.name or 'an empty name'} is neither .stl nor .ply")
    with whole_file(target) as beside, beside.open("wb") as file:
        WRITERS[target.suffix.lower()](in_space(mesh, space), file)


def in_space(mesh: TriangleMesh, space: str) -> TriangleMesh:
    """A surface in RAS+ mm in the axes of `space`, "ras" or "lps"; half a turn, so the winding stays."""
    if space == "ras":
        return mesh
    turn = np.array([-1, -1, 1], np.float32)
    return TriangleMesh(mesh.vertices * turn, mesh.faces, None if mesh.normals is None else mesh.normals * turn)


def write_stl(mesh: TriangleMesh, file: BinaryIO) -> None:
    """A binary STL; every facet with its own normal."""
    file.write(b"CTMC surface, mm".ljust(80))
    file.write(np.uint32(len(mesh.faces)).astype("<u4").tobytes())
    for start in range(0, len(mesh.faces), ROWS_AT_ONCE):
        corners = mesh.vertices[mesh.faces[start : start + ROWS_AT_ONCE]]  # (n, 3, 3)
        rows = np.zeros(len(corners), STL_FACE)
        rows["corners"] = corners
        normals = np.cross(corners[:, 1].astype(np.float64) - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.sqrt(normals[:, 0] ** 2 + normals[:, 1] ** 2 + normals[:, 2] ** 2)
        length[length == 0] = 1.0
        rows["normal"] = normals / length[:, None]
        file.write(rows.tobytes())


def write_ply(mesh: TriangleMesh, file: BinaryIO) -> None:
    """A binary PLY with a normal at every vertex: the surface's own, else the mean of its triangles'."""
    properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    file.write(
        "ply\nformat binary_little_endian 1.0\ncomment CTMC surface, mm\n"
        f"element vertex {len(mesh.vertices)}\n{properties}"
        f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n".encode()
    )
    normals = vertex_normals(mesh.vertices, mesh.faces) if mesh.normals is None else mesh.normals
    for start in range(0, len(mesh.vertices), ROWS_AT_ONCE):
        part = slice(start, start + ROWS_AT_ONCE)
        file.write(np.concatenate([mesh.vertices[part], normals[part]], axis=1).astype("<f4", copy=False).tobytes())
    for start in range(0, len(mesh.faces), ROWS_AT_ONCE):
        faces = mesh.faces[start : start + ROWS_AT_ONCE]
        rows = np.empty(len(faces), PLY_FACE)
        rows["count"], rows["vertices"] = 3, faces
        file.write(rows.tobytes())


WRITERS: dict[str, Callable[[TriangleMesh, BinaryIO], None]] = {".stl": write_stl, ".ply": write_ply}
SUFFIXES = tuple(WRITERS)
SURFACE_SUFFIXES = (*SUFFIXES, *BLENDER_SUFFIXES)
