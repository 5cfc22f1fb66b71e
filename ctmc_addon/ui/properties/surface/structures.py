# SPDX-License-Identifier: GPL-3.0-or-later
"""Define the structures of a scene's CT: the list `scene.ctmc.labels`, and its sources `scene.ctmc.label_sources`.

A line of the list is a label (`kind` is "label", `value` its number in the label volume of the scene) or a threshold
(`threshold` and perhaps `upper`). Name, color, opacity and tick are the same for both, and Reconstruct makes what is
ticked. `state.structures` holds the voxels: `label_volume(scene)` is one label volume on the grid of the CT, of all
sources. A structure from elsewhere, such as a drawn mask, is added by `state.structures.add_labels`.

As in settings.py, this module must not hold `bpy` itself, nor anything that does.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from bpy.types import PropertyGroup

from ....core import ReconstructionSettings, SettingsError
from ....core.volume import structure_color
from ...state.change_events import COLOR, NAME, OPACITY, notify
from ..described import as_written
from ..kinds import boolean, choice, collection, decimal, decimals, integer, text

LABEL, THRESHOLD = "label", "threshold"
Line = tuple[int, str, tuple[float, float, float]]
"""A line of the list: a label's value, name and color."""

_ticking: list[bool] = []  # Not empty while code sets ticks.
_filling: list[bool] = []  # Not empty while code fills the list.


@contextmanager
def filling() -> Iterator[None]:
    """Fill the list without sending change events."""
    _filling.append(True)
    _ticking.append(True)
    try:
        yield
    finally:
        _filling.pop()
        _ticking.pop()


def tick_only(properties: Any, label: int | None) -> None:
    """Tick this label in the list, and no other structure."""
    tick(properties, lambda item: item.kind == LABEL and item.value == label)


def tick(properties: Any, is_requested: Callable[[Any], bool]) -> None:
    """Tick the requested structures and no other; the setting `label` stays."""
    if _ticking:
        return
    _ticking.append(True)
    for item in properties.labels:
        if item.chosen != is_requested(item):
            item.chosen = is_requested(item)
    _ticking.clear()


def _on_tick(item: Any, _context: Any) -> None:
    """Make structures of the list once one is ticked; the first ticked label becomes the setting `label`."""
    if not _ticking:
        follow_ticks(item.id_data.ctmc)


def follow_ticks(properties: Any) -> None:
    """Update the setting `label` from the ticks, and send a change event."""
    ticked = [item for item in properties.labels if item.chosen]
    labels = [item.value for item in ticked if item.kind == LABEL]
    _ticking.append(True)
    if labels and properties.label not in labels:
        properties.label = labels[0]
    if ticked and not properties.use_label:
        properties.use_label = True
    _ticking.clear()
    notify(properties, "label")


def on_look(event: str) -> Callable[[Any, Any], None]:
    """Apply the new name or color of a structure to its surfaces."""

    def update(item: Any, _context: Any) -> None:
        if not _filling:
            notify(item.id_data.ctmc, event)

    return update


def _on_opacity(item: Any, context: Any) -> None:
    """Apply the new opacity of a structure to its surfaces; a surface made opaque counts as chosen by hand."""
    if not _filling:
        item.opaque = item.opacity == 1.0
    _copy_opacity(item, context)


_copy_opacity = on_look(OPACITY)


def _on_limits(item: Any, _context: Any) -> None:
    """Send a change event for a threshold of the list."""
    if not _filling:
        notify(item.id_data.ctmc, "label")


class CTMCLabel(PropertyGroup):
    """A structure: its source, name, color and opacity, and whether to make a surface of it."""

    kind: choice(
        "Made Of",
        "How the structure is defined",
        items=[(LABEL, "Label", "Voxels that have its number"), (THRESHOLD, "Threshold", "Values of the CT")],
    )
    value: integer("Value", "Value of the label in the volume")
    threshold: decimal("Threshold", "Values at or above it are inside [HU or gray value]", update=_on_limits)
    use_upper: boolean("Upper Limit", "Whether there is an upper limit", update=_on_limits)
    upper: decimal("Upper Limit", "Values above it are outside [HU or gray value]", update=_on_limits)
    source: text("Source", "Label source of the structure; empty for the CT's own labels", options={"HIDDEN"})
    chosen: boolean("Reconstruct", "Make a surface of this structure", update=_on_tick)
    name: text("Name", "Name of the structure and of its surface. Double-click to change it", update=on_look(NAME))
    color: decimals(
        "Color", "Color of the structure's surface", subtype="COLOR", size=3, min=0.0, max=1.0, update=on_look(COLOR)
    )
    opacity: decimal(
        "Opacity",
        "How opaque the structure's surface is, in the viewport, renders, figures and exports; a "
        "surface made alone starts opaque",
        subtype="FACTOR",
        min=0.0,
        max=1.0,
        default=1.0,
        precision=2,
        update=_on_opacity,
    )
    opaque: boolean("Opaque", "Whether an opacity of 1 was chosen in the list", options={"HIDDEN"})


