# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings as flags of `ctmc`, to print or copy a command."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Mapping
from typing import Any

from ..core import ReconstructionSettings, Setting, described


def flag_of(name: str, about: Setting) -> str:
    """Return the flag of a setting: its own, else its name with dashes.

    Examples
    --------
    >>> flag_of("keep_parts", described()["keep_parts"])
    '--keep-parts'
    """
    return "--" + (about.flag or name.replace("_", "-"))


def command_of(settings: ReconstructionSettings) -> str:
    """Return the flags that give these settings, without those at their default and steps that no smoothing takes.

    Examples
    --------
    >>> command_of(ReconstructionSettings(label=2, stride=(2, 2, 1), close_border=True))
    '--label 2 --stride 2 2 1 --close-border'
    >>> command_of(ReconstructionSettings(threshold=200, slice_steps=4))
    '--threshold 200'
    """
    words = []
    for name, about in described().items():
        value = getattr(settings, name)
        if value == getattr(ReconstructionSettings, name):
            continue
        if name == "slice_steps" and settings.smoothing_method != "constrained":
            continue
        items = value if isinstance(value, tuple) else (value,)
        words.append(flag_of(name, about))
        words += [] if about.type is bool else [item if isinstance(item, str) else f"{item:.12g}" for item in items]
    return " ".join(words)


def reading_flags(reading: Mapping[str, Any]) -> list[str]:
    """Return the flags that say how INPUT is read, from the keyword arguments of `read_volume`.

    Examples
    --------
    >>> reading_flags({"spacing": (0.7, 0.7, 2.0), "flip": "z", "series": None, "time": 2})
    ['--spacing', '0.7', '0.7', '2', '--flip', 'z', '--time', '2']
    """
    words = []
    if reading.get("spacing"):
        words += ["--spacing", *(f"{side:.12g}" for side in reading["spacing"])]
    for name in ("flip", "series", "time"):
        if reading.get(name):
            words += [f"--{name}", str(reading[name])]
    return words


def command_line(source: str, output: str, settings: ReconstructionSettings, reading: Mapping[str, Any]) -> str:
    """Return the whole line, its words quoted for this system's shell.

    Examples
    --------
    >>> command_line("scan", "bone.stl", ReconstructionSettings(threshold=200), {})
    'ctmc reconstruct scan -o bone.stl --threshold 200'
    """
    words = ["ctmc", "reconstruct", source, "-o", output, *reading_flags(reading), *command_of(settings).split()]
    return subprocess.list2cmdline(words) if sys.platform == "win32" else shlex.join(words)
