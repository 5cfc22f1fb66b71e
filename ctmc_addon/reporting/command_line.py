# SPDX-License-Identifier: GPL-3.0-or-later
"""Write settings as flags of `ctmc`, to print or copy a command."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence

from ..core import Described, ReconstructionSettings, Setting, defaults, descriptions, used_settings


def flag_of(name: str, about: Setting) -> str:
    """Return the flag of a setting: its own, else its name with dashes.

    Examples
    --------
    >>> flag_of("keep_parts", descriptions(ReconstructionSettings)["keep_parts"])
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
    used = used_settings(settings)
    return " ".join(
        _flags_of(settings, but=[name for name in descriptions(ReconstructionSettings) if name not in used])
    )


def _flags_of(values: Described, but: Sequence[str] = ()) -> list[str]:
    """Return the words of the flags that give these values, without those at their default."""
    words = []
    own = defaults(type(values))
    for name, about in descriptions(type(values)).items():
        value = getattr(values, name)
        if value == own[name] or name in but:
            continue
        items = value if isinstance(value, tuple) else (value,)
        flag = flag_of(name, about)
        words.append(f"--no-{flag[2:]}" if value is False else flag)
        words += [] if about.type is bool else [item if isinstance(item, str) else f"{item:.12g}" for item in items]
    return words


def command_line(source: str, output: str, settings: ReconstructionSettings, reading: Described | None = None) -> str:
    """Return the whole line, its words quoted for this system's shell; `reading` is how the source is read.

    Examples
    --------
    >>> command_line("scan", "bone.stl", ReconstructionSettings(threshold=200))
    'ctmc reconstruct scan -o bone.stl --threshold 200'
    """
    read = _flags_of(reading) if reading is not None else []
    words = ["ctmc", "reconstruct", source, "-o", output, *read, *command_of(settings).split()]
    if sys.platform != "win32":
        return shlex.join(words)
    import subprocess  # takes long to import

    return subprocess.list2cmdline(words)
