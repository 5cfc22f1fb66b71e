# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings, reading options and figures are described once: flags, properties and tables say what stands there."""

from __future__ import annotations

import argparse
import inspect

import pytest

from ctmc_addon.blender.figure.spec import (
    FIGURE_SETTINGS,
    PAGES,
    Comparison,
    DistanceMapSettings,
    ExplodedView,
    FigureStyle,
    Page,
    Transparency,
    Turn,
)
from ctmc_addon.cli.flags.arguments import tables
from ctmc_addon.cli.flags.described import help_of
from ctmc_addon.cli.program import parser
from ctmc_addon.core import ReconstructionSettings, defaults, descriptions
from ctmc_addon.readers import ReadingOptions, read_volume
from ctmc_addon.reporting.command_line import flag_of
from ctmc_addon.reporting.settings_toml import from_toml, to_toml

KINDS = (ReconstructionSettings, ReadingOptions, *FIGURE_SETTINGS)
NOT_DESCRIBED = {FigureStyle: {"colors", "samples"}}
"""What the code alone sets."""
GENERATED = {
    "info": {"reading": [ReadingOptions]},
    "reconstruct": {"reading": [ReadingOptions]},
    "figure": {
        "reading": [ReadingOptions],
        "figure": [Page, FigureStyle],
        "distance map": [DistanceMapSettings],
        "several labels": [Transparency, ExplodedView],
    },
    "figure sheet": {
        "reading": [ReadingOptions],
        "figure": [Page, FigureStyle],
        "distance map": [DistanceMapSettings],
        "settings to compare": [Comparison],
    },
    "figure turntable": {
        "figure": [Page, FigureStyle],
        "turntable": [Turn],
        "several labels": [Transparency, ExplodedView],
    },
    "experiment rotation": {"reading": [ReadingOptions]},
    "batch": {"reading": [ReadingOptions]},
    "settings": {"reading": [ReadingOptions]},
}
"""For each command its groups of flags, and what their flags are made from."""
BESIDE = {"turntable": {"resume", "overwrite"}, "several labels": {"names", "opacities"}}
"""Flags that stand in such a group and describe no field: they name files, labels or the run."""
LEFT_OUT = {
    ("batch", "reading"): {"name"},
    ("settings", "reading"): {"name"},
    ("figure", "figure"): {"columns"},
    ("figure turntable", "figure"): {"columns"},
}
"""Fields that a command has no use for."""
IN_OTHER_WORDS = {("reconstruct", "time")}
"""Flags that take more than their field does, and say so."""


def parser_of(command: str) -> argparse.ArgumentParser:
    """The parser of a command, and of one below it."""
    first, *below = command.split()
    commands = next(action for action in parser()._actions if isinstance(action, argparse._SubParsersAction))
    found = commands.choices[first]
    for word in below:
        inner = [action for action in found._actions if isinstance(action, argparse._SubParsersAction)]
        found = inner[0].choices[word] if inner else found.commands[word]
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_every_field_has_a_text_a_name_and_words_for_its_absence(kind):
    about = descriptions(kind)
    assert set(kind.__dataclass_fields__) - set(about) == NOT_DESCRIBED.get(kind, set())
    for name, default in defaults(kind).items():
        assert about[name].text, name
        assert about[name].label, name
        assert not about[name].text.endswith("."), name
        if default is None and about[name].kept:
            assert about[name].start is not None, name
        if default is None and kind is not ReconstructionSettings:
            assert about[name].without, name
        assert set(about[name].choice_texts) in (set(), set(about[name].choices)), name


@pytest.mark.parametrize(
    ("command", "group"), [(name, group) for name, groups in GENERATED.items() for group in groups]
)
def test_a_group_of_flags_holds_the_fields_and_nothing_beside_them(command, group):
    fields = {name: about for kind in GENERATED[command][group] for name, about in descriptions(kind).items()}
    own = {name: default for kind in GENERATED[command][group] for name, default in defaults(kind).items()}
    if group == "figure":
        page = PAGES[command.split()[-1]]
        own |= {name: getattr(page, name) for name in descriptions(Page)}
    flags = {
        action.dest: action
        for found in parser_of(command)._action_groups
        if found.title == group
        for action in found._group_actions
    }
    assert set(flags) == (set(fields) - LEFT_OUT.get((command, group), set())) | BESIDE.get(group, set())
    for name in set(flags) & set(fields):
        assert flag_of(name, fields[name]) in flags[name].option_strings
        assert flags[name].default == argparse.SUPPRESS
        if (command, name) not in IN_OTHER_WORDS:
            assert flags[name].help == help_of(fields[name], own[name])


@pytest.mark.parametrize("kind", KINDS)
def test_help_says_every_field(kind):
    for name, about in descriptions(kind).items():
        assert f"\n{name}\n    {about.text}.\n" in kind.__doc__ + "\n"


def test_read_volume_takes_every_reading_option_with_its_default():
    parameters = inspect.signature(read_volume).parameters
    for name, default in defaults(ReadingOptions).items():
        assert parameters[name].default == default


def test_a_settings_file_has_every_field_that_is_kept_with_its_text():
    text = to_toml(ReconstructionSettings(), tables=tables())
    shown = " ".join(text.replace("\n#", "").split())
    for kind in KINDS:
        for name, about in descriptions(kind).items():
            assert (f"\n# {name} = " in text or f"\n{name} = " in text) == about.kept, name
            assert (" ".join(about.text.split()[:8]) in shown) == about.kept, name
    assert text.isascii()


@pytest.mark.parametrize("table", tables())
def test_a_line_of_a_table_without_its_comment_sign_is_valid(table):
    lines = to_toml(ReconstructionSettings(), tables={table: tables()[table]}).partition(f"[{table}]")[2].splitlines()
    fields = {name for kind in tables()[table] for name, about in descriptions(kind).items() if about.kept}
    values = [line[2:] for line in lines if line[2:].partition(" = ")[0] in fields]
    assert len(values) == len(fields)
    read = from_toml("\n".join([f"[{table}]", *values]), tables=tables())
    assert set(read[table]) == fields
