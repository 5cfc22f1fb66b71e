# SPDX-License-Identifier: GPL-3.0-or-later
"""Make flags from the settings and from the options for reading INPUT."""

from __future__ import annotations

import argparse
import difflib
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from ... import readers
from ...core import (
    EXCLUSIVE,
    SETTINGS,
    CtmcError,
    ReconstructionSettings,
    SettingsError,
    defaults,
    descriptions,
    has_width,
)
from ...core.files.input_files import add_inputs
from ...core.volume import ALL
from ...reporting.command_line import command_of as command_of, flag_of as flag_of
from ...reporting.formatting import capitalized
from ...reporting.settings_toml import from_toml
from .described import Numbers, add_flag, add_labels_flag, given, is_number, value_reader

TABLES = ("reading", "figure")
"""The tables of a settings file: how INPUT is read, and how a figure looks."""


class UsageError(CtmcError):
    """Flags that are wrong for any input: exit code 2."""


class _Help(argparse.HelpFormatter):
    """Begin the text of every flag with a capital, as texts of settings do."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        text = super()._get_help_string(action)
        return capitalized(text) if text and re.match(r"(?!mm )[a-z]+,? ", text) else text


class Parser(argparse.ArgumentParser):
    """A parser in which INPUT may follow a flag with several numbers, and whose first word may name a command below.

    `figure` has flags and an INPUT of its own, and two commands below it, which `add_subparsers` does not allow. What
    begins as a negative number is a value and not a flag, -1e1 too, as in Python 3.14; whoever reads it refuses -40,5.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **{"allow_abbrev": False, "formatter_class": _Help, **options})
        self._negative_number_matcher = re.compile(r"-\.?\d")
        self.commands: dict[str, Parser] = {}
        self.set_defaults(parser=self)

    def add_command(self, name: str, description: str) -> Parser:
        """Return the parser of a command below this one."""
        self.commands[name] = Parser(prog=f"{self.prog} {name}", description=description)
        return self.commands[name]

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Parse as `argparse` does; the first word may name a command."""
        words = list(sys.argv[1:] if args is None else args)
        if words and words[0] in self.commands:
            return self.commands[words[0]].parse_known_args(words[1:], namespace)
        return super().parse_known_args(list(self.values_joined(words)), namespace)

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse as `argparse` does; refuse unknown arguments with a suggestion if there is one."""
        parsed, rest = self.parse_known_args(args, namespace)
        if rest:
            parser: Parser = parsed.parser
            near = difflib.get_close_matches(rest[0], parser._option_string_actions, 1) if rest[0][0] == "-" else []
            remedy = f"; did you mean {near[0]}?" if near else ""
            if rest[0][0] != "-" and isinstance(getattr(parsed, "label", None), list):
                remedy = "; separate label names by commas, and quote names with spaces"
            self.error(f"unrecognized arguments: {' '.join(rest)}{remedy}")
        return parsed

    def values_joined(self, words: Sequence[str]) -> Iterator[str]:
        """Turn `--stride 2 2 1 INPUT` into `--stride=2 2 1 INPUT`: a word that is not a number ends the flag."""
        at = 0
        while at < len(words):
            flag = words[at]
            action = self._option_string_actions.get(flag)
            at += 1
            if not isinstance(action, Numbers):
                yield flag
                continue
            end = at
            while end < min(len(words), at + action.most) and is_number(words[end]):
                end += 1
            yield f"{flag}={' '.join(words[at:end])}" if end > at else flag
            at = end


def add_settings(parser: argparse.ArgumentParser, many: Sequence[str] = ()) -> None:
    """Add a flag for every field of `ReconstructionSettings`, and --settings for a file of them.

    Only flags that are given reach the namespace; those of the settings in `many` take several values, as a list.
    """
    group = parser.add_argument_group("settings")
    group.add_argument(
        "--settings",
        metavar="FILE.toml",
        help="settings file to start from, as `ctmc settings` writes it; flags take precedence",
    )
    groups = {}
    for names in EXCLUSIVE:
        groups.update(dict.fromkeys(names, group.add_mutually_exclusive_group()))
    own = defaults(ReconstructionSettings)
    for name, about in SETTINGS.items():
        if name in many:
            add_labels_flag(groups.get(name, group), name, about, own[name], label_choices)
        else:
            add_flag(groups.get(name, group), name, about, own[name])
    width = SETTINGS["smoothing_mm"]  # --soften is its name in older scripts
    reader = value_reader("smoothing_mm", width)
    group.add_argument("--soften", dest="smoothing_mm", type=reader, default=argparse.SUPPRESS, help=argparse.SUPPRESS)


