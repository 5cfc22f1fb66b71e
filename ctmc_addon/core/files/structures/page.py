# SPDX-License-Identifier: GPL-3.0-or-later
"""Structures as one HTML page that shows them without a network: turned, zoomed, cut, each with eye and opacity.

The page holds three.js (MIT), the viewer of this folder, and every mesh in few bytes (`packed.py`). It may load
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

from ...progress import Step, Steps
from ...units import volume_text
from .packed import Packed, packed
from .structure import Structure

VIEWER = Path(__file__).with_name("viewer")


def write_page_steps(path: Path, structures: Sequence[Structure]) -> Steps[None]:
    """Write a page; its title is the file's own name."""
    template = (VIEWER / "page.html").read_text("utf-8")
    with path.open("wb") as file:
        # Text and marks in turn.
        for number, piece in enumerate(re.split(r"\{\{([\w.]+)\}\}", template)):
            if number % 2 == 0:
                file.write(piece.encode())
            elif piece == "title":
                file.write(html.escape(path.stem).encode("utf-8", "replace"))
            elif piece == "structures":
                for done, structure in enumerate(structures, 1):
                    file.write(_element(structure).encode("utf-8", "replace"))
                    yield Step(done / len(structures), f"Writing {structure.name}")
            else:
                file.write((VIEWER / piece).read_bytes())


def _element(structure: Structure) -> str:
    """Return a structure as an element of the page: its properties as an attribute, its mesh as text."""
    mesh = packed(structure.vertices, structure.faces)
    facts = html.escape(json.dumps(_facts(structure, mesh), separators=(",", ":"), ensure_ascii=False))
    content = base64.b64encode(mesh.content).decode("ascii")
    return f'<script type="application/octet-stream" class="structure" data-facts="{facts}">{content}</script>\n'


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
    }
