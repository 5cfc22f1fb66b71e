# SPDX-License-Identifier: GPL-3.0-or-later
"""Structures as a binary glTF 2.0: a node, a mesh and a material each, in meters, Y up.

Khronos, glTF 2.0 specification: 3.4 (coordinates), 3.6.2 (accessors), 3.7.2 (meshes), 3.9 (materials), 4.4 (the binary
file). An exploded view is a translation of nodes (3.5.3), so that vertices stay in the patient. Colors of the map shown
are COLOR_0, linear, times the material's white. Every map is an attribute `_NAME` of float32. glTF forbids NaN:
`NO_VALUE` is written where there is no value, and the extras of the mesh say so.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...progress import Step, Steps
from ...volume.labels.structure_colors import linear
from ..map_names import words_of
from .structure import Structure, total

MM_PER_M = 1000.0
MOST_BYTES = (1 << 32) - 1
ROUGHNESS = 0.45
FLOAT, SHORT, INTEGER = 5126, 5123, 5125  # Component types.
VERTICES, INDICES = 34962, 34963  # Targets of buffer views.
NO_VALUE = float(np.finfo(np.float32).min)
MOST_SHORT = 65535  # Indices of 16 bits reach this many vertices; the last one is reserved, 3.7.2.1.


def write_glb_steps(path: Path, structures: Sequence[Structure]) -> Steps[None]:
    """Write a GLB: colors are linear, as glTF has them; transparent structures are blended."""
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    meshes: list[dict[str, Any]] = []
    offset = 0
    for number, structure in enumerate(structures):
        positions = _positions(structure.vertices)
        low, high = ([float(value) for value in bound] for bound in (positions.min(axis=0), positions.max(axis=0)))
        kind, bytes_each = (SHORT, 2) if len(positions) <= MOST_SHORT else (INTEGER, 4)
        vectors = {"componentType": FLOAT, "count": len(positions), "type": "VEC3"}
        indices = {"componentType": kind, "count": structure.faces.size, "type": "SCALAR"}
        scalars = {"componentType": FLOAT, "count": len(positions), "type": "SCALAR"}
        meshes.append(_mesh(structure, number, len(accessors)))
        parts: list[tuple[dict[str, Any], int, int]] = [
            ({**vectors, "min": low, "max": high}, positions.nbytes, VERTICES),
            (vectors, positions.nbytes, VERTICES),
            (indices, structure.faces.size * bytes_each, INDICES),
            *[(vectors, positions.nbytes, VERTICES)] * (structure.shown_map is not None),
            *[(scalars, 4 * len(positions), VERTICES)] * len(structure.maps),
        ]
        for accessor, size, target in parts:
            views.append({"buffer": 0, "byteOffset": offset, "byteLength": size, "target": target})
            accessors.append({"bufferView": len(accessors), **accessor})
            offset += size + -size % 4
        yield Step(0.3 * number / len(structures), f"Writing {structure.name}")
    tree = {
        "asset": {"version": "2.0", "generator": "CTMC"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(structures)))}],
        "nodes": [_node(structure, number) for number, structure in enumerate(structures)],
        "meshes": meshes,
        "materials": [_material(structure) for structure in structures],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": offset}],
    }
    text = json.dumps(tree, separators=(",", ":"), ensure_ascii=False).encode("utf-8", "replace")
    text += b" " * (-len(text) % 4)
    size = total((28, len(text), offset), MOST_BYTES, path.name, "bytes")
    with path.open("wb") as file:
        file.write(struct.pack("<4sIII4s", b"glTF", 2, size, len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", offset, b"BIN\0"))
        for number, structure in enumerate(structures):
            for content in _contents(structure):
                file.write(np.ascontiguousarray(content).data)
                file.write(bytes(-content.nbytes % 4))
            yield Step(0.3 + 0.7 * (number + 1) / len(structures), f"Writing {structure.name}")


def _node(structure: Structure, number: int) -> dict[str, Any]:
    """Return the node of a mesh, moved where an exploded view has it; rounded to a micrometer, 3.5.3."""
    node = {"name": structure.name, "mesh": number}
    if not any(structure.shift):
        return node
    x, y, z = (round(part / MM_PER_M, 6) for part in structure.shift)
    return node | {"translation": [x, z, 0.0 - y]}


def _positions(vertices: NDArray[np.float32]) -> NDArray[np.float32]:
    """RAS+ mm as meters with x to the right, y to the head and z to the back, (V, 3)."""
    return _y_up(vertices.astype(np.float64) / MM_PER_M)


def _y_up(vectors: NDArray[Any]) -> NDArray[np.float32]:
    """Vectors turned so that the head is up along y, (V, 3); 0 stays positive."""
    return np.stack([vectors[:, 0], vectors[:, 2], 0.0 - vectors[:, 1]], axis=1).astype("<f4")


def _contents(structure: Structure) -> Iterator[NDArray[Any]]:
    """Yield the arrays of a structure, in the order of their accessors."""
    shown = structure.shown_map
    yield _positions(structure.vertices)
    yield _y_up(structure.vertex_normals())
    yield structure.faces.astype("<u2" if len(structure.vertices) <= MOST_SHORT else "<u4")
    if shown is not None:
        yield _linear_levels()[shown.colors]
    for each in structure.maps:
        yield np.where(np.isfinite(each.values), each.values, np.float32(NO_VALUE)).astype("<f4", copy=False)


def _linear_levels() -> NDArray[np.float32]:
    """Return the linear share of each sRGB level, (256,), rounded so that it does not depend on the machine."""
    return np.array([round(linear((level, level, level))[0], 5) for level in range(256)], "<f4")


def _mesh(structure: Structure, number: int, first: int) -> dict[str, Any]:
    """Return a mesh whose accessors begin at `first`, with all but the values of its maps."""
    attributes = {"POSITION": first, "NORMAL": first + 1}
    at = first + 3
    if structure.shown_map is not None:
        attributes["COLOR_0"] = at
        at += 1
    names = [f"_{word}" for word in words_of(each.name.upper() for each in structure.maps)]
    attributes |= {name: at + order for order, name in enumerate(names)}
    mesh = {
        "name": structure.name,
        "primitives": [{"attributes": attributes, "indices": first + 2, "material": number}],
    }
    if not structure.maps:
        return mesh
    maps = [
        {**each.about(), "attribute": name, "no_value": NO_VALUE}
        for each, name in zip(structure.maps, names, strict=True)
    ]
    return mesh | {"extras": {"maps": maps, "shown": "" if structure.shown_map is None else structure.shown}}


def _material(structure: Structure) -> dict[str, Any]:
    """Return the material, white where a map is shown; colors are rounded, so the file is the same on every machine."""
    rgb = structure.rgb if structure.shown_map is None else (255, 255, 255)
    color = [*(round(share, 5) for share in linear(rgb)), round(structure.opacity, 5)]
    shading = {"baseColorFactor": color, "metallicFactor": 0.0, "roughnessFactor": ROUGHNESS}
    material: dict[str, Any] = {"name": structure.name, "pbrMetallicRoughness": shading, "doubleSided": True}
    return material if structure.opacity == 1.0 else {**material, "alphaMode": "BLEND"}
