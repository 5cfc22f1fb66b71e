# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the slices of one stack among the pictures of a folder, by file names only.

Slices of a stack are named alike but for a number. A preview, a copy or a mask beside them is named in another way. A
second stack has another pattern, or its number starts again. Several pictures that may lie between slices are refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import TypeVar

from ...core import ReadError
from .name_numbers import (
    NUMBER,
    WHOLE,
    columns_of,
    date_columns,
    is_even,
    is_nearly_even,
    number_in_parts,
    numbers_in_order,
    single_number,
    text_around,
    varying,
)

Item = TypeVar("Item")
LIKE_SIZE = 0.75  # A second run with at least this share of the largest one's pictures may be meant as well.
FEWEST_OF_PATTERN = 0.25  # Names follow a pattern if the longest run has at least this share of the pictures.
MOST_BETWEEN = 0.05  # Up to this share of the slices, or one, other pictures between them are left out.
MOST_NAMES = 3  # A sentence names at most this many files.
LETTERS = ((16, "0-9a-f"), (36, "0-9a-z"))  # Bases of counters with letters, and their digits.


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
        If two stacks are of like size, pictures that would be left out lie between slices, or `own_slice` is not a
        slice of a stack.
    """
    runs = runs_by_name(images)
    if len(runs[0]) == len(images):
        return runs[0], _notes_on_parts(runs[0])
    if len(runs[0]) < max(2, FEWEST_OF_PATTERN * len(images)):
        return list(images), [f"the names of the {len(images)} pictures follow no pattern: read in their order"]
    stack = runs[0]
    if own_slice is None:
        require_one_stack(runs, folder)
    else:
        stack = next(run for run in runs if own_slice in run)
    _require_none_between(images, runs, folder)
    if len(stack) == 1:
        raise ReadError(
            f"by its name, {own_slice.name if own_slice else stack[0].name} does not belong to the slices "
            f"{_ends(runs[0])}; choose one of those, or the folder"
        )
    why = f"not named like the {len(stack)} slices {_ends(stack)}"
    return stack, [*_notes_on_parts(stack), *left_out(images, stack, why)]


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
            "or give each a folder of its own; if all are one stack, give its slices one number that rises (0001, 0002)"
        )


def _require_none_between(images: Sequence[Path], runs: Sequence[Sequence[Path]], folder: str) -> None:
    """Refuse to leave out several pictures that seem to lie between the slices of the longest run.

    They have letters in the slice's number, or a number that the slices skip. Runs of like size are stacks apart.

    Raises
    ------
    ReadError
        If there are more than one and than `MOST_BETWEEN` of the slices.
    """
    slices = runs[0]
    form = _form(slices)
    if form is None:
        return
    other_paths = {path for run in runs[1:] if len(run) < LIKE_SIZE * len(slices) for path in run}
    between = [path for path in images if path in other_paths and form.has_between(path)]
    if len(between) > max(1, MOST_BETWEEN * len(slices)):
        raise ReadError(
            f"{len(between)} pictures in the folder {folder} are named unlike the slices {_ends(slices)} and may lie "
            f"between them: {limited_names([path.name for path in between])}; give all slices one number that rises "
            "(0001, 0002), or take the others out of the folder"
        )


def _notes_on_parts(stack: Sequence[Path]) -> list[str]:
    """Return the note that several numbers of a name were read as one, or none."""
    if single_number(stack, NUMBER) is not None or number_in_parts(stack) is None:
        return []
    return [f"the numbers in each name were read as one that rises from {_ends(stack)}"]


def left_out(images: Sequence[Path], slices: Iterable[Path], why: str) -> list[str]:
    """Return a note that names the pictures that are not slices, or no note."""
    kept = set(slices)
    dropped_names = [path.name for path in images if path not in kept]
    pictures = f"{len(dropped_names)} picture{'s' * (len(dropped_names) > 1)}"
    return [f"{pictures} left out, {why}: {limited_names(dropped_names)}"] if dropped_names else []


def runs_by_name(images: Sequence[Path]) -> list[list[Path]]:
    """Return the pictures in runs of one pattern of names, the longest run first.

    Examples
    --------
    >>> names = ["a_1.png", "a_1 (1).png", "a_2.png", "a_spr.png"]
    >>> [[path.name for path in run] for run in runs_by_name([Path(name) for name in names])]
    [['a_1.png', 'a_2.png'], ['a_1 (1).png'], ['a_spr.png']]
    """
    groups = _grouped(images, lambda path: text_around(path, NUMBER))
    runs = sorted((run for group in groups for run in _runs_of(group)), key=len, reverse=True)
    lettered = _counted_with_letters(images, runs[0]) if runs else []
    if lettered:
        taken = set(lettered)
        rest = [[path for path in run if path not in taken] for run in runs]
        runs = sorted((run for run in (lettered, *rest) if run), key=len, reverse=True)
    return runs


def check_numbers(images: Sequence[Path]) -> None:
    """Refuse slices numbered in even steps of which some are missing: their neighbors would seem adjacent.

    Names whose numbers differ in more than one place, or in no even step, say nothing about missing slices.
    """
    numbers = numbers_in_order(images) or []
    steps = [after - before for before, after in pairwise(numbers)]
    usual = min(steps, default=0)
    gaps = [at for at, step in enumerate(steps) if step != usual]
    if usual > 0 and gaps and 2 * len(gaps) < len(steps) + 1 and not any(step % usual for step in steps):
        before, after = images[gaps[0]], images[gaps[0] + 1]
        raise ReadError(
            f"slices are missing between {before.name} and {after.name}, as the others are numbered in steps of "
            f"{float(usual):.10g}; add them, or number the slices without a gap"
        )


def step_of(slices: Sequence[Path]) -> float | None:
    """Return the step of the number from slice to slice, None where it is not the same.

    Examples
    --------
    >>> step_of([Path("s04.png"), Path("s06.png"), Path("s08.png")]), step_of([Path("a.png"), Path("b.png")])
    (2.0, None)
    """
    numbers = numbers_in_order(slices) or []
    steps = {after - before for before, after in pairwise(numbers)}
    return float(steps.pop()) if len(steps) == 1 else None


def limited_names(names: Sequence[str]) -> str:
    """Return up to three names and how many more there are.

    Examples
    --------
    >>> limited_names(["a", "b", "c", "d", "e"]), limited_names(["a", "b"])
    ('a, b, c and 2 more', 'a, b')
    """
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return ", ".join(names[:MOST_NAMES]) + more


@dataclass(frozen=True)
class _Form:
    """A pattern of slice names in which one whole number varies: the text before and after it, and the numbers."""

    before: str
    behind: str
    widths: tuple[int, int]
    numbers: frozenset[int]

    def counter(self, path: Path, digits: str) -> str | None:
        """Return the counter of a name of this form that is written in `digits`, or None."""
        name = re.escape(self.before) + f"([{digits}]+)" + re.escape(self.behind)
        match = re.fullmatch(name, path.stem.casefold())
        return match[1] if match else None

    def has_between(self, path: Path) -> bool:
        """Return whether a name has letters in a counter as wide, or a number that is missing among the slices'."""
        least, most = self.widths
        if least <= len(self.counter(path, "0-9a-z") or "") <= most:
            return True
        match = re.search(re.escape(self.before) + f"({WHOLE})", path.stem.casefold())
        number = int(match[1]) if match else -1
        return min(self.numbers) < number < max(self.numbers) and number not in self.numbers


