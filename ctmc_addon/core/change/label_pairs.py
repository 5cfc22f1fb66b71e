# SPDX-License-Identifier: GPL-3.0-or-later
"""Match the labels of two volumes that are the same structure: by name if both have names, else by number."""

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
    compared_name,
    existing_labels_steps,
    label_extents_steps,
    require_labels,
)
from ..volume.volume import Box, Volume


class LabelPair(NamedTuple):
    """A structure in two volumes, with its number in each; None if a volume lacks it."""

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
    """Return the structures selected by number, by name or by the word "all", each once.

    Parameters
    ----------
    before, after : Volume
    choices : sequence of int or str
    boxes : (before, after) of Box
        Parts of the volumes to search.
    threads : int, optional

    Raises
    ------
    AbsentLabelError
        If both volumes lack a label.
    LabelError
        If a choice is a name and no label has a name, or a volume holds HU.
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
        choice_pairs = _paired(first, last, *numbers, by_name=isinstance(choice, str))
        if not choice_pairs:
            raise (yield from _absent_steps(first, last, choice))
        pairs |= {(pair.before, pair.after): pair for pair in choice_pairs}
    return list(pairs.values())


def _paired(
    first: _Labels, last: _Labels, before: Sequence[int], after: Sequence[int], by_name: bool
) -> list[LabelPair]:
    """Return the pairs of labels; in a pair, one volume may lack the label."""
    left = [number for number in before if number in first.extents]
    pairs: list[tuple[int | None, int | None]] = []
    for number in after:
        if number in last.extents:
            partner = _partner(last.volume, number, first.volume) if by_name else number
            is_paired = partner in left
            if is_paired:
                left.remove(partner)
            pairs.append((partner if is_paired else None, number))
    pairs += [(number, None) for number in left]
    return [LabelPair(_name(first.volume, last.volume, *pair), *pair) for pair in pairs]


def _partner(volume: Volume, number: int, second: Volume) -> int:
    """Return the number of the label with the same name in a second volume; without names, the same number."""
    name = compared_name(volume.label_names.get(number, ""))
    partners = [each for each, text in second.label_names.items() if name and compared_name(text) == name]
    namesakes = [each for each, text in volume.label_names.items() if compared_name(text) == name]
    if len(partners) == len(namesakes) == 1:
        return partners[0]
    second_name = compared_name(second.label_names.get(number, ""))
    return number if not (name and second_name) or name == second_name else -1


def _called_steps(before: Volume, after: Volume, name: str) -> Steps[tuple[list[int], list[int]]]:
    """Return the labels with a name in both volumes; a volume without names takes the numbers of the other one."""
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
