# SPDX-License-Identifier: GPL-3.0-or-later
"""Flags for solids, and the columns of a manifest that say the same for one case."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ...core import OutputError, ReconstructionSettings, SettingsError, defaults, descriptions
from ...core.files.mesh_files import SUFFIXES
from ...core.solid import Combination, Combining, Cut, Drain, Pegs, SolidRequest, auto_diameter
from .arguments import UsageError, flags_checked, given_settings, settings_and_labels
from .combined import labels_of
from .described import Numbers, add_flag, given, is_number, separated, value_reader

Values = Mapping[str, Any]
"""Values of flags or of a manifest's cells, by the names of the flags with underscores."""

AUTO = "auto"
NONE = "none"
BETWEEN = "|"
NOTHING = SolidRequest()
DESCRIBED = descriptions(SolidRequest)
FIRST = ("thicken", "hollow")
"""Described flags that the help has before those of drains, cuts and combinations."""
COMBINING = {how.value: how for how in Combining}
COMBINING_TEXTS = {
    "merge": "make one structure of several, such as legs=left,right",
    "subtract": "make a structure of the first without the others, such as rest=bone,implant",
    "intersect": "make a structure of what all have in common, such as overlap=tumor,vessel",
}
REPEATED = ("drain", "cut", *COMBINING)


def add_solid(parser: argparse.ArgumentParser) -> None:
    """Add the flags for solids."""
    repeated = ", ".join(f"--{name}" for name in REPEATED)
    group = parser.add_argument_group("solid", f"Parts for 3D print, in RAS+ mm; {repeated} may be repeated")
    own = defaults(SolidRequest)
    for name in FIRST:
        add_flag(group, name, DESCRIBED[name], own[name])
    _add_numbers(
        group,
        "drain",
        4,
        _drains,
        f"X Y Z MM|{AUTO}",
        "round hole of this diameter from a point straight out through the nearest wall; "
        f"{AUTO} opens a hollow at its lowest and its highest point",
    )
    _add_numbers(
        group,
        "cut",
        6,
        _cuts,
        "X Y Z NX NY NZ",
        "cut in two at the plane through a point; part a is on the side that the normal points to, b on the other, and "
        "further cuts make c, d and so on",
    )
    pegs = Pegs(1)
    group.add_argument(
        "--pegs",
        type=_peg_count,
        default=argparse.SUPPRESS,
        metavar="N",
        help="pegs on part a at each cut, and holes for them in part b (default 0)",
    )
    _add_numbers(
        group,
        "peg_mm",
        2,
        _peg_mm,
        "D LENGTH",
        f"diameter and length of a peg (mm; default {pegs.diameter:g} {pegs.length:g})",
    )
    group.add_argument(
        "--clearance",
        type=_clearance,
        default=argparse.SUPPRESS,
        metavar="MM",
        help=f"gap between a peg and its hole (mm; default {pegs.clearance:g})",
    )
    for name, text in COMBINING_TEXTS.items():
        group.add_argument(
            f"--{name}",
            dest=name,
            action=_AddCombination,
            type=_reader_of(COMBINING[name]),
            default=argparse.SUPPRESS,
            metavar="NAME=A,B" if name != "merge" else "NAME=A,B,...",
            help=f"{text}; labels by name or number",
        )
    for name in DESCRIBED:
        if name not in FIRST:
            add_flag(group, name, DESCRIBED[name], own[name])


def asked_solid(args: argparse.Namespace) -> SolidRequest:
    """Return the solid of the flags.

    Raises
    ------
    UsageError
        For flags that cannot make a solid.
    """
    with flags_checked():
        return solid_of(given_solid(args))


def given_solid(args: argparse.Namespace) -> dict[str, Any]:
    """Return the values of the given flags by name."""
    flags = vars(args)
    own = ("drain", "cut", "pegs", "peg_mm", "clearance", "combinations")
    return {**given(args, SolidRequest), **{name: flags[name] for name in own if name in flags}}


def solid_of(values: Values) -> SolidRequest:
    """Return the solid from values of flags or cells.

    Raises
    ------
    SettingsError
        For values that cannot make a solid.
    """
    scalars = {name: value for name, value in values.items() if name in DESCRIBED}
    diameter = auto_diameter(values.get("hollow", 0.0))
    drains = (Drain(diameter) if drain is None else drain for drain in values.get("drain", ()))
    return SolidRequest(
        drains=tuple(drains),
        cuts=tuple(values.get("cut", ())),
        pegs=_pegs_of(values),
        combinations=tuple(values.get("combinations", ())),
        **scalars,
    )


def overridden_solid(common: Values, own: Values) -> dict[str, Any]:
    """Return the values of flags for all cases, replaced by those of a case's cells, column by column."""
    merged = {**common, **own}
    if "combinations" in own:
        ways = own["combinations"]
        kept = [each for each in common.get("combinations", ()) if each.how.value not in ways]
        merged["combinations"] = [*kept, *(each for way in ways.values() for each in way)]
    return merged


def settings_labels_and_solid(
    args: argparse.Namespace,
) -> tuple[ReconstructionSettings, tuple[int | str, ...], SolidRequest]:
    """Return the settings, the selected labels, and the solid; without labels, those that the solid combines.

    Raises
    ------
    UsageError
        For flags that exclude each other.
    """
    solid = asked_solid(args)
    if solid.combinations and given_settings(args).get("threshold") is not None:
        how = solid.combinations[0].how.value
        raise UsageError(f"--{how} combines labels, and a threshold has a single structure; leave out --threshold")
    settings, choices = settings_and_labels(args, lambda given: labels_of(given, solid))
    require_built_in(solid, settings)
    return settings, choices, solid