def label_choices(text: str) -> list[int | str]:
    """Read labels by number or name, separated by commas; numbers also by spaces.

    Examples
    --------
    >>> label_choices("1 2, kidney left;7"), label_choices("all")
    ([1, 2, 'kidney left', 7], ['all'])
    """
    choices: list[int | str] = []
    for piece in text.replace(";", ",").split(","):
        words = piece.split()
        names = [word for word in words if not re.fullmatch(r"[-+]?[0-9]{1,18}", word)]
        if words and not names:
            choices += [int(word) for word in words]
        elif words and not is_number(words[0]):
            choices.append(ALL if piece.strip().lower() == ALL else " ".join(words))
        elif words:
            raise argparse.ArgumentTypeError(f"write a whole number, a name, or all, not {names[0]!r}")
    if not choices:
        raise argparse.ArgumentTypeError("write a label's number or name, or all")
    return choices


def at_least(low: int) -> Callable[[str], int]:
    """Return a function that reads a whole number which is not below `low`.

    Parameters
    ----------
    low : int
    """

    def read(text: str) -> int:
        try:
            number = int(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError("write a whole number") from error
        if number < low:
            raise argparse.ArgumentTypeError(f"must be {low} or more, not {number}")
        return number

    return read


@contextmanager
def flags_checked() -> Iterator[None]:
    """Turn errors of settings in the block into `UsageError`."""
    try:
        yield
    except SettingsError as error:
        raise UsageError(str(error)) from error


def settings_from(args: argparse.Namespace) -> ReconstructionSettings:
    """Return the settings of the flags and of the file of --settings, for a command that makes one surface."""
    settings, choices = settings_and_labels(args)
    if len(choices) > 1 or any(isinstance(choice, str) for choice in choices):
        raise UsageError(f"this command takes one label by its number, not {', '.join(map(str, choices))}")
    return settings


def settings_and_labels(
    args: argparse.Namespace,
    labels_of: Callable[[tuple[int | str, ...]], tuple[int | str, ...]] = lambda choices: choices,
) -> tuple[ReconstructionSettings, tuple[int | str, ...]]:
    """Return the settings of flags and file, and the labels they choose; the settings have one of these, or any.

    `labels_of` chosen ones are taken, which may be others where something else names labels.
    """
    values = given_settings(args)
    choices = labels_of(choices_of(values))
    with flags_checked():
        return ReconstructionSettings(**values | {"label": label_for_checks(choices)}), choices


def choices_of(values: Mapping[str, Any]) -> tuple[int | str, ...]:
    """Return the labels that settings choose, each once.

    Parameters
    ----------
    values : mapping of str to Any
        Settings by name.

    Returns
    -------
    tuple of int, label name or 'all'
    """
    label = values.get("label")
    return () if label is None else tuple(dict.fromkeys(label if isinstance(label, (list, tuple)) else (label,)))


def label_for_checks(choices: Sequence[int | str]) -> int | None:
    """Return the label of settings whose own is not known yet: the first number, else 1; None without choices."""
    return next((choice for choice in choices if isinstance(choice, int)), 1) if choices else None


def kinds_of(table: str) -> tuple[type, ...]:
    """Return the classes whose fields a table of a settings file may have."""
    if table == "reading":
        return (readers.ReadingOptions,)
    from ...blender.figure.spec import FIGURE_SETTINGS  # takes as long to import as a small label to read

    return FIGURE_SETTINGS


def tables() -> dict[str, tuple[type, ...]]:
    """Return the classes of every table of a settings file."""
    return {table: kinds_of(table) for table in TABLES}


def given_settings(args: argparse.Namespace) -> dict[str, Any]:
    """Return the settings that the file of --settings and the flags give, by name; flags win."""
    file = {name: value for name, value in _file_of(args).items() if name not in TABLES}
    return overridden(file, given(args, ReconstructionSettings))


def _file_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the content of the file of --settings, its tables as dictionaries; empty without one."""
    path = getattr(args, "settings", None)
    return read_settings(path) if path else {}


def overridden(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings of which `above` wins; a setting also replaces its alternatives.

    Parameters
    ----------
    below : mapping of str to Any
    above : mapping of str to Any

    Examples
    --------
    >>> overridden({"threshold": 200.0, "alpha": 0.5}, {"label": 2})
    {'alpha': 0.5, 'label': 2}
    """
    replaced = {name for names in EXCLUSIVE if set(names) & set(above) for name in names}
    if "smoothing" in above and not has_width(above["smoothing"]):
        replaced.add("smoothing_mm")
    elif "smoothing_mm" in above:
        replaced.add("smoothing")
    return {name: value for name, value in below.items() if name not in replaced} | dict(above)


def read_settings(path: str) -> dict[str, Any]:
    """Return the settings in a TOML file; PowerShell's `>` writes it in UTF-16, which is read too."""
    file = Path(path)
    add_inputs([file])
    try:
        content = file.read_bytes()
        utf16 = content[:2] in (b"\xff\xfe", b"\xfe\xff")
        text = content.decode("utf-16" if utf16 else "utf-8-sig")
    except OSError as error:
        raise SettingsError(f"the settings file {path} cannot be read: {error.strerror}; check the path") from error
    except UnicodeDecodeError as error:
        raise SettingsError(f"{file.name} is not text; `ctmc settings` writes one to start from") from error
    return from_toml(text, file.name, tables())


def with_flags(sentence: str) -> str:
    """Return the sentence with settings called by their flags, where these are other words than their names.

    The flags of `ctmc segment` alone come from no dataclass.

    Examples
    --------
    >>> with_flags("NaN voxels; set nan_as")
    'NaN voxels; set --nan-as'
    """
    sentence = re.sub(r"\b(hu|max|opening)(_per)?_mm\b", lambda name: f"--{name[0].replace('_', '-')}", sentence)
    sentence = _with_flags_of((ReconstructionSettings, *kinds_of("reading")), sentence)
    # A figure's setting whose name differs from its flag has an underscore in it.
    return _with_flags_of(kinds_of("figure"), sentence) if "_" in sentence else sentence


def _with_flags_of(kinds: Sequence[type], sentence: str) -> str:
    for name, about in {name: about for kind in kinds for name, about in descriptions(kind).items()}.items():
        if flag_of(name, about) != f"--{name}":
            sentence = re.sub(rf"\b{name}\b", flag_of(name, about), sentence)
    return sentence


def add_input(parser: argparse.ArgumentParser, all_times: bool = False) -> None:
    """Add INPUT and the flags for reading it; `all_times` allows --time all."""
    parser.add_argument(
        "input",
        metavar="INPUT",
        help="folder of slices or of masks, DICOM, its segmentation (SEG) or structure set (RTSTRUCT), or a volume "
        f"({', '.join(readers.VOLUME_SUFFIXES + readers.PAGE_SUFFIXES + readers.FOLDER_SUFFIXES)})",
    )
    add_reading(parser, all_times)


def add_reading(parser: argparse.ArgumentParser, all_times: bool = False, names: bool = True) -> None:
    """Add a flag for every field of `ReadingOptions`; `all_times` allows --time all, and batches name their cases."""
    group = parser.add_argument_group("reading")
    for name, about in descriptions(readers.ReadingOptions).items():
        if name == "name" and not names:
            continue
        if name == "time" and all_times:
            several = replace(about, text=f"{about.text}, or all for one surface per time")
            add_flag(group, name, several, None, _time_or_all)
        else:
            add_flag(group, name, about, defaults(readers.ReadingOptions)[name])


def add_work(parser: Any) -> None:
    """Add the flags for the number of threads and for what is printed."""
    add_quiet(parser)
    parser.add_argument(
        "--threads", type=at_least(1), metavar="N", help="threads (default: one per processor, at most 8)"
    )


def add_quiet(parser: Any) -> None:
    """Add the flag for printing errors only."""
    parser.add_argument("--quiet", action="store_true", help="print errors only")


def reading_of(args: argparse.Namespace) -> readers.ReadingOptions:
    """Return the reading options of the flags and of `[reading]` in --settings; without a time if all are read."""
    values = given_table(args, "reading")
    with flags_checked():
        return readers.ReadingOptions(**values | ({"time": None} if asks_all_times(args) else {}))


def given_table(args: argparse.Namespace, table: str) -> dict[str, Any]:
    """Return the values of a table's fields that the file of --settings and the flags give, by name; flags win."""
    flags = {name: value for kind in kinds_of(table) for name, value in given(args, kind).items()}
    return _file_of(args).get(table, {}) | flags


def asks_all_times(args: argparse.Namespace) -> bool:
    """Return whether a surface of each time is asked for."""
    return getattr(args, "time", None) == ALL


def add_opacity(group: Any, dest: str, note: str) -> None:
    """Add the flag for the opacity of structures, with a note of what those have that it does not name."""
    group.add_argument(
        "--opacity",
        dest=dest,
        nargs="+",
        action="extend",
        type=_opacity_choice,
        default=[],
        metavar="NAME=SHARE",
        help=f"opacity of structures from 0 to 1, by name, label number or all: liver=0.35 bone=0.15 ({note})",
    )


def _opacity_choice(text: str) -> tuple[int | str, float]:
    """Return the label's number or name, and the opacity, of NAME=SHARE; a label without a name is 'label 7' or 7.

    Examples
    --------
    >>> _opacity_choice("liver=0.35"), _opacity_choice("7=1"), _opacity_choice("label 7=1"), _opacity_choice("left=.5")
    (('liver', 0.35), (7, 1.0), (7, 1.0), ('left', 0.5))
    """
    name, equals, share = (part.strip() for part in text.rpartition("="))
    try:
        opacity = float(share)
    except ValueError:
        opacity = math.nan
    if not equals or not name or not 0.0 <= opacity <= 1.0:
        raise argparse.ArgumentTypeError(f"write NAME=SHARE with a share from 0 to 1, such as liver=0.35, not {text}")
    if number := re.fullmatch(r"(?:label[ _])?([-+]?[0-9]{1,18})", name.casefold()):
        return int(number[1]), opacity
    return (ALL if name.lower() == ALL else name), opacity


def _time_or_all(text: str) -> int | str:
    """Return a time from 1 on, or all of them."""
    return ALL if text.strip().lower() == ALL else at_least(1)(text)
