# SPDX-License-Identifier: GPL-3.0-or-later
"""Record how an object was made, in its custom property `ctmc`: complete, or None.

The property holds JSON, because voxel counts outgrow Blender's integers; any Blender shows it without this extension.
Other add-ons may use the name `ctmc` too, so an object whose property is incomplete is not a surface of ours.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields, replace
from functools import lru_cache

import bpy

from ...core import VERSION, MeshError, Reconstruction, ReconstructionSettings, SettingsError
from ..stored_values import finite, parsed_json, positive, texts, whole
from .placement import Placement

PROPERTY = "ctmc"


@dataclass(frozen=True)
class Provenance:
    """Record of how a surface was made.

    Parameters
    ----------
    settings : ReconstructionSettings
        Their alpha follows the object's.
    placement : Placement
        Transform from millimeters to the object's local space when it was made.
    version : str
        Version of this package.
    name : str
        Name of the volume.
    threshold : float
        The gray value that was used.
    faces, vertices, full_faces : int
        With and without simplification.
    voxels_visited : int
    spacing_mm : (x, y, z) float
    notes : tuple of str
        Assumptions.
    fingerprint : str
        Fingerprint of the volume's values; empty if not known.
    drawn : str
        A hash of the structure's drawing; empty if nothing was drawn by hand.
    part : str
        Name of the part of a solid that it is; empty for a surface as the settings alone make it.
    part_number : int
        Of the part among those of its structure, from 0.
    sharing_labels : tuple of int
        As `Reconstruction.sharing_labels`.
    """

    settings: ReconstructionSettings
    placement: Placement
    version: str
    name: str
    threshold: float
    faces: int
    vertices: int
    full_faces: int
    voxels_visited: int
    spacing_mm: tuple[float, float, float]
    notes: tuple[str, ...]
    fingerprint: str = ""
    drawn: str = ""
    part: str = ""
    part_number: int = 0
    sharing_labels: tuple[int, ...] = ()


TEXTS = ("fingerprint", "drawn", "part")
"""Fields that are texts of their own in the property; files of earlier versions lack some."""
OF_THE_PROPERTY = ("settings", "placement", *TEXTS)
REPORTED = tuple(field.name for field in fields(Provenance) if field.name not in OF_THE_PROPERTY)


def provenance_of_result(result: Reconstruction, placement: Placement, fingerprint: str = "") -> Provenance:
    """Return the provenance of an object that is made from a reconstruction."""
    return Provenance(
        settings=result.settings,
        placement=placement,
        version=VERSION,
        name=result.name,
        threshold=result.threshold,
        faces=len(result.mesh.faces),
        vertices=len(result.mesh.vertices),
        full_faces=result.full_faces,
        voxels_visited=result.voxels_visited,
        spacing_mm=result.spacing_mm,
        notes=result.notes,
        fingerprint=fingerprint,
        part_number=result.part_number,
        sharing_labels=result.sharing_labels,
    )


def read_provenance(obj: bpy.types.Object | None) -> Provenance | None:
    """Return how an object was made; None for an object that is not a surface of ours."""
    if obj is None or obj.type != "MESH":
        return None
    stored = obj.get(PROPERTY)
    try:
        x, y, z = stored["origin"]
        words = tuple(stored.get(name, "") for name in TEXTS)
        return parsed(stored["settings"], stored["report"], (x, y, z), stored["scale"], words)
    except (TypeError, KeyError, IndexError, AttributeError, ValueError):
        return None  # No property, or another add-on's of any kind.


def require_provenance(obj: bpy.types.Object) -> Provenance:
    """Return how an object was made, or raise a `MeshError`."""
    provenance = read_provenance(obj)
    if provenance is None:
        raise MeshError(f"{obj.name} was not made by CTMC; choose a reconstructed object")
    return provenance


@lru_cache(maxsize=256)  # Panels ask at every redraw.
def parsed(
    settings: str, report: str, origin: tuple[float, float, float], scale: float, words: tuple[str, ...]
) -> Provenance | None:
    """Return the provenance in the property's texts; None if a field is missing or has a wrong type."""
    try:
        reported = parsed_json(report)
        x, y, z = reported["spacing_mm"]
        ox, oy, oz = origin
        return Provenance(
            settings=ReconstructionSettings.from_dict(parsed_json(settings)),
            placement=Placement((finite(ox), finite(oy), finite(oz)), positive(scale)),
            version=str(reported["version"]),
            name=str(reported["name"]),
            threshold=finite(reported["threshold"]),
            faces=whole(reported["faces"]),
            vertices=whole(reported["vertices"]),
            full_faces=whole(reported["full_faces"]),
            voxels_visited=whole(reported["voxels_visited"]),
            spacing_mm=(positive(x), positive(y), positive(z)),
            notes=texts(reported["notes"]),
            part_number=whole(reported.get("part_number", 0)),  # Files of earlier versions lack these.
            sharing_labels=tuple(map(whole, reported.get("sharing_labels", ()))),
            **{name: str(text) for name, text in zip(TEXTS, words, strict=True)},
        )
    except (TypeError, KeyError, ValueError, AttributeError, ArithmeticError, SettingsError):
        return None


def write_provenance(obj: bpy.types.Object, provenance: Provenance) -> None:
    """Store on an object how it was made."""
    settings = provenance.settings.to_dict()
    report = {name: value for name, value in asdict(provenance).items() if name in REPORTED} | {"settings": settings}
    obj[PROPERTY] = {
        "version": provenance.version,
        "scale": provenance.placement.scale,
        "origin": provenance.placement.origin,
        "settings": json.dumps(settings),
        "report": json.dumps(report, ensure_ascii=False),
        **{name: getattr(provenance, name) for name in TEXTS},
    }


def set_settings(obj: bpy.types.Object, settings: ReconstructionSettings) -> None:
    """Change the settings in an object's provenance."""
    write_provenance(obj, replace(require_provenance(obj), settings=settings))


def set_drawn(obj: bpy.types.Object, drawn: str) -> None:
    """Change the hash of the drawing in an object's provenance."""
    write_provenance(obj, replace(require_provenance(obj), drawn=drawn))


def set_part(obj: bpy.types.Object, part: str) -> None:
    """Change the name of the part of a solid in an object's provenance."""
    write_provenance(obj, replace(require_provenance(obj), part=part))


def settings_of(obj: bpy.types.Object) -> ReconstructionSettings:
    """Return the settings an object was made with."""
    return require_provenance(obj).settings
