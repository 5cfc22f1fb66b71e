# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose the labels of two volumes that are the same structure: by name where both have names, else by number."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ..errors import AbsentLabelError, LabelError
from ..files.file_names import printable
from ..progress import Steps
from ..volume.labels.extents import (
    ALL,
    Extents,
    chosen_labels_steps,
    existing_labels_steps,
    label_extents_steps,
    require_labels,
)
from ..volume.volume import Box, Volume


class LabelPair(NamedTuple):
    """A structure in two volumes, and its number in each; None in one that lacks it."""

    name: str
    before: int | None
    after: int | None

    @property
    def number(self) -> int | None:
        """The number of the later label, else that of the earlier one."""
        return self.before if self.after is None else self.after


class _Labels(NamedTuple):
    volume: Volume
    box: Box
    extents: Extents


def label_pairs_steps(
    before: Volume, after: Volume, choices: Sequence[int | str], boxes: tuple[Box, Box], threads: int | None = None
) -> Steps[list[LabelPair]]:
    """Return the structures that are chosen by number, by name or by the word "all", each once.

    Parameters
    ----------
    before, after : Volume
    choices : sequence of int or str
    boxes : (before, after) of Box
        Parts that are looked at.
    threads : int, optional

    Raises
    ------
    AbsentLabelError
        If both volumes lack a label.
    LabelError
        If a name is asked for and none of the labels has one, or a volume holds HU.
    """
    sides = []
    for volume, box in zip((before, after), boxes, strict=True):
        require_labels(volume)
        sides.append(_Labels(volume, box, (yield from label_extents_steps(volume, box, threads))))
    first, last = sides
    pairs: dict[tuple[int | None, int | None], LabelPair] = {}
    for choice in choices:
        if choice == ALL:
            numbers = list(first.extents), list(last.extents)
        elif isinstance(choice, str):
            numbers = yield from _called_steps(before, after, choice)
        else:
            numbers = [choice], [choice]
        found = _paired(first, last, *numbers, by_name=isinstance(choice, str))
        if not found:
            raise (yield from _absent_steps(first, last, choice))
        pairs |= {(pair.before, pair.after): pair for pair in found}
    return list(pairs.values())


def _paired(
    first: _Labels, last: _Labels, before: Sequence[int], after: Sequence[int], by_name: bool
) -> list[LabelPair]:
    """Return the pairs of labels that at least one of the volumes has."""
    left = [number for number in before if number in first.extents]
    pairs: list[tuple[int | None, int | None]] = []
    for number in after:
        if number in last.extents:
            partner = _partner(last.volume, number, first.volume) if by_name else number
            found = partner in left
            if found:
                left.remove(partner)
            pairs.append((partner if found else None, number))
    pairs += [(number, None) for number in left]
    return [LabelPair(_name(first.volume, last.volume, *pair), *pair) for pair in pairs]


def _partner(volume: Volume, number: int, other: Volume) -> int:
    """Return the number in the other volume of a label with the same name; without names the same number."""
    name = _plain(volume.label_names.get(number, ""))
    called = [one for one, own in other.label_names.items() if name and _plain(own) == name]
    own = [one for one, other_name in volume.label_names.items() if _plain(other_name) == name]
    if len(called) == len(own) == 1:
        return called[0]
    other_name = _plain(other.label_names.get(number, ""))
    return number if not (name and other_name) or name == other_name else -1


def _called_steps(before: Volume, after: Volume, name: str) -> Steps[tuple[list[int], list[int]]]:
    """Return the labels with a name in both volumes; one without any names takes the other's numbers."""
    numbers: list[list[int] | None] = []
    errors: list[LabelError] = []
    for volume in (before, after):
        try:
            numbers.append(list((yield from chosen_labels_steps(volume, [name]))))
        except AbsentLabelError as error:
            numbers.append([])
            errors.append(error)
        except LabelError as error:
            numbers.append(None)
            errors.append(error)
    first, last = numbers
    if not (first or last):
        raise errors[-1]
    return first if first is not None else last or [], last if last is not None else first or []


def _absent_steps(first: _Labels, last: _Labels, choice: int | str) -> Steps[AbsentLabelError]:
    if choice == ALL:
        return AbsentLabelError(
            f"neither {first.volume.name} nor {last.volume.name} has a label here: all voxels are 0"
        )
    own = yield from existing_labels_steps(first.volume, first.box)
    later = yield from existing_labels_steps(last.volume, last.box)
    return AbsentLabelError(f"no voxel has the label {choice}; before, {own}; after, {later}")


def _name(before: Volume, after: Volume, first: int | None, last: int | None) -> str:
    names = [
        volume.label_names.get(number, "") for volume, number in ((after, last), (before, first)) if number is not None
    ]
    number = first if last is None else last
    return next((printable(name) for name in names if name), f"label {number}")


def _plain(name: str) -> str:
    return " ".join(name.casefold().replace("_", " ").split())
