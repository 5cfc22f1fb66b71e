# SPDX-License-Identifier: GPL-3.0-or-later
"""Write structures as one HTML page that shows them without a network.

The page turns, zooms, cuts and moves structures apart; each has an eye and an opacity.

The page holds three.js (MIT), the viewer of this folder, and every mesh and map in few bytes (`packed.py`). It may load
nothing: its content security policy forbids it.
"""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import Doubles
from ...exploded import offsets_of, reach_of
from ...maps.ramps import NO_VALUE, RAMPS
from ...maps.surface_map import SurfaceMap
from ...measures.units import volume_text
from ...progress import Step, Steps
from .packed import Packed, PackedValues, packed, packed_values
from .structure import Structure

VIEWER = Path(__file__).with_name("viewer")


def write_page_steps(path: Path, structures: Sequence[Structure]) -> Steps[None]:
    """Write a page; its title is the file's own name."""
    template = (VIEWER / "page.html").read_text("utf-8")
    offsets = offsets_of([(structure.vertices, structure.faces) for structure in structures])
    with path.open("wb") as file:
        # Text and marks in turn.
        for number, piece in enumerate(re.split(r"\{\{([\w.]+)\}\}", template)):
            if number % 2 == 0:
                file.write(piece.encode())
            elif piece == "title":
                file.write(html.escape(path.stem).encode("utf-8", "replace"))
            elif piece == "structures":
                file.write(_exploding(structures, offsets))
                for done, structure in enumerate(structures, 1):
                    message = f"Writing {structure.name}"
                    mesh = packed(structure.vertices, structure.faces)
                    file.write(_element("structure", _facts(structure, mesh), mesh.content))
                    for each in structure.maps:
                        yield Step((done - 0.5) / len(structures), message)
                        values = packed_values(each.values[mesh.order])
                        file.write(_element("map", _map_facts(each, values, done - 1), values.content))
                    yield Step(done / len(structures), message)
            else:
                file.write((VIEWER / piece).read_bytes())


def _exploding(structures: Sequence[Structure], offsets: Doubles) -> bytes:
    """Return the data for the slider of an exploded view; empty if no structure can be moved apart.

    `away` has the shift of each structure for 1 mm of the slider, which begins at `start` and ends at `most` mm: where
    the centers are twice as far from the middle as in the patient, or at the start if that is more.
    """
    reach = reach_of(offsets)
    if reach == 0.0:
        return b""
    start = reach_of(np.array([structure.shift for structure in structures], np.float64))
    away = [[round(part, 6) for part in row] for row in (offsets / reach).tolist()]
    return _element("explode", {"start": round(start, 3), "most": round(max(reach, start), 3), "away": away}, b"")


def _element(kind: str, facts: dict[str, Any], content: bytes) -> bytes:
    """Return a structure or map as an element of the page: its properties as an attribute, its content as text."""
    escaped = html.escape(json.dumps(facts, separators=(",", ":"), ensure_ascii=False))
    text = base64.b64encode(content).decode("ascii")
    element = f'<script type="application/octet-stream" class="{kind}" data-facts="{escaped}">{text}</script>\n'
    return element.encode("utf-8", "replace")


def _facts(structure: Structure, mesh: Packed) -> dict[str, Any]:
    return {
        "name": structure.name,
        "color": "#{:02x}{:02x}{:02x}".format(*structure.rgb),
        "opacity": round(structure.opacity, 3),
        "volume": None if structure.volume_mm3 is None else volume_text(structure.volume_mm3),
        "vertices": mesh.vertices,
        "faces": mesh.faces,
        "low": mesh.low,
        "step": mesh.step,
        "planes": mesh.planes,
        **({} if structure.shown_map is None else {"shown": structure.shown}),
    }


def _map_facts(each: SurfaceMap, values: PackedValues, structure: int) -> dict[str, Any]:
    return {
        "structure": structure,
        "name": each.name,
        "unit": each.unit,
        "range": each.range,
        "colors": RAMPS[each.ramp].split(),
        "none": NO_VALUE,
        "low": values.low,
        "step": values.step,
    }
