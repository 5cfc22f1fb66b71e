# SPDX-License-Identifier: GPL-3.0-or-later
"""Make a surface of every time of a volume, one time after the other, with only one in memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from ...core import (
    Budget,
    CtmcError,
    LabelError,
    MeshError,
    ReadError,
    ReconstructionSettings,
    Stage,
    Stages,
    Steps,
    ThresholdError,
    Volume,
    equal_part,
)
from ...core.volume import used_threshold_steps
from ...readers import VolumeSource
from ..flags.arguments import UsageError
from ..surface_writer import SurfaceWriter
from ..surfaces import Surfaces, may_be_several, surfaces_steps

Reader = Callable[[int], Steps[Volume]]
STAGES = {"Reading": 3, "Reconstructing": 6}
IN_TURN = (".blend",)  # These files show one surface after the other.


def require_one_each(choices: Sequence[int | str], suffix: str, figure: bool, scheduler: bool) -> None:
    """Refuse what is not one surface for each time.

    Parameters
    ----------
    choices : sequence of int or str
        Labels.
    suffix : str
        Of the output; empty for a folder.
    figure : bool
        Whether a figure is asked for.
    scheduler : bool
        Whether workers are.

    Raises
    ------
    UsageError
        If it is not.
    """
    if may_be_several(choices):
        raise UsageError("--time all makes one surface per time; give one label, or one time")
    if figure or scheduler:
        flag = "--figure" if figure else "--scheduler"
        raise UsageError(f"{flag} is for one surface; give one time, or leave {flag} out")
    if suffix and suffix not in IN_TURN:
        raise UsageError(
            f"--time all makes several surfaces, which a {suffix} cannot show one after the other; "
            "write a .blend, or a folder ending in a slash"
        )


def number_of_times(source: VolumeSource, series: str | None) -> int:
    """Return the number of times of a series; raise `ReadError` for a single one."""
    line = source.selected_series(series)
    if line is not None and line.times == 1:
        raise ReadError(f"{source.path.name} holds a single time; leave --time all out")
    return 1 if line is None else line.times  # without a series, reading raises the error that explains it


def times_steps(
    read_steps: Reader,
    count: int,
    settings: ReconstructionSettings,
    choices: Sequence[int | str],
    budget: Budget,
    writer: SurfaceWriter | None = None,
) -> Steps[tuple[Surfaces, Volume]]:
    """Make the surface of each of `count` times; return them and the last volume. A `writer` writes each at once.

    Without a threshold Otsu's of the first time is used for all, so that a change is one of the volume. A time without
    a surface is left out and reported.

    Raises
    ------
    CtmcError
        As `reconstruct`, if no time has a surface.
    """
    per_time: list[Surfaces] = []
    times: list[int] = []
    left_out: list[str] = []
    reason: CtmcError | None = None
    volume: Volume | None = None
    note = ""
    for number in range(count):
        volume = None  # release the memory of this time before the next one is read
        stages = Stages(STAGES)
        reading = stages.run("Reading", read_steps(number + 1))
        volume = yield from equal_part(reading, number, count)
        if settings.threshold is None and settings.label is None:
            threshold = yield from used_threshold_steps(volume, settings)
            note = f"Otsu's threshold of time 1, {threshold:.6g}, is used for all times"
            settings = replace(settings, threshold=threshold)
        try:
            of_time = None if writer is None else writer.of_time(number + 1)
            making = stages.run("Reconstructing", surfaces_steps(volume, settings, choices, budget, of_time))
            surfaces = yield from equal_part(making, number, count)
        except (LabelError, MeshError, ThresholdError) as error:
            reason = reason or error
            left_out.append(f"time {number + 1} is left out: {error}")
            continue
        if surfaces.are_several:
            raise UsageError(f"{choices[0]} is the name of several labels; give one label's number")
        stage = Stage("Reading", stages.seconds["Reading"])
        per_time.append(
            replace(surfaces, results=(replace(surfaces.results[0], stages=(stage, *surfaces.results[0].stages)),))
        )
        times.append(number + 1)
    if volume is None or not per_time:
        raise reason or ReadError("no time could be read; check the file")
    digits = len(str(count))
    names = tuple(
        f"{surfaces.titles[0]} time {time:0{digits}d}" for surfaces, time in zip(per_time, times, strict=True)
    )
    notes = (note,) if note else ()
    results = tuple(replace(surfaces.results[0], notes=(*surfaces.results[0].notes, *notes)) for surfaces in per_time)
    files = tuple(file for surfaces in per_time for file in surfaces.files)
    return Surfaces(per_time[0].name, results, names, tuple(left_out), tuple(times), files), volume
