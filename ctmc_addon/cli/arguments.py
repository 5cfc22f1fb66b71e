# SPDX-License-Identifier: GPL-3.0-or-later
"""Flags made from the settings, and the flags that say how INPUT is read."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .. import readers
from ..core import EXCLUSIVE, CtmcError, ReconstructionSettings, Setting, SettingsError, described
from ..core.volume import ALL
from ..reporting.command_line import command_of as command_of
from ..reporting.command_line import flag_of as flag_of
from ..reporting.settings_toml import from_toml


class UsageError(CtmcError):
    """Flags that cannot be, whatever the input: exit code 2."""


class Parser(argparse.ArgumentParser):
    """A parser in which INPUT may follow a flag with several numbers, and whose first word may name a command below.

    `figure` has flags and an INPUT of its own, and two commands below it, which `add_subparsers` does not allow.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **{"allow_abbrev": False, **options})
        self.commands: dict[str, Parser] = {}
        self.set_defaults(parser=self)

    def add_command(self, name: str, description: str) -> Parser:
        """The parser of a command below this one."""
        self.commands[name] = Parser(prog=f"{self.prog} {name}", description=description)
        return self.commands[name]

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """As in `argparse`."""
        words = list(sys.argv[1:] if args is None else args)
        if words and words[0] in self.commands:
            return self.commands[words[0]].parse_known_args(words[1:], namespace)
        return super().parse_known_args(list(self.values_joined(words)), namespace)

    def values_joined(self, words: Sequence[str]) -> Iterator[str]:
        """`--stride 2 2 1 INPUT` as `--stride=2 2 1 INPUT`: what is not a number is not the flag's."""
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


class Numbers(argparse.Action):
    """A flag with up to `most` numbers, which its type reads as one text; lists of a repeated flag are joined."""

    def __init__(self, *args: Any, most: int, **options: Any) -> None:
        super().__init__(*args, **options)
        self.most = most

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: Any = None) -> None:
        """Keep the value."""
        if isinstance(values, list):
            values = [*getattr(namespace, self.dest, []), *values]
        setattr(namespace, self.dest, values)


def add_settings(parser: argparse.ArgumentParser, many: Sequence[str] = ()) -> None:
    """A flag for every field of `ReconstructionSettings`, and --settings for a file of them.

    Only flags that are given reach the namespace; those of the settings in `many` take several values, as a list.
    """
    group = parser.add_argument_group("settings")
    group.add_argument(
        "--settings", metavar="FILE.toml", help="settings to start from, as `ctmc settings` writes them; flags win"
    )
    groups = {}
    for names in EXCLUSIVE:
        groups.update(dict.fromkeys(names, group.add_mutually_exclusive_group()))
    for name, about in described().items():
        add_setting(groups.get(name, group), name, about, name in many)
    width = described()["smoothing_mm"]  # --soften is its name in older scripts
    reader = setting_reader("smoothing_mm", width)
    group.add_argument("--soften", dest="smoothing_mm", type=reader, default=argparse.SUPPRESS, help=argparse.SUPPRESS)


def add_setting(group: Any, name: str, about: Setting, several: bool = False) -> None:
    """One setting's flag, its help made from the setting's text, unit, limits and default."""
    default = getattr(ReconstructionSettings, name)
    options: dict[str, Any] = {"dest": name, "default": argparse.SUPPRESS, "help": help_of(about, default)}
    if about.type is bool:
        options["action"] = argparse.BooleanOptionalAction
    elif about.choices:
        options["choices"] = about.choices
    else:
        options["metavar"] = "LABEL" if several else metavar_of(about)
        options["type"] = label_choices if several else setting_reader(name, about)
        if several:
            options["help"] += "; number or name, several with commas or by repeating the flag, or all"
        if several or about.size > 1:
            options.update(action=Numbers, most=sys.maxsize if several else about.size)
    group.add_argument(flag_of(name, about), **options)


def setting_reader(name: str, about: Setting) -> Callable[[str], Any]:
    """A function that reads a setting from text, such as '2 2 1', and checks its limits."""

    def read(text: str) -> Any:
        words = separated(text)
        try:
            values = tuple(about.type(word) for word in words)
        except ValueError as error:
            raise argparse.ArgumentTypeError(
                "write a whole number" if about.type is int else "write a number"
            ) from error
        if len(values) != about.size and (len(values) != 1 or about.size != 3):
            raise argparse.ArgumentTypeError(f"write {about.size} numbers with spaces between them")
        value: Any = values if len(values) > 1 else values * 3 if about.size == 3 else values[0]
        try:
            ReconstructionSettings(**{name: value})
        except SettingsError as error:
            raise argparse.ArgumentTypeError(str(error).removeprefix(f"{name} ")) from error
        return value

    return read