def require_built_in(solid: SolidRequest, settings: ReconstructionSettings) -> None:
    """Raise `UsageError` if Blender would simplify a solid, which moves cuts and pegs after walls are measured."""
    if solid != NOTHING and settings.simplifies and settings.simplifier == "decimate":
        raise UsageError("solids are simplified by the built-in simplifier; leave out --simplifier decimate")


def may_have_parts(solid: SolidRequest) -> bool:
    """Return whether a structure may become several parts."""
    return bool(solid.cuts)


def require_room_for_parts(solid: SolidRequest, output: str) -> None:
    """Raise `OutputError` if the parts of a cut would go to a file that holds one surface."""
    path = Path(output)
    if solid.cuts and path.suffix.lower() in SUFFIXES:
        raise OutputError(
            f"{path.name} can hold one surface, and a cut makes two parts; give a folder, such as -o {path.stem}/, "
            "or a .glb, .obj, .3mf, .html or .blend"
        )


def _pegs_of(values: Values) -> Pegs | None:
    count = values.get("pegs", 0)
    sizes = [f"--{name.replace('_', '-')}" for name in ("peg_mm", "clearance") if name in values]
    if not count:
        if sizes and "pegs" not in values:
            raise SettingsError(f"{' and '.join(sizes)} describe pegs; add --pegs with their number")
        return None
    own = Pegs(count)
    diameter, length = values.get("peg_mm", (own.diameter, own.length))
    return Pegs(count, diameter, length, values.get("clearance", own.clearance))


class _AddCombination(argparse.Action):
    """Store combinations in the order in which they were given."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: Any = None) -> None:
        """Store a combination."""
        namespace.combinations = [*getattr(namespace, "combinations", ()), values]


def _add_numbers(group: Any, name: str, most: int, reader: Callable[[str], Any], metavar: str, text: str) -> None:
    flag = f"--{name.replace('_', '-')}"
    options = {"dest": name, "default": argparse.SUPPRESS, "metavar": metavar, "type": reader, "help": text}
    group.add_argument(flag, action=Numbers, most=most, **options)


def _numbers(text: str, count: int, what: str) -> list[float]:
    """Return the numbers in a text; a cell of a manifest may separate them by commas."""
    words = separated(text)
    if len(words) != count or not all(map(is_number, words)):
        raise argparse.ArgumentTypeError(f"write {what}, not {text!r}")
    return list(map(float, words))


def _checked(kind: Callable[..., Any], *values: Any) -> Any:
    try:
        return kind(*values)
    except SettingsError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _drains(text: str) -> list[Drain | None]:
    if text.strip().lower() == AUTO:
        return [None]
    x, y, z, diameter = _numbers(text, 4, f"X Y Z and a diameter, such as 0 0 -40 4, or {AUTO}")
    return [_checked(Drain, diameter, (x, y, z))]


def _cuts(text: str) -> list[Cut]:
    numbers = _numbers(text, 6, "X Y Z of a point and NX NY NZ of a normal, such as 0 0 -40 0 0 1")
    return [_checked(Cut, tuple(numbers[:3]), tuple(numbers[3:]))]


def _peg_count(text: str) -> int:
    try:
        count = int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"write a whole number, not {text!r}") from error
    if count:
        _checked(Pegs, count)
    return count


def _peg_mm(text: str) -> tuple[float, float]:
    diameter, length = _numbers(text, 2, "a diameter and a length, such as 5 5")
    _checked(Pegs, 1, diameter, length)
    return diameter, length


def _clearance(text: str) -> float:
    [gap] = _numbers(text, 1, "a gap in mm, such as 0.2")
    _checked(lambda: Pegs(1, clearance=gap))
    return gap


def _reader_of(how: Combining) -> Callable[[str], Combination]:
    def read(text: str) -> Combination:
        name, equals, names = text.partition("=")
        of = tuple(" ".join(each.split()) for each in names.replace(";", ",").split(","))
        if not equals:
            raise argparse.ArgumentTypeError(f"write NAME=A,B with labels by name or number, not {text!r}")
        combination: Combination = _checked(Combination, how, " ".join(name.split()), of)
        return combination

    return read


def _several(read: Callable[[str], Any]) -> Callable[[str], list[Any]]:
    """Return a function that reads a cell with several values; 'none' removes those for all cases."""

    def read_all(cell: str) -> list[Any]:
        if cell.strip().lower() == NONE:
            return []
        out: list[Any] = []
        for piece in cell.split(BETWEEN):
            value = read(piece.strip())
            out += value if isinstance(value, list) else [value]
        return out

    return read_all


COLUMNS: dict[str, Callable[[str], Any]] = {
    **{name: value_reader(name, about) for name, about in DESCRIBED.items()},
    "drain": _several(_drains),
    "cut": _several(_cuts),
    "pegs": _peg_count,
    "peg_mm": _peg_mm,
    "clearance": _clearance,
    **{name: _several(_reader_of(how)) for name, how in COMBINING.items()},
}
"""Functions that read the cells of a manifest's columns."""


def cells_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the cells of a row for `overridden_solid`, with combinations by their kind."""
    ways = {name: cell for name, cell in values.items() if name in COMBINING}
    return {name: cell for name, cell in values.items() if name not in ways} | ({"combinations": ways} if ways else {})
