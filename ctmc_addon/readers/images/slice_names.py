# SPDX-License-Identifier: GPL-3.0-or-later
"""Which pictures of a folder are the slices of one stack, by their names alone.

Slices of a stack are named alike but for a number. A preview, a copy or a mask beside them is named in another way, and
a second stack has another pattern or counts from the start again.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError

Item = TypeVar("Item")
NUMBER = r"[0-9]+"
LIKE_SIZE = 0.75  # A second run with at least this share of the largest one's pictures may be meant as well.
FEWEST_OF_PATTERN = 0.25  # Names follow a pattern if the longest run has at least this share of the pictures.
MOST_NAMES = 3  # in a sentence
MOST_DIGITS = 15  # of a number that is compared


def slices_by_name(images: Sequence[Path], own_slice: Path | None, folder: str) -> tuple[list[Path], list[str]]:
    """Return the slices among the pictures of a folder, and the note that names those left out.

    Parameters
    ----------
    images : sequence of Path
        In natural order.
    own_slice : Path or None
        The picture that was asked for: its stack is read, else the one with the most pictures.
    folder : str
        Name of the folder, for errors.

    Raises
    ------
    ReadError
        If two stacks are of like size, or `own_slice` is not a slice of a stack.
    """
    runs = runs_by_name(images)
    if len(runs) < 2:
        return list(images), []
    if len(runs[0]) < max(2, FEWEST_OF_PATTERN * len(images)):
        return list(images), [f"the names of the {len(images)} pictures follow no pattern: read in their order"]
    stack = runs[0]
    if own_slice is None:
        require_one_stack(runs, folder)
    else:
        stack = next(run for run in runs if own_slice in run)
        if len(stack) == 1:
            raise ReadError(
                f"{own_slice.name} is not one of the slices beside it, {_ends(runs[0])}, by its name; choose one of "
                "those, or the folder"
            )
    return stack, left_out(images, stack, f"not named like the {len(stack)} slices {_ends(stack)}")


def require_one_stack(runs: Sequence[Sequence[Path]], folder: str) -> None:
    """Refuse a folder in which several runs of pictures may be meant.

    Parameters
    ----------
    runs : sequence of sequences of Path
        The longest run first.
    folder : str
        Its name.

    Raises
    ------
    ReadError
        If the second run is of like size, or the first is the smaller part of all runs.
    """
    stacks = [run for run in runs if len(run) > 1]
    if len(stacks) < 2:
        return
    first, second = len(stacks[0]), len(stacks[1])
    if second >= LIKE_SIZE * first or 2 * first < sum(map(len, stacks)):
        words = limited_names([f"{_ends(run)} ({len(run)})" for run in stacks])
        raise ReadError(
            f"the folder {folder} has {len(stacks)} stacks of pictures: {words}; choose a slice of the one to read, "
            "or give each a folder of its own"
        )


def left_out(images: Sequence[Path], slices: Iterable[Path], why: str) -> list[str]:
    """Return the note that names the pictures that are no slices, or none."""
    kept = set(slices)
    others = [path.name for path in images if path not in kept]
    pictures = f"{len(others)} picture{'s' * (len(others) > 1)}"
    return [f"{pictures} left out, {why}: {limited_names(others)}"] if others else []


def runs_by_name(images: Sequence[Path]) -> list[list[Path]]:
    """Return the pictures in runs of one pattern of names, the longest run first.

    Examples
    --------
    >>> names = ["a_1.png", "a_1 (1).png", "a_2.png", "a_spr.png"]
    >>> [[path.name for path in run] for run in runs_by_name([Path(name) for name in names])]
    [['a_1.png', 'a_2.png'], ['a_1 (1).png'], ['a_spr.png']]
    """
    runs = _grouped(images, lambda path: tuple(re.split(NUMBER, path.stem.casefold())))
    return sorted((part for run in runs for part in _counted_apart(run)), key=len, reverse=True)


def check_numbers(images: Sequence[Path]) -> None:
    """Refuse slices numbered in even steps of which some are missing: their neighbors would seem adjacent.

    Names whose numbers differ in more than one place, or in no even step, say nothing about missing slices.
    """
    numbers = _numbers(images)
    varying = _varying(numbers)
    if len(varying) != 1:
        return
    steps = np.diff(numbers[:, varying[0]])
    usual = int(steps.min(initial=1 << 60))
    gaps = np.flatnonzero(steps != usual)
    if usual > 0 and len(gaps) and 2 * len(gaps) < len(steps) + 1 and not (steps % usual).any():
        before, after = images[gaps[0]], images[gaps[0] + 1]
        raise ReadError(
            f"slices are missing between {before.name} and {after.name}, as the others are numbered in steps of "
            f"{usual}; add them, or number the slices without a gap"
        )


def limited_names(names: Sequence[str]) -> str:
    """Return up to three names and how many more there are.

    Examples
    --------
    >>> limited_names(["a", "b", "c", "d", "e"]), limited_names(["a", "b"])
    ('a, b, c and 2 more', 'a, b')
    """
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return ", ".join(names[:MOST_NAMES]) + more


def _counted_apart(run: list[Path]) -> list[list[Path]]:
    """Part names with two numbers in which one counts from the same start for each value of the others.

    'scan1_01', 'scan1_02', 'scan2_01', 'scan2_02' are two stacks. Dates, times and positions beside a number of the
    slice are another for each slice, or do not start again.
    """
    numbers = _numbers(run)
    varying = _varying(numbers)
    if len(varying) < 2:
        return [run]
    counter = max(varying, key=lambda at: (len(np.unique(numbers[:, at])), at))
    others = [at for at in varying if at != counter]
    parts = _grouped(range(len(run)), lambda at: tuple(numbers[at, others].tolist()))
    starts = {int(numbers[part, counter].min()) for part in parts}
    if len(starts) > 1 or 2 * len(parts) > len(run):
        return [run]
    return [[run[at] for at in part] for part in parts]


def _grouped(items: Iterable[Item], key: Callable[[Item], Hashable]) -> list[list[Item]]:
    """Return the items of each key, in their order."""
    groups: dict[Hashable, list[Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return list(groups.values())


def _numbers(images: Sequence[Path]) -> NDArray[np.int64]:
    """Return the numbers of each name, (names, numbers); none where the text around them differs."""
    if len({tuple(re.split(NUMBER, path.stem.casefold())) for path in images}) > 1:
        return np.empty((len(images), 0), np.int64)
    numbers = [[int(word[:MOST_DIGITS]) for word in re.findall(NUMBER, path.stem)] for path in images]
    return np.array(numbers, np.int64).reshape(len(images), -1)


def _varying(numbers: NDArray[np.int64]) -> list[int]:
    """Return which columns have more than one value."""
    return [at for at in range(numbers.shape[1]) if (numbers[:, at] != numbers[0, at]).any()]


def _ends(run: Sequence[Path]) -> str:
    return f"{run[0].name} to {run[-1].name}" if len(run) > 1 else run[0].name
