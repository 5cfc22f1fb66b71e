# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the flags for maps from the list of quantities, and open the files that they name."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from ... import readers
from ...core import Budget, Steps, TriangleMesh, Volume, defaults, descriptions
from ...core.files.input_files import add_inputs
from ...core.maps import QUANTITIES, RAMPS, Limits, MapRequest, Quantity
from .arguments import UsageError
from .described import add_flag, given

NO_LIMIT = "none"
KINDS = {kind.flag: kind for kind in QUANTITIES}


@dataclass(frozen=True)
class AskedMaps:
    """The maps requested by flags or a manifest, as plain data.

    Parameters
    ----------
    quantities : tuple of (flag, text)
        In the given order; the text is empty for a flag without a value.
    options : mapping
        Options of quantities, by name.
    limits : tuple of (name, low, high)
        None for no limit.
    shown : str
    range : (low, high) float, optional
    ramp : str, optional
    """

    quantities: tuple[tuple[str, str], ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    limits: tuple[tuple[str, float | None, float | None], ...] = ()
    shown: str = ""
    range: tuple[float, float] | None = None
    ramp: str | None = None

    def __bool__(self) -> bool:
        """Whether any map is requested."""
        return bool(self.quantities)

    def of_case(self, own: AskedMaps) -> AskedMaps:
        """Return these maps with those of a case, whose options and limits win."""
        names = {name for name, _, _ in own.limits}
        limits = (*(limit for limit in self.limits if limit[0] not in names), *own.limits)
        options = {**self.options, **own.options}
        return replace(self, quantities=(*self.quantities, *own.quantities), options=options, limits=limits)

    def in_folder(self, folder: Path) -> AskedMaps:
        """Return the same maps with absolute paths; relative ones begin at the folder."""
        return replace(self, quantities=tuple((flag, _in_folder(flag, text, folder)) for flag, text in self.quantities))

    def named(self) -> dict[str, Any]:
        """Return plain data with the names of files instead of their paths."""
        quantities = [[flag, _in_folder(flag, text, None)] for flag, text in self.quantities]
        return {**self.plain(), "quantities": quantities}

    def state_of_files(self) -> list[list[Any]]:
        """Return the name, bytes and time of every named file, to detect changes."""
        state: list[list[Any]] = []
        for flag, text in self.quantities:
            path = Path(_parts_of(flag, text)[1] or ".")
            if path.is_absolute() and path.exists():
                files = sorted(readers.files_below(path)) if path.is_dir() else [path]
                stats = [file.stat() for file in files]
                latest = max((stat.st_mtime_ns for stat in stats), default=0)
                state.append([path.name, sum(stat.st_size for stat in stats), latest])
        return state

    def plain(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return asdict(self)

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> AskedMaps:
        """Return the maps from the data of `plain`."""
        pairs = tuple((flag, text) for flag, text in plain["quantities"])
        limits = tuple((name, low, high) for name, low, high in plain["limits"])
        between = None if plain["range"] is None else (plain["range"][0], plain["range"][1])
        return cls(**{**plain, "quantities": pairs, "limits": limits, "range": between})

    def request_steps(self, volume: Volume, budget: Budget) -> Steps[MapRequest]:
        """Open the files that quantities name, and return the request.

        Raises
        ------
        CtmcError
            For a file that cannot be read, or a name that no structure or map has.
        """
        inputs = _MapInputs(volume, budget, readers.open_volume_steps)
        quantities: list[Quantity] = []
        for flag, text in self.quantities:
            kind = KINDS[flag]
            names = descriptions(kind.options) if kind.options else ()
            options = {name: value for name, value in self.options.items() if name in names}
            quantities.append((yield from kind.from_text_steps(text, inputs, options)))
        limits = {
            name: Limits(-math.inf if low is None else low, math.inf if high is None else high)
            for name, low, high in self.limits
        }
        return MapRequest(tuple(quantities), limits, self.shown, self.range, self.ramp)


NO_MAPS = AskedMaps()


def _in_folder(flag: str, text: str, folder: Path | None) -> str:
    """Return the text of a quantity with the absolute path of its file, or with its name if `folder` is None."""
    name, path = _parts_of(flag, text)
    if not path:
        return text
    if folder is None:
        return f"{name}{Path(path).name}"
    located = folder / path
    if not name and not located.suffix and len(Path(path).parts) == 1:  # a structure, even beside a folder of its name
        return text
    return f"{name}{located.absolute()}" if located.exists() else text


def _parts_of(flag: str, text: str) -> tuple[str, str]:
    """Split the text of a quantity into prefix and path: 'dose=' and 'a.nii'; the path is empty without a file."""
    name, equals, path = text.partition("=") if KINDS[flag].metavar.startswith("NAME=") else ("", "", text)
    return name + equals, path.strip()


class _AddQuantity(argparse.Action):
    """Store the flags of quantities in the order in which they were given."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: Any = None) -> None:
        """Store a flag and its value."""
        flag = str(self.option_strings[0]).removeprefix("--")
        text = values if isinstance(values, str) else ""
        namespace.maps = [*(namespace.maps or ()), (flag, text)]


def add_maps(parser: argparse.ArgumentParser, *, shown: bool = True, without: Sequence[str] = ()) -> None:
    """Add the flags for maps.

    Parameters
    ----------
    parser : ArgumentParser
    shown : bool
        Whether the command shows a map in colors.
    without : sequence of str
        Flags of quantities that the command uses for something else.
    """
    repeated = "--paint, --distance-to and --map-limit may be repeated"
    group = parser.add_argument_group("maps", f"Values on the vertices of every surface; {repeated}")
    parser.set_defaults(maps=None)
    options = []
    for kind in QUANTITIES:
        if kind.flag in without:
            continue
        words: dict[str, Any] = {"metavar": kind.metavar} if kind.metavar else {"nargs": 0}
        text = kind.text.replace("%", "%%")
        group.add_argument(f"--{kind.flag}", dest="maps", action=_AddQuantity, help=text, **words)
        if kind.options is not None and kind.options not in options:
            options.append(kind.options)
            for name, about in descriptions(kind.options).items():
                add_flag(group, name, about, defaults(kind.options)[name])
    group.add_argument(
        "--map-limit",
        nargs=3,
        action="append",
        default=[],
        metavar=("NAME", "LOW", "HIGH"),
        help=f"measure the shares of the area below LOW and above HIGH of a map, such as thickness_mm 1 {NO_LIMIT}",
    )
    if shown:
        group.add_argument("--show", metavar="NAME", default="", help="map whose colors are shown (default: the first)")
        group.add_argument(
            "--range",
            nargs=2,
            type=float,
            metavar=("LOW", "HIGH"),
            help="values of the first and the last color of that map",
        )
        group.add_argument(
            "--ramp", choices=tuple(RAMPS), help="color ramp of that map (default: that of the quantity)"
        )


def asked_maps(args: argparse.Namespace, manifest: bool = False) -> AskedMaps:
    """Return the maps requested by flags; the rows of a manifest may request more.

    Raises
    ------
    UsageError
        For a limit that is not a number, or limits and colors without a map.
    """
    quantities = tuple(args.maps or ())
    options = {name: value for kind in QUANTITIES if kind.options for name, value in given(args, kind.options).items()}
    limits = tuple((name, _limit(low), _limit(high)) for name, low, high in args.map_limit)
    shown, between, ramp = (getattr(args, name, None) for name in ("show", "range", "ramp"))
    if (
        not quantities
        and not manifest
        and (limits or options or shown or between or ramp or getattr(args, "map_table", None))
    ):
        flags = ", ".join(f"--{kind.flag}" for kind in QUANTITIES)
        raise UsageError(f"limits, colors and a table of a map need a map; add one of {flags}")
    return AskedMaps(quantities, options, limits, shown or "", tuple(between) if between else None, ramp)


def limit_of(text: str) -> tuple[str, float | None, float | None]:
    """Return the limit in a cell of a manifest, such as 'thickness_mm 1 none'.

    Raises
    ------
    UsageError
        If it is not a name with two numbers.
    """
    words = text.split()
    if len(words) != 3:
        raise UsageError(f"a limit is a name and two numbers, such as thickness_mm 1 {NO_LIMIT}, not {text!r}")
    return words[0], _limit(words[1]), _limit(words[2])


def _limit(text: str) -> float | None:
    if text.lower() == NO_LIMIT:
        return None
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if math.isnan(number):
        raise UsageError(f"--map-limit takes a name and two numbers or {NO_LIMIT}, not {text!r}")
    return number


class _MapInputs(readers.MapFiles):
    """The files that quantities name; outputs must not replace them."""

    def volume_steps(self, path: str) -> Steps[Volume]:
        """Read a volume."""
        add_inputs([Path(path)])
        return (yield from super().volume_steps(path))

    def surface_steps(self, path: str) -> Steps[TriangleMesh]:
        """Return the surface of a file or of a label volume, RAS+ mm."""
        add_inputs([Path(path)])
        return (yield from super().surface_steps(path))
