# SPDX-License-Identifier: GPL-3.0-or-later
"""Define the solid that Reconstruct makes, `scene.ctmc_solid`, with the defaults and limits of `core.solid`.

As in settings.py, this module must not hold `bpy` itself, nor anything that does.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from bpy.props import PointerProperty
from bpy.types import PropertyGroup, Scene
from bpy.utils import register_class, unregister_class

from ....core import SettingsError, defaults, descriptions
from ....core.solid import (
    LARGEST_MM,
    LENGTHS,
    MOST_PEGS,
    Combination,
    Combining,
    Cut,
    Drain,
    Pegs,
    SolidRequest,
    moved_to,
    position_of,
)
from ...state.change_events import COMBINED, notify
from ..described import as_typed, as_written, property_of, tooltip
from ..kinds import boolean, choice, collection, decimal, decimals, integer, text
from .structures import structure_choices

ABOUT = descriptions(SolidRequest)
LEAST_MM = 0.1  # Of what must be above 0.
SOFT_MM = 20.0  # As far as a drag goes.
COMBININGS = (
    (Combining.MERGE, "Merge", "Join all of them into one structure"),
    (Combining.SUBTRACT, "Subtract", "Subtract the other structures from the first one"),
    (Combining.INTERSECT, "Intersect", "Keep only what all of them have in common"),
)
"""Ways to combine structures, with their names and explanations."""


def _own(name: str) -> Any:
    """Return a length of `SolidRequest`, which says name, text and limits."""
    soft = {"soft_min": max(ABOUT[name].low or 0.0, -SOFT_MM), "soft_max": SOFT_MM}
    return property_of(ABOUT[name], defaults(SolidRequest)[name], unit="CAMERA", precision=2, **soft)


def _length(name: str, description: str, default: float = 0.0, low: float = 0.0, **options: Any) -> Any:
    """Return a length, which Blender shows in mm at any unit scale of the scene."""
    limits = {"default": default, "min": low, "max": LARGEST_MM, "soft_max": SOFT_MM, **options}
    return decimal(name, description, unit="CAMERA", precision=2, **limits)


def _place(name: str, description: str, **options: Any) -> Any:
    return decimals(name, description, size=3, precision=1, step=100, **options)


def _numbers(values: Iterable[float]) -> tuple[float, float, float]:
    x, y, z = map(as_written, values)
    return x, y, z


class CTMCDrain(PropertyGroup):
    """A hole through the wall of a solid."""

    auto: boolean("Auto", "Whether the drain is two holes, at the lowest and the highest point", options={"HIDDEN"})
    diameter: _length("Diameter", "Set the diameter of the hole", 4.0, LEAST_MM)
    point: _place("Point", "Set where the hole begins, inside the solid [mm]")

    def to_request(self) -> Drain:
        """Return the drain for `core`."""
        return Drain(as_written(self.diameter), None if self.auto else _numbers(self.point))


def _get_position(cut: Any) -> float:
    return position_of(cut.to_request()) if any(cut.normal) else 0.0


def _set_position(cut: Any, position: float) -> None:
    if any(cut.normal):
        cut.point = moved_to(cut.to_request(), as_written(position)).point


class CTMCCut(PropertyGroup):
    """A plane that cuts a solid in two."""

    point: _place("Point", "Set a point of the plane [mm]")
    normal: decimals(
        "Normal", "Set the direction that the plane faces; part a lies on that side", size=3, default=(0.0, 0.0, 1.0)
    )
    position: decimal(
        "Position", "Move the plane along its normal", unit="CAMERA", precision=2, get=_get_position, set=_set_position
    )

    def to_request(self) -> Cut:
        """Return the cut for `core`.

        Raises
        ------
        SettingsError
            If the normal is 0 0 0.
        """
        return Cut(_numbers(self.point), _numbers(self.normal))


def _offered(operand: Any, _context: Any, _typed: str) -> list[str]:
    """Return the names or numbers of the labels of the list, and the names of structures from earlier combinations."""
    offered = [key for key, _ in structure_choices(operand.id_data.ctmc)]
    for combination in operand.id_data.ctmc_solid.combinations:
        if any(each == operand for each in combination.of):
            break
        try:
            offered.append(combination.to_request().name)
        except SettingsError:  # It lacks structures.
            continue
    return offered


def _on_operand(operand: Any, _context: Any) -> None:
    """Keep an empty field after the last structure, for the next one."""
    for combination in operand.id_data.ctmc_solid.combinations:
        if combination.of and combination.of[-1].structure:
            combination.of.add()
    notify(operand.id_data.ctmc, COMBINED)


class CTMCOperand(PropertyGroup):
    """A structure of a combination."""

    structure: text(
        "Structure", "Choose a structure of the list or of an earlier combination", search=_offered, update=_on_operand
    )


class CTMCCombination(PropertyGroup):
    """Several structures combined into one."""

    how: choice("Combine", "How to combine", items=[(how.value, name, about) for how, name, about in COMBININGS])
    title: text("Name", "Name the new structure")
    of: collection("Structures", "Structures that are combined", type=CTMCOperand)

    def to_request(self) -> Combination:
        """Return the combination for `core`; without a name, it is named after its structures.

        Raises
        ------
        SettingsError
            If there are fewer than two structures.
        """
        names = tuple(operand.structure for operand in self.of if operand.structure)
        if len(names) < 2:
            raise SettingsError(
                "a combination takes two structures or more; choose them in the part Solid, or remove it"
            )
        return Combination(Combining(self.how), self.title.strip() or "+".join(names), names)


class CTMCSolid(PropertyGroup):
    """Operations on structures before the next surfaces are made."""

    drains: collection("Drains", "Holes through the wall", type=CTMCDrain)
    cuts: collection("Cuts", "Planes that cut the solid into parts", type=CTMCCut)
    use_pegs: boolean("Pegs", "Join the parts by pegs that fit into holes of the part beyond the cut")
    peg_count: integer("Number", "Choose the number of pegs on each cut", default=2, min=1, max=MOST_PEGS)
    peg_diameter: _length("Diameter", "Set the diameter of a peg", Pegs.diameter, LEAST_MM)
    peg_length: _length(
        "Length", "Set the length of a peg above the cut, including its round end", Pegs.length, LEAST_MM
    )
    clearance: _length("Clearance", "Set the gap between a peg and its hole", Pegs.clearance, soft_max=1.0)
    combinations: collection("Combinations", "Structures made from other structures", type=CTMCCombination)
    use_bed: boolean(f"Use {ABOUT['bed'].label}", tooltip(ABOUT["bed"]))
    bed: property_of(ABOUT["bed"], ABOUT["bed"].start, precision=1, step=100)

    def pegs_request(self) -> Pegs | None:
        """Return the pegs for `core`; None without pegs or cuts.

        Raises
        ------
        SettingsError
            If a peg is shorter than its round end.
        """
        sizes = (as_written(getattr(self, name)) for name in ("peg_diameter", "peg_length", "clearance"))
        return Pegs(self.peg_count, *sizes) if self.use_pegs and len(self.cuts) else None

    def to_request(self) -> SolidRequest:
        """Return the solid for `core`, checked.

        Raises
        ------
        SettingsError
            If two settings contradict each other.
        """
        if not self.hollow and any(drain.auto for drain in self.drains):
            raise SettingsError("an automatic drain opens a hollow; set Hollow in the part Solid, or remove the drain")
        own = {name: as_typed(getattr(self, name), about) for name, about in ABOUT.items()}
        return SolidRequest(
            **(own if self.use_bed else own | {"bed": None}),
            drains=tuple(drain.to_request() for drain in self.drains),
            cuts=tuple(cut.to_request() for cut in self.cuts),
            pegs=self.pegs_request(),
            combinations=tuple(combination.to_request() for combination in self.combinations),
        )


CTMCSolid.__annotations__.update({name: _own(name) for name in LENGTHS})
CLASSES = (CTMCDrain, CTMCCut, CTMCOperand, CTMCCombination, CTMCSolid)


def register() -> None:
    """Give every scene its solid."""
    for kind in CLASSES:
        register_class(kind)
    Scene.ctmc_solid = PointerProperty(type=CTMCSolid, name="CTMC Solid")


def unregister() -> None:
    """Unregister it; the data in files stays."""
    del Scene.ctmc_solid
    for kind in reversed(CLASSES):
        unregister_class(kind)
