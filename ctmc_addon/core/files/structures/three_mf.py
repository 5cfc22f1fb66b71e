# SPDX-License-Identifier: GPL-3.0-or-later
"""Structures as a 3MF: an object with a name, a base material with a color each, in millimeters.

3MF Consortium, 3D Manufacturing Format, core specification 1.3: a ZIP of XML. Files are dated 1980, as ZIP begins.
Colors of a map are a color group of its materials extension 1.2.1: 256 steps of the ramp and the color of no value, so
that a corner names its color by a number.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from ...maps.ramps import NO_VALUE, colors_of
from ...maps.surface_map import SurfaceMap
from ...progress import Step, Steps
from ..mesh_files import parts_of
from .structure import Structure, hex_color, total

MOST_VERTICES = 1 << 31
MATERIALS = 1  # The number of the group of materials; objects follow.
TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>\n'
)
RELATIONS = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Target="/3D/3dmodel.model" Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>\n'
)
HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<model unit="millimeter" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"{}>\n'
    '<metadata name="Application">CTMC</metadata>\n<resources>\n'
)
COLORED = ' xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02"'
COLORS = 256  # Steps of a ramp; the color of no value follows.


def write_3mf_steps(path: Path, structures: Sequence[Structure]) -> Steps[None]:
    """Write a 3MF. A closed structure is a model, an open one a surface, which no printer takes for solid."""
    total([len(structure.vertices) for structure in structures], MOST_VERTICES, path.name, "vertices")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as package:
        package.writestr(_entry("[Content_Types].xml"), TYPES)
        package.writestr(_entry("_rels/.rels"), RELATIONS)
        with package.open(_entry("3D/3dmodel.model"), "w", force_zip64=True) as model:
            groups = _color_groups(structures)
            model.write(HEAD.format(COLORED if groups else "").encode())
            model.write(_materials(structures).encode("utf-8", "replace"))
            for key, group in groups.items():
                model.write(_color_group(group, *key).encode())
            for number, structure in enumerate(structures):
                _write_object(model, structure, number, groups)
                yield Step((number + 1) / len(structures), f"Writing {structure.name}")
            items = "".join(f'<item objectid="{MATERIALS + 1 + number}"/>\n' for number in range(len(structures)))
            model.write(f"</resources>\n<build>\n{items}</build>\n</model>\n".encode())


def _entry(name: str) -> zipfile.ZipInfo:
    """Return a file of the ZIP without a time, the same on every system."""
    entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
    entry.compress_type, entry.create_system, entry.external_attr = zipfile.ZIP_DEFLATED, 3, 0o644 << 16
    return entry


def _materials(structures: Sequence[Structure]) -> str:
    bases = "".join(
        f'<base name="{escape(structure.name)}" displaycolor="{hex_color(structure)}"/>\n' for structure in structures
    )
    return f'<basematerials id="{MATERIALS}">\n{bases}</basematerials>\n'


def _color_groups(structures: Sequence[Structure]) -> dict[tuple[str, int], int]:
    """Return the number of the color group of each ramp and opacity from 0 to 255; numbers follow those of objects."""
    out: dict[tuple[str, int], int] = {}
    for structure in structures:
        if structure.shown_map is not None:
            out.setdefault(_group_key(structure, structure.shown_map), MATERIALS + 1 + len(structures) + len(out))
    return out


def _group_key(structure: Structure, shown: SurfaceMap) -> tuple[str, int]:
    return shown.ramp, round(structure.opacity * 255)


def _color_group(number: int, ramp: str, opacity: int) -> str:
    """Return a color group: the steps of a ramp, then the color of no value."""
    steps = colors_of(np.arange(COLORS, dtype=np.float32), (0.0, COLORS - 1.0), ramp)
    codes = ["{:02X}{:02X}{:02X}".format(*step) for step in steps.tolist()] + [NO_VALUE.upper()]
    colors = "".join(f'<m:color color="#{code}{opacity:02X}"/>\n' for code in codes)
    return f'<m:colorgroup id="{number}">\n{colors}</m:colorgroup>\n'


def _color_numbers(shown: SurfaceMap) -> NDArray[np.int64]:
    """Return the step of the ramp at each vertex, (V,); `COLORS` where there is no value."""
    low, high = shown.range
    share = np.clip((shown.values.astype(np.float64) - low) / ((high - low) or 1.0), 0.0, 1.0)
    unknown = np.isnan(share)
    share[unknown] = 0.0
    numbers = np.floor(share * (COLORS - 1) + 0.5).astype(np.int64)
    numbers[unknown] = COLORS
    return numbers


def _write_object(model: IO[bytes], structure: Structure, number: int, groups: Mapping[tuple[str, int], int]) -> None:
    kind = "model" if structure.closed else "surface"
    head = (
        f'<object id="{MATERIALS + 1 + number}" type="{kind}" name="{escape(structure.name)}" '
        f'pid="{MATERIALS}" pindex="{number}"><mesh><vertices>\n'
    )
    model.write(head.encode("utf-8", "replace"))
    model.writelines(_vertices(structure))
    model.write(b"</vertices><triangles>\n")
    shown = structure.shown_map
    if shown is None:
        model.writelines(_triangles(structure))
    else:
        model.writelines(_colored_triangles(structure, shown, groups[_group_key(structure, shown)]))
    model.write(b"</triangles></mesh></object>\n")


def _vertices(structure: Structure) -> Iterator[bytes]:
    for part in parts_of(len(structure.vertices)):
        rows = structure.vertices[part].astype(float) + 0.0  # no -0
        yield (b'<vertex x="%.5f" y="%.5f" z="%.5f"/>\n' * len(rows)) % tuple(rows.ravel().tolist())


def _triangles(structure: Structure) -> Iterator[bytes]:
    for part in parts_of(len(structure.faces)):
        rows = structure.faces[part]
        yield (b'<triangle v1="%d" v2="%d" v3="%d"/>\n' * len(rows)) % tuple(rows.ravel().tolist())


def _colored_triangles(structure: Structure, shown: SurfaceMap, group: int) -> Iterator[bytes]:
    colors = _color_numbers(shown)
    line = b'<triangle v1="%%d" v2="%%d" v3="%%d" pid="%d" p1="%%d" p2="%%d" p3="%%d"/>\n' % group
    for part in parts_of(len(structure.faces)):
        faces = structure.faces[part]
        rows = np.concatenate([faces, colors[faces]], axis=1)
        yield (line * len(rows)) % tuple(rows.ravel().tolist())
