# SPDX-License-Identifier: GPL-3.0-or-later
"""Write surfaces as binary STL and PLY in millimeters, with the same bytes from sidebar, command line and Python.

`TriangleMesh.save` writes whole meshes; heads, facets, vertices and faces can be written in pieces too.

A space is named by where its axes run in the patient: in RAS+ x runs to the right, y to the front and z to the head, in
LPS+ (DICOM's) x runs to the left and y to the back.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from ..arrays import Floats
from ..errors import OutputError
from ..mesh.face_normals import vertex_normals
from .atomic_write import whole_file
from .map_names import NamedValues, require_values, words_of

SPACES = {  # Names of spaces and the directions of their axes.
    "ras": "x to the patient's right, y to the front, z to the head",
    "lps": "x to the patient's left, y to the back, z to the head, as in DICOM",
}
PAGE = ".html"
STRUCTURE_SUFFIXES = (".obj", ".glb", ".3mf", PAGE)  # Files that hold several surfaces, in structures/.
BLENDER_SUFFIXES = (".blend",)  # Files that Blender writes, in blender/export.py.
PLACED_SUFFIXES = (".glb", PAGE, *BLENDER_SUFFIXES)  # Files that place each structure without moving its vertices.
ROWS_AT_ONCE = 1 << 16
STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
PLY_FACE = np.dtype([("count", "u1"), ("vertices", "<i4", 3)])
PLY_VERTEX = ("x", "y", "z", "nx", "ny", "nz")  # Properties of a vertex, before those of maps.


def write_mesh(
    path: str | os.PathLike[str],
    vertices: Floats,
    faces: NDArray[np.int32],
    normals: Floats | None = None,
    maps: Sequence[NamedValues] = (),
) -> None:
    """Write a surface to an STL or PLY, whole or not at all; the suffix chooses the format.

    Parameters
    ----------
    vertices : (V, 3) float32
        Millimeters.
    faces : (F, 3) int32
    normals : (V, 3) float32 or None
        For a PLY; without them it gets the means of the triangles'.
    maps : sequence of SurfaceMap
        Each becomes a float property of a PLY's vertices, with NaN where there is no value; spaces in names become
        `_`. An STL holds none.

    Raises
    ------
    OutputError
        For another suffix, a map of another surface, or a place that cannot be written to.
    """
    target = Path(path)
    writer = WRITERS.get(target.suffix.lower())
    if writer is None:
        raise OutputError(
            f"{target.name or 'an empty name'} is neither .stl nor .ply; {', '.join(STRUCTURE_SUFFIXES)} are written "
            "by save_structures, a .blend by the command line and the panel"
        )
    require_values("the surface", len(vertices), maps)
    with whole_file(target) as temporary, temporary.open("wb") as file:
        writer(file, vertices, faces, normals, maps)


def _write_stl(
    file: IO[bytes],
    vertices: Floats,
    faces: NDArray[np.int32],
    normals: Floats | None = None,
    maps: Sequence[NamedValues] = (),
) -> None:
    """Write a binary STL; facets have their own normals, so `normals` and `maps` of vertices are ignored."""
    write_stl_head(file, len(faces))
    for part in parts_of(len(faces)):
        write_stl_facets(file, vertices.take(faces[part], axis=0))


def write_stl_head(file: IO[bytes], face_count: int) -> None:
    """Write the beginning of a binary STL with this number of facets."""
    file.write(b"CTMC surface, mm".ljust(80))
    file.write(np.uint32(face_count).astype("<u4").tobytes())


def write_stl_facets(file: IO[bytes], corners: Floats) -> None:
    """Write facets of a binary STL from their corners, (n, 3, 3)."""
    rows = np.zeros(len(corners), STL_FACE)
    rows["corners"] = corners
    # A row for each coordinate of each corner: NumPy works through long rows far faster than through columns of 3.
    first, second, third = np.ascontiguousarray(corners.transpose(1, 2, 0), np.float64)  # (3, n) each
    u, v = second - first, third - first
    normals = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    length = np.sqrt(normals[0] ** 2 + normals[1] ** 2 + normals[2] ** 2)
    length[length == 0] = 1.0
    for axis, normal in enumerate(normals):
        rows["normal"][:, axis] = normal / length
    file.write(rows.view(np.uint8).data)


def _write_ply(
    file: IO[bytes],
    vertices: Floats,
    faces: NDArray[np.int32],
    normals: Floats | None = None,
    maps: Sequence[NamedValues] = (),
) -> None:
    """Write a binary PLY with a normal at every vertex: that of the surface, else the mean of its triangles."""
    write_ply_head(file, len(vertices), len(faces), words_of((each.name for each in maps), PLY_VERTEX))
    if normals is None:
        normals = vertex_normals(vertices, faces)
    for part in parts_of(len(vertices)):
        write_ply_vertices(file, vertices[part], normals[part], [each.values[part] for each in maps])
    for part in parts_of(len(faces)):
        write_ply_faces(file, faces[part])


def write_ply_head(file: IO[bytes], vertex_count: int, face_count: int, map_names: Sequence[str] = ()) -> None:
    """Write the header of a binary PLY; vertices follow, each with its values of maps, then faces."""
    properties = "".join(f"property float {name}\n" for name in (*PLY_VERTEX, *map_names))
    file.write(
        "ply\nformat binary_little_endian 1.0\ncomment CTMC surface, mm\n"
        f"element vertex {vertex_count}\n{properties}"
        f"element face {face_count}\nproperty list uchar int vertex_indices\nend_header\n".encode()
    )


def write_ply_vertices(file: IO[bytes], vertices: Floats, normals: Floats, values: Sequence[Floats] = ()) -> None:
    """Write vertices of a binary PLY, (n, 3), their normals, and their values of maps, (n,) each."""
    columns = [vertices, normals, *(each[:, None] for each in values)]
    file.write(np.concatenate(columns, axis=1).astype("<f4", copy=False).tobytes())


def write_ply_faces(file: IO[bytes], faces: NDArray[np.int32]) -> None:
    """Write faces of a binary PLY, (n, 3)."""
    rows = np.empty(len(faces), PLY_FACE)
    rows["count"], rows["vertices"] = 3, faces
    file.write(rows.tobytes())


def require_one_surface(path: Path, count: int = 0) -> None:
    """Raise `OutputError` for several surfaces in a file that can hold one; `count` is their number, 0 if unknown."""
    if count != 1 and path.suffix.lower() in SUFFIXES:
        asked = f"there are {count}" if count else "2 or more are asked for"
        raise OutputError(
            f"{path.name} can hold one surface, and {asked}; give a folder, such as -o {path.stem}/, "
            "or a .glb, .obj, .3mf, .html or .blend"
        )


def require_placements(path: Path) -> None:
    """Raise `OutputError` for an exploded view in a file that holds only coordinates, which would become wrong."""
    if path.suffix.lower() not in PLACED_SUFFIXES:
        formats = f"{', '.join(PLACED_SUFFIXES[:-1])} or {PLACED_SUFFIXES[-1]}"
        raise OutputError(
            f"{path.name} holds the patient's coordinates alone, which an exploded view would make wrong; "
            f"write {formats}, or leave explode out"
        )


def parts_of(count: int) -> Iterator[slice]:
    """Yield slices that cover `count` rows, some rows at a time."""
    return (slice(start, start + ROWS_AT_ONCE) for start in range(0, count, ROWS_AT_ONCE))


WRITERS: dict[str, Callable[[IO[bytes], Floats, NDArray[np.int32], Floats | None, Sequence[NamedValues]], None]] = {
    ".stl": _write_stl,
    ".ply": _write_ply,
}
SUFFIXES = tuple(WRITERS)
SCENE_SUFFIXES = (*STRUCTURE_SUFFIXES, *BLENDER_SUFFIXES)  # Files that hold several surfaces.
SURFACE_SUFFIXES = (*SUFFIXES, *SCENE_SUFFIXES)


def files_of(path: Path) -> tuple[Path, ...]:
    """Return the files of a surface: for an OBJ also that of its materials.

    Examples
    --------
    >>> [file.name for file in files_of(Path("a.obj"))], [file.name for file in files_of(Path("a.stl"))]
    (['a.obj', 'a.mtl'], ['a.stl'])
    """
    return (path, path.with_suffix(".mtl")) if path.suffix.lower() == ".obj" else (path,)
