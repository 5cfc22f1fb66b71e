"""Flags made from the settings, and the flags that say how INPUT is read."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..core import EXCLUSIVE, ReconstructionSettings, Setting, SettingsError, described
from ..reporting.command_line import command_of as command_of
from ..reporting.command_line import flag_of as flag_of
from ..reporting.settings_toml import from_toml


def add_settings(parser: argparse.ArgumentParser, many: Sequence[str] = ()) -> None:
    """A flag for every field of `ReconstructionSettings`, and --settings for a file of them.

    Only flags that are given reach the namespace; those of the settings in `many` may be repeated and arrive as lists.
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


def add_setting(group: Any, name: str, about: Setting, repeated: bool = False) -> None:
    """One setting's flag, its help made from the setting's text, unit, limits and default."""
    default = getattr(ReconstructionSettings, name)
    options: dict[str, Any] = {"dest": name, "default": argparse.SUPPRESS, "help": help_of(about, default)}
    if about.type is bool:
        options["action"] = argparse.BooleanOptionalAction
    elif about.choices:
        options["choices"] = about.choices
    else:
        options["type"], options["metavar"] = about.type, metavar_of(about)
        if about.size > 1:
            options["nargs"] = about.size
        if repeated:
            options["action"] = "append"
    group.add_argument(flag_of(name, about), **options)


def help_of(about: Setting, default: Any) -> str:
    """Text, unit, limits and default in brackets: 'Side of ... (px; from 1 to 16; default 1 1 1)'."""
    facts = [about.unit] if about.unit else []
    if not about.choices and (about.low is not None or about.high is not None):
        facts.append(about.limits)
    if default is not None and about.type is not bool:
        many = default if isinstance(default, tuple) else (default,)
        facts.append("default " + " ".join(one if isinstance(one, str) else f"{one:g}" for one in many))
    text = about.text + (f" ({'; '.join(facts)})" if facts else "")
    return text.replace("%", "%%")


def metavar_of(about: Setting) -> str | tuple[str, ...]:
    """What stands for the value in the help: X Y Z, MM, N, VALUE, or the setting's label."""
    if about.size == 3:
        return ("X", "Y", "Z")
    if about.size == 6:
        return ("X0", "Y0", "Z0", "X1", "Y1", "Z1")
    if about.unit in ("mm", "mm3"):
        return about.unit.upper()
    return "N" if about.type is int else "VALUE" if "gray value" in about.unit else about.label.upper()


def settings_from(chosen: argparse.Namespace) -> ReconstructionSettings:
    """The settings that were asked for; a `SettingsError` says what is outside its limits."""
    return ReconstructionSettings(**given_settings(chosen))


def given_settings(chosen: argparse.Namespace) -> dict[str, Any]:
    """The settings that the file of --settings and the flags give, by name; flags win."""
    flags = {name: value for name, value in vars(chosen).items() if name in described()}
    return overridden(read_settings(chosen.settings), flags) if chosen.settings else flags


def overridden(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Both, `above` winning; a setting also replaces its alternatives.

    Examples
    --------
    >>> overridden({"threshold": 200.0, "alpha": 0.5}, {"label": 2})
    {'alpha': 0.5, 'label': 2}
    """
    replaced = {name for names in EXCLUSIVE if set(names) & set(above) for name in names}
    return {name: value for name, value in below.items() if name not in replaced} | dict(above)


def read_settings(path: str) -> dict[str, Any]:
    """The settings in a TOML file; PowerShell's `>` writes it in UTF-16, which is read too."""
    place = Path(path)
    try:
        content = place.read_bytes()
        utf16 = content[:2] in (b"\xff\xfe", b"\xfe\xff")
        text = content.decode("utf-16" if utf16 else "utf-8-sig")
    except OSError as error:
        raise SettingsError(f"the settings file {path} cannot be read: {error.strerror}; check the path") from error
    except UnicodeDecodeError as error:
        raise SettingsError(f"{place.name} is no text; `ctmc settings` writes one to start from") from error
    return from_toml(text, place.name)


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


def add_input(parser: argparse.ArgumentParser) -> None:
    """INPUT and how it is read."""
    parser.add_argument("input", metavar="INPUT", help="folder of slices, DICOM, .nii, .nii.gz, .nrrd, .nhdr or .npy")
    add_reading(parser)


def add_reading(parser: argparse.ArgumentParser) -> None:
    """How INPUT is read."""
    group = parser.add_argument_group("reading")
    group.add_argument(
        "--spacing",
        nargs=3,
        type=float,
        metavar=("X", "Y", "Z"),
        help="mm between columns, rows and slices, in place of the file's own; slices without any have 1 mm",
    )
    group.add_argument("--flip", default="", metavar="AXES", help="mirror these axes, such as z or xz")
    group.add_argument("--series", metavar="UID", help="which DICOM series to take, by its UID or number (see info)")
    group.add_argument("--strict", action="store_true", help="refuse uneven gaps between slices")


def reading_of(chosen: argparse.Namespace) -> dict[str, Any]:
    """The keyword arguments of `read_volume` that were asked for."""
    spacing = None if chosen.spacing is None else tuple(chosen.spacing)
    return {"spacing": spacing, "flip": chosen.flip, "series": chosen.series, "strict": chosen.strict}


def single_numbers_repeated(argv: Sequence[str]) -> list[str]:
    """`--stride 2` as `--stride 2 2 2`, and the same for `--spacing`.

    Examples
    --------
    >>> single_numbers_repeated(["--stride", "2", "in", "--stride=3", "--stride", "2", "2", "1"])
    ['--stride', '2', '2', '2', 'in', '--stride', '3', '3', '3', '--stride', '2', '2', '1']
    """
    triples = {flag_of(name, about) for name, about in described().items() if about.size == 3} | {"--spacing"}
    words: list[str] = []
    at = 0
    while at < len(argv):
        flag, equals, value = argv[at].partition("=")
        at += 1
        if flag not in triples:
            words.append(argv[at - 1])
            continue
        alone = at + 1 >= len(argv) or not is_number(argv[at + 1])
        if equals:
            words += [flag, value, value, value]
        elif at < len(argv) and is_number(argv[at]) and alone:
            words += [flag, *[argv[at]] * 3]
            at += 1
        else:
            words.append(flag)
    return words


def figures_named(words: Sequence[str]) -> list[str]:
    """`figure sheet` and `figure turntable` as one word each: they are commands of their own.

    Examples
    --------
    >>> figures_named(["figure", "sheet", "ct"]), figures_named(["figure", "ct"])
    (['figure sheet', 'ct'], ['figure', 'ct'])
    """
    if list(words[:1]) == ["figure"] and words[1:2] and words[1] in ("sheet", "turntable"):
        return [f"figure {words[1]}", *words[2:]]
    return list(words)


def labels_repeated(words: list[str]) -> list[str]:
    """For `batch` and `figure`, `--label 1 2` as `--label 1 --label 2`, so that an input may follow.

    Examples
    --------
    >>> labels_repeated(["batch", "--label", "1", "2", "cases"])
    ['batch', '--label', '1', '--label', '2', 'cases']
    """
    if not words or words[0] not in ("batch", "figure", "figure sheet", "figure turntable"):
        return words
    out: list[str] = []
    for word in words:
        follows = out[-2:-1] == ["--label"] and is_number(out[-1]) and is_number(word)
        out += ["--label", word] if follows else [word]
    return out


def is_number(word: str) -> bool:
    """Whether a word reads as a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True