class CTMCLabelSource(PropertyGroup):
    """A file or mask whose labels are structures of the CT; `state.structures` holds its voxels by the key."""

    key: text("Key", "Fingerprint of its labels", options={"HIDDEN"})
    path: text("Path", "File or folder that the labels were read from. Empty = made here")
    offset: integer("Offset", "Offset of its numbers, so that no two labels share one", options={"HIDDEN"})


class StructureMethods:
    """Methods of `scene.ctmc` for its structures."""

    labels: Any
    label_sources: Any
    label: Any
    use_label: Any

    def structure_of(self, settings: ReconstructionSettings) -> Any:
        """Return the line of the list for a surface with these settings, or None."""
        return next((item for item in self.labels if is_made_of(item, settings)), None)

    def ticked_settings(self, settings: ReconstructionSettings) -> list[ReconstructionSettings]:
        """Return these settings for each ticked structure, or for the label itself if it is not in the list.

        Raises
        ------
        SettingsError
            If no structure of the list is ticked.
        """
        ticked = [item for item in self.labels if item.chosen]
        labels = [item.value for item in self.labels if item.kind == LABEL]
        if not ticked and len(self.labels) and (not labels or self.label in labels):
            raise SettingsError("no structure is ticked; tick one in the list")
        return [of_structure(item, settings) for item in ticked] or [replace(settings, label=self.label)]

    def color_of(self, label: int | None) -> tuple[float, float, float] | None:
        """Return the color chosen in the list for a label; None if it is not in the list."""
        return next((tuple(item.color) for item in self.labels if item.kind == LABEL and item.value == label), None)

    def name_of(self, label: int) -> str:
        """Return the name of a label's surface: the label's name in the list, else its number."""
        return next(
            (called(item) for item in self.labels if item.kind == LABEL and item.value == label), f"Label {label}"
        )

    def show_labels(self, labels: Iterable[Line]) -> None:
        """Replace the list by the labels of a CT that has just been loaded."""
        self.labels.clear()
        self.label_sources.clear()
        self.add_labels(labels)
        tick_only(self, self.label if self.use_label else None)

    def add_labels(self, labels: Iterable[Line], source: str = "") -> list[Any]:
        """Add unticked labels to the list; those of a source have its key."""
        first = len(self.labels)
        with filling():
            for value, name, color in labels:
                item = self.labels.add()
                item.value, item.name, item.color, item.source = value, name, color, source
                item.opacity = structure_color(value, None, name).opacity
        return list(self.labels[first:])

    def add_threshold(
        self, name: str, color: tuple[float, float, float], threshold: float, upper: float | None = None
    ) -> Any:
        """Add an unticked structure between two values of the CT to the list, and return its line."""
        with filling():
            item = self.labels.add()
            item.kind, item.name, item.color, item.threshold = THRESHOLD, name, color, threshold
            item.use_upper = upper is not None
            item.upper = item.threshold if upper is None else upper
        return item


def structure_choices(properties: Any) -> list[tuple[str, Any]]:
    """Return the labels of the list, each after its key: the name where that means one label, else the number."""
    labels = [item for item in properties.labels if item.kind == LABEL]
    names = Counter(item.name for item in labels)
    return [(item.name if item.name and names[item.name] == 1 else str(item.value), item) for item in labels]


def called(item: Any) -> str:
    """Return the name of a line's surface: its own, else its label's number; empty for a threshold."""
    return str(item.name) or (f"Label {item.value}" if item.kind == LABEL else "")


def chosen_opacity(item: Any) -> float | None:
    """Return the opacity that the name or the list has chosen; None without a choice."""
    return None if item is None or (item.opacity == 1.0 and not item.opaque) else round(float(item.opacity), 3)


def of_structure(item: Any, settings: ReconstructionSettings) -> ReconstructionSettings:
    """Return the settings of a structure's surface: its label, or its threshold with an allowed smoothing."""
    if item.kind == LABEL:
        return replace(settings, label=item.value)
    return settings.at_threshold(as_written(item.threshold), as_written(item.upper) if item.use_upper else None)


def is_made_of(item: Any, settings: ReconstructionSettings) -> bool:
    """Return whether a surface with these settings belongs to a line of the list."""
    if item.kind == LABEL:
        return bool(item.value == settings.label)
    return settings.label is None and (settings.threshold, settings.upper) == (
        as_written(item.threshold),
        as_written(item.upper) if item.use_upper else None,
    )


def structure_properties() -> dict[str, Any]:
    """Return the properties that store the structures of the file's CT."""
    return {
        "labels": collection("Structures", "Structures of the CT", type=CTMCLabel),
        "label_index": integer("Structure", "Selected line of the list"),
        "label_sources": collection("Label Sources", "Where the labels come from", type=CTMCLabelSource),
    }


CLASSES = (CTMCLabel, CTMCLabelSource)
