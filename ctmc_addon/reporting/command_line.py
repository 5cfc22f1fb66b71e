# SPDX-License-Identifier: GPL-3.0-or-later
"""Write settings as flags of `ctmc`, to print or copy a command."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence

from ..core import Described, ReconstructionSettings, Setting, defaults, descriptions, used_settings
from ..core.solid import Pegs, SolidRequest


def flag_of(name: str, about: Setting) -> str:
    """Return the flag of a setting: its own, else its name with dashes.

    Examples
    --------
    >>> flag_of("keep_parts", descriptions(ReconstructionSettings)["keep_parts"])
    '--keep-parts'
    """
    return "--" + (about.flag or name.replace("_", "-"))


def command_of(settings: ReconstructionSettings, solid: SolidRequest | None = None) -> str:
    """Return the flags that give these settings, without those at their default and steps that no smoothing takes.

    Those of a solid follow.

    Examples
    --------
    >>> command_of(ReconstructionSettings(label=2, stride=(2, 2, 1), close_border=True))
    '--label 2 --stride 2 2 1 --close-border'
    >>> command_of(ReconstructionSettings(threshold=200, slice_steps=4))
    '--threshold 200'
    """
    used = used_settings(settings)
    words = _flags_of(settings, but=[name for name in descriptions(ReconstructionSettings) if name not in used])
    return " ".join([*words, *(map(shlex.quote, solid_flags(solid)) if solid is not None else ())])


def solid_flags(solid: SolidRequest) -> list[str]:
    """Return the words of the flags that ask for a solid.

    Examples
    --------
    >>> from ctmc_addon.core.solid import Drain
    >>> solid_flags(SolidRequest(hollow=2, drains=(Drain(5, (0, 0, -40)),)))
    ['--hollow', '2', '--drain', '0', '0', '-40', '5']
    """
    words = _flags_of(solid)
    for drain in solid.drains:
        words += ["--drain", *(["auto"] if drain.point is None else _numbers(*drain.point, drain.diameter))]
    for cut in solid.cuts:
        words += ["--cut", *_numbers(*cut.point, *cut.normal)]
    if solid.pegs is not None:
        own, pegs = Pegs(solid.pegs.count), solid.pegs
        words += ["--pegs", str(pegs.count)]
        if (pegs.diameter, pegs.length) != (own.diameter, own.length):
            words += ["--peg-mm", *_numbers(pegs.diameter, pegs.length)]
        if pegs.clearance != own.clearance:
            words += ["--clearance", *_numbers(pegs.clearance)]
    for each in solid.combinations:
        words += [f"--{each.how.value}", f"{each.name}={','.join(each.of)}"]
    return words


def _numbers(*values: float) -> list[str]:
    return [f"{value:.12g}" for value in values]


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


def command_line(
    source: str,
    output: str,
    settings: ReconstructionSettings,
    reading: Described | None = None,
    solid: SolidRequest | None = None,
) -> str:
    """Return the whole line, its words quoted for this system's shell; `reading` is how the source is read.

    Examples
    --------
    >>> command_line("scan", "bone.stl", ReconstructionSettings(threshold=200))
    'ctmc reconstruct scan -o bone.stl --threshold 200'
    """
    read = _flags_of(reading) if reading is not None else []
    words = ["ctmc", "reconstruct", source, "-o", output, *read, *command_of(settings).split()]
    words += solid_flags(solid) if solid is not None else []
    if sys.platform != "win32":
        return shlex.join(words)
    import subprocess  # takes long to import

    return subprocess.list2cmdline(words)