def label_choices(text: str) -> list[int | str]:
    """Labels by number or name, with commas between them; numbers with spaces too.

    Examples
    --------
    >>> label_choices("1 2, kidney left;7"), label_choices("all")
    ([1, 2, 'kidney left', 7], ['all'])
    """
    choices: list[int | str] = []
    for piece in text.replace(";", ",").split(","):
        words = piece.split()
        if words and all(re.fullmatch(r"[-+]?[0-9]{1,18}", word) for word in words):
            choices += [int(word) for word in words]
        elif words and not is_number(words[0]):
            choices.append(ALL if piece.strip().lower() == ALL else " ".join(words))
        elif words:
            raise argparse.ArgumentTypeError("write a whole number, a name, or all")
    if not choices:
        raise argparse.ArgumentTypeError("write a label's number or name, or all")
    return choices


def separated(text: str) -> list[str]:
    """The words of a text with spaces, commas or semicolons between them."""
    return text.replace(",", " ").replace(";", " ").split()


def at_least(low: int) -> Callable[[str], int]:
    """A function that reads a whole number which is not below `low`."""

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
    """Errors of settings in the block are those of the flags: wrong usage."""
    try:
        yield
    except SettingsError as error:
        raise UsageError(str(error)) from error


def help_of(about: Setting, default: Any) -> str:
    """Text, unit, limits and default in brackets: 'Side of ... (px; from 1 to 16; default 1 1 1)'."""
    facts = [about.unit] if about.unit else []
    if not about.choices and (about.low is not None or about.high is not None):
        facts.append(about.limits)
    if default is not None and about.type is not bool:
        values = default if isinstance(default, tuple) else (default,)
        facts.append("default " + " ".join(value if isinstance(value, str) else f"{value:g}" for value in values))
    text = about.text + (f" ({'; '.join(facts)})" if facts else "")
    return text.replace("%", "%%")


def metavar_of(about: Setting) -> str:
    """What stands for the value in the help: X Y Z, MM, N, VALUE, or the setting's label."""
    if about.size > 1:
        return "X Y Z" if about.size == 3 else "X0 Y0 Z0 X1 Y1 Z1"
    if about.unit in ("mm", "mm3"):
        return about.unit.upper()
    return "N" if about.type is int else "VALUE" if "gray value" in about.unit else about.label.upper()


def settings_from(args: argparse.Namespace) -> ReconstructionSettings:
    """The settings of the flags and of the file of --settings, for a command that makes one surface."""
    settings, choices = settings_and_labels(args)
    if len(choices) > 1 or any(isinstance(choice, str) for choice in choices):
        raise UsageError(f"label {', '.join(map(str, choices))} is not one number; this command takes one label")
    return settings


def settings_and_labels(args: argparse.Namespace) -> tuple[ReconstructionSettings, tuple[int | str, ...]]:
    """The settings of flags and file, and the labels that these choose; the settings have one of them, or any."""
    values = given_settings(args)
    choices = choices_of(values)
    with flags_checked():
        return ReconstructionSettings(**values | {"label": label_for_checks(choices)}), choices


def choices_of(values: Mapping[str, Any]) -> tuple[int | str, ...]:
    """The labels that settings choose, each once."""
    label = values.get("label")
    return () if label is None else tuple(dict.fromkeys(label if isinstance(label, (list, tuple)) else (label,)))


def label_for_checks(choices: Sequence[int | str]) -> int | None:
    """The label of settings whose own is not known yet: the first number, else 1; None without choices."""
    return next((choice for choice in choices if isinstance(choice, int)), 1) if choices else None


def given_settings(args: argparse.Namespace) -> dict[str, Any]:
    """The settings that the file of --settings and the flags give, by name; flags win."""
    flags = {name: value for name, value in vars(args).items() if name in described()}
    return overridden(read_settings(args.settings), flags) if args.settings else flags


