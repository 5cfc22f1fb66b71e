# SPDX-License-Identifier: GPL-3.0-or-later
"""Structures as a Wavefront OBJ with its MTL: an object and a material each, in millimeters.

Paul Bourke's copies of the Wavefront specifications, paulbourke.net/dataformats/obj and /mtl. A name has no spaces
there. Colors are sRGB shares of 1, as most programs read and write them; those of a map follow the coordinates of a
vertex, as MeshLab, Blender and others read them, and its material is white.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ...progress import Step, Steps
from ..mesh_files import parts_of
from .structure import Structure

WHITE = (255, 255, 255)


def write_obj_steps(path: Path, structures: Sequence[Structure]) -> Steps[None]:
    """Write an OBJ, and its MTL next to it."""
    materials = path.with_suffix(".mtl")
    with materials.open("wb") as file:
        file.write(b"# CTMC\n")
        for structure in structures:
            file.write(_material(structure).encode("utf-8", "replace"))
    with path.open("wb") as file:
        file.write(f"# CTMC surface, mm\nmtllib {materials.name}\n".encode("utf-8", "replace"))
        first = 1
        for number, structure in enumerate(structures):
            name = _word(structure)
            file.write(f"o {name}\n".encode("utf-8", "replace"))
            file.writelines(_vertex_lines(structure))
            file.write(f"usemtl {name}\ns 1\n".encode("utf-8", "replace"))
            file.writelines(_face_lines(structure, first))
            first += len(structure.vertices)
            yield Step((number + 1) / len(structures), f"Writing {structure.name}")


def _word(structure: Structure) -> str:
    return structure.name.replace(" ", "_")


def _material(structure: Structure) -> str:
    rgb = structure.rgb if structure.shown_map is None else WHITE
    red, green, blue = (f"{level / 255:.4f}" for level in rgb)
    return (
        f"newmtl {_word(structure)}\nKa {red} {green} {blue}\nKd {red} {green} {blue}\nKs 0.2 0.2 0.2\nNs 40\n"
        f"d {structure.opacity:.4g}\nillum 2\n"
    )


def _vertex_lines(structure: Structure) -> Iterator[bytes]:
    """Yield the vertices to a hundredth of a micrometer, with colors of the shown map, thousands of lines at a time."""
    colored = structure.shown_map
    line = b"v %.5f %.5f %.5f\n" if colored is None else b"v %.5f %.5f %.5f %.4f %.4f %.4f\n"
    for part in parts_of(len(structure.vertices)):
        rows = structure.vertices[part].astype(float) + 0.0  # no -0
        if colored is not None:
            rows = np.concatenate([rows, colored.colors[part] / 255.0], axis=1)
        yield (line * len(rows)) % tuple(rows.ravel().tolist())


def _face_lines(structure: Structure, first: int) -> Iterator[bytes]:
    """Yield the triangles, of vertices numbered from `first`."""
    for part in parts_of(len(structure.faces)):
        rows = structure.faces[part].astype(int) + first
        yield (b"f %d %d %d\n" * len(rows)) % tuple(rows.ravel().tolist())
