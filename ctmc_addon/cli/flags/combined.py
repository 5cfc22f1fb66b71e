# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the labels and structures that the combinations of a solid name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from ...core import AbsentLabelError
from ...core.files.file_names import file_key, printable
from ...core.solid import SolidRequest
from ...core.volume import compared_name
from .arguments import UsageError, label_choices


def combined_labels(solid: SolidRequest) -> tuple[int | str, ...]:
    """Return the labels that combinations name, each once, without structures made by other combinations.

    Examples
    --------
    >>> from ctmc_addon.core.solid import Combination, Combining
    >>> both = Combination(Combining.MERGE, "both", ("left", "2"))
    >>> combined_labels(SolidRequest(combinations=(both, Combination(Combining.SUBTRACT, "rest", ("3", "both")))))
    ('left', 2, 3)
    """
    choices: list[int | str] = []
    for each in solid.combinations:
        combined = {compared_name(second.name) for second in solid.combinations if second is not each}
        choices += [choice for name in each.of if compared_name(name) not in combined for choice in label_choices(name)]
    return tuple(dict.fromkeys(choices))


def labels_of(choices: Sequence[int | str], solid: SolidRequest) -> tuple[int | str, ...]:
    """Return the labels of choices; a combined structure, or no choice, stands for all labels of the combinations.

    Raises
    ------
    UsageError
        For a structure that a later combination takes.

    Examples
    --------
    >>> from ctmc_addon.core.solid import Combination, Combining
    >>> both = Combination(Combining.MERGE, "both", ("left", "2"))
    >>> labels_of(["both", "liver"], SolidRequest(combinations=(both,)))
    ('left', 2, 'liver')
    """
    named = combined_labels(solid)
    out: list[int | str] = []
    for choice in choices:
        makers = [
            at for at, each in enumerate(solid.combinations) if compared_name(each.name) == compared_name(str(choice))
        ]
        if not makers:
            out.append(choice)
            continue
        for later in solid.combinations[makers[-1] + 1 :]:
            if any(compared_name(name) == compared_name(str(choice)) for name in later.of):
                flag = f"--{later.how.value} {later.name}"
                raise UsageError(f"--label {choice} names a structure that {flag} takes; give --label {later.name}")
        out += named
    return tuple(dict.fromkeys(out or named))


def with_structures(solid: SolidRequest, labels: Sequence[int], names: Mapping[int, str]) -> tuple[SolidRequest, int]:
    """Return a solid whose combinations have the exact names of structures, and the number of structures left.

    A combination consumes its structures. Case, spaces and underscores of names do not matter.

    Parameters
    ----------
    solid : SolidRequest
    labels : sequence of int
        Labels to make the solid from.
    names : mapping of int to str
        Names of labels.

    Raises
    ------
    AbsentLabelError
        For a name that no structure has.
    UsageError
        For a name that several labels have, or whose structure an earlier combination has taken.

    Examples
    --------
    >>> from ctmc_addon.core.solid import Combination, Combining
    >>> both = Combination(Combining.MERGE, "both", ("LEFT_leg", "2"))
    >>> solid, count = with_structures(SolidRequest(combinations=(both,)), [1, 2, 3], {1: "left leg", 2: "right leg"})
    >>> solid.combinations[0].of, count
    (('left leg', 'right leg'), 2)
    """
    named = [printable(names.get(label, "")) for label in labels]
    alike = Counter(map(file_key, named))
    called = [
        name if name and alike[file_key(name)] == 1 else str(label) for label, name in zip(labels, named, strict=True)
    ]
    names_of: dict[str, list[str]] = {}
    for label, name, own in zip(labels, named, called, strict=True):
        for word in {str(label), compared_name(name) or str(label)}:
            names_of.setdefault(word, []).append(own)
    left = dict.fromkeys(called)
    combinations = []
    for number, each in enumerate(solid.combinations):
        flag = f"--{each.how.value} {each.name}"
        later = {
            compared_name(following.name): f"--{following.how.value} {following.name}"
            for following in solid.combinations[number + 1 :]
        }
        of = [_structure_of(name, flag, names_of, left, later) for name in each.of]
        for name in of:
            left.pop(name, None)
        names_of[compared_name(each.name)] = [each.name]
        left[each.name] = None
        combinations.append(replace(each, of=tuple(of)))
    return replace(solid, combinations=tuple(combinations)), len(left)


def _structure_of(
    name: str, flag: str, names_of: Mapping[str, Sequence[str]], left: Mapping[str, None], later: Mapping[str, str]
) -> str:
    """Return the exact name of a structure in a combination; `later` holds the flags of combinations after it."""
    matches = names_of.get(compared_name(name), ())
    if not matches and compared_name(name) in later:
        raise UsageError(
            f"{flag} names {name!r}, which {later[compared_name(name)]} makes after it; give that one first"
        )
    if not matches:
        raise AbsentLabelError(
            f"{flag} names {name!r}, but the structures are {', '.join(left)}; add it with --label if the file "
            "has it, or leave out --label to take those that are combined"
        )
    if len(matches) > 1:
        raise UsageError(f"{flag} names {name!r}, the name of labels {' and '.join(matches)}; give a number")
    if matches[0] not in left:
        raise UsageError(f"{flag} names {name!r}, which an earlier combination has taken; combine {', '.join(left)}")
    return matches[0]