def _form(run: Sequence[Path]) -> _Form | None:
    """Return the form of names with exactly one whole number that varies."""
    if len({text_around(path, WHOLE) for path in run}) > 1:
        return None
    columns = columns_of(run, WHOLE)
    at = varying(columns)
    if len(at) != 1:
        return None
    name, words = run[0].stem.casefold(), columns[at[0]]
    place = list(re.finditer(WHOLE, name))[at[0]]
    widths = sorted(map(len, words))
    numbers = frozenset(map(int, words))
    return _Form(name[: place.start()], name[place.end() :], (widths[0], widths[-1]), numbers)


def _counted_with_letters(images: Sequence[Path], run: Sequence[Path]) -> list[Path]:
    """Return the slices that count in even steps in hexadecimal or letters; `run` has those with digits only.

    Examples
    --------
    >>> digits = [Path(f"x{digit}.png") for digit in "789"]
    >>> [path.stem for path in _counted_with_letters([*digits, Path("xa.png"), Path("x.png")], digits)]
    ['x7', 'x8', 'x9', 'xa']
    """
    form = _form(run)
    if form is None:
        return []
    stacks: list[list[Path]] = []
    for base, digits in LETTERS:
        values = {path: int(word, base) for path in images if (word := form.counter(path, digits))}
        slices = sorted(values, key=lambda path: values[path])
        if len(slices) > len(run) and is_even([Fraction(values[path]) for path in slices]):
            stacks.append(slices)
    return max(stacks, key=len, default=[])


def _runs_of(group: list[Path]) -> list[list[Path]]:
    """Split names with the same text around their numbers into runs; one run if a single number rises."""
    alike = _grouped(group, lambda path: text_around(path, WHOLE))
    numbers = single_number(group, NUMBER)
    if numbers is not None:
        order = sorted(range(len(group)), key=lambda at: numbers[at])
        rises = is_nearly_even if len(alike) == 1 else is_even
        if rises([numbers[at] for at in order]):
            return [[group[at] for at in order]]
    return [part for run in alike for part in _counted_apart(run)]


def _counted_apart(run: list[Path]) -> list[list[Path]]:
    """Split names with two numbers in which one counts from the same start for each value of the other.

    'scan1_01', 'scan1_02', 'scan2_01', 'scan2_02' are two stacks. Dates, times and positions beside a number of the
    slice are another for each slice, or do not start again.
    """
    columns = [list(map(int, column)) for column in columns_of(run, WHOLE)]
    differing = [at for at, column in enumerate(columns) if len(set(column)) > 1]
    if len(differing) < 2 or number_in_parts(run) is not None:
        return [run]
    date = date_columns(run)
    counter = max(differing, key=lambda at: (at not in date, len(set(columns[at])), at))
    parts = _grouped(range(len(run)), lambda name: tuple(columns[at][name] for at in differing if at != counter))
    starts = {min(columns[counter][name] for name in part) for part in parts}
    if len(starts) > 1 or 2 * len(parts) > len(run):
        return [run]
    return [[run[name] for name in part] for part in parts]


def _grouped(items: Iterable[Item], key: Callable[[Item], Hashable]) -> list[list[Item]]:
    """Return the items of each key, in their order."""
    groups: dict[Hashable, list[Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return list(groups.values())


def _ends(run: Sequence[Path]) -> str:
    return f"{run[0].name} to {run[-1].name}" if len(run) > 1 else run[0].name