def overridden(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Both, `above` winning; a setting also replaces its alternatives.

    Examples
    --------
    >>> overridden({"threshold": 200.0, "alpha": 0.5}, {"label": 2})
    {'alpha': 0.5, 'label': 2}
    """
    replaced = {name for names in EXCLUSIVE if set(names) & set(above) for name in names}
    if above.get("smoothing", "gaussian") != "gaussian":
        replaced.add("smoothing_mm")
    elif "smoothing_mm" in above:
        replaced.add("smoothing")
    return {name: value for name, value in below.items() if name not in replaced} | dict(above)


def read_settings(path: str) -> dict[str, Any]:
    """The settings in a TOML file; PowerShell's `>` writes it in UTF-16, which is read too."""
    file = Path(path)
    try:
        content = file.read_bytes()
        utf16 = content[:2] in (b"\xff\xfe", b"\xfe\xff")
        text = content.decode("utf-16" if utf16 else "utf-8-sig")
    except OSError as error:
        raise SettingsError(f"the settings file {path} cannot be read: {error.strerror}; check the path") from error
    except UnicodeDecodeError as error:
        raise SettingsError(f"{file.name} is not text; `ctmc settings` writes one to start from") from error
    return from_toml(text, file.name)


def with_flags(sentence: str) -> str:
    """The sentence with settings called by their flags, where these are other words than their names.

    Examples
    --------
    >>> with_flags("NaN voxels; set nan_as")
    'NaN voxels; set --nan-as'
    """
    for name, about in described().items():
        if flag_of(name, about) != f"--{name}":
            sentence = re.sub(rf"\b{name}\b", flag_of(name, about), sentence)
    return sentence


def add_input(parser: argparse.ArgumentParser, all_times: bool = False) -> None:
    """INPUT, how it is read and what it is called; `all_times` may be asked for."""
    parser.add_argument(
        "input",
        metavar="INPUT",
        help="folder of slices or of masks, DICOM, its segmentation (SEG) or structure set (RTSTRUCT), or a volume "
        "such as .nii.gz, .nrrd or .mha",
    )
    add_reading(parser, all_times)
    parser.add_argument(
        "--name",
        type=name_of,
        help="what the volume, its objects and the report call it, in place of the file's or folder's name",
    )


def name_of(text: str) -> str:
    """A name that can be shown on one line."""
    name = text.strip()
    if not name or not name.isprintable():
        raise argparse.ArgumentTypeError("write a name of letters that can be shown")
    return name


def add_reading(parser: argparse.ArgumentParser, all_times: bool = False) -> None:
    """How INPUT is read; `all_times` may be asked for."""
    group = parser.add_argument_group("reading")
    group.add_argument(
        "--spacing",
        action=Numbers,
        most=3,
        type=spacing_of,
        metavar="X Y Z",
        help="mm between columns, rows and slices, in place of the file's own; slices without any have 1 mm",
    )
    group.add_argument("--flip", type=flip_of, default="", metavar="AXES", help="mirror these axes, such as z or xz")
    group.add_argument("--series", metavar="UID", help="which DICOM series to take, by its UID or number (see info)")
    group.add_argument(
        "--time",
        type=time_or_all if all_times else at_least(1),
        metavar="N",
        help="which of several time points or phases, from 1 on (see info)"
        + ("; all makes a surface of each" if all_times else ""),
    )
    group.add_argument("--strict", action="store_true", help="refuse uneven gaps between slices")
    group.add_argument(
        "--allow-outside",
        action="store_true",
        help="read data files that an .nhdr or .mhd names outside its own folder; only for headers you trust",
    )


def add_work(parser: Any) -> None:
    """How many threads work, and whether anything is printed."""
    add_quiet(parser)
    parser.add_argument("--threads", type=at_least(1), metavar="N", help="default: one for each processor, at most 8")


def add_quiet(parser: Any) -> None:
    """Whether anything is printed."""
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def reading_of(args: argparse.Namespace) -> dict[str, Any]:
    """The keyword arguments of `read_volume` that were asked for."""
    names = ("spacing", "flip", "series", "strict", "time")
    return {name: getattr(args, name) for name in names}


def time_or_all(text: str) -> int | str:
    """A time from 1 on, or all of them."""
    return ALL if text.strip().lower() == ALL else at_least(1)(text)


def spacing_of(text: str) -> Any:
    """Millimeters along x, y and z, from one number or three."""
    words = separated(text)
    return reading_option(readers.checked_spacing, words * 3 if len(words) == 1 else words)


def flip_of(text: str) -> Any:
    """Axes to mirror."""
    return reading_option(readers.checked_flip, text)


def reading_option(check: Callable[[Any], Any], value: Any) -> Any:
    """What a reader makes of the value of a flag."""
    try:
        return check(value)
    except SettingsError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def is_number(word: str) -> bool:
    """Whether a word reads as a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True
