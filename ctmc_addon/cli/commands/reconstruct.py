# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc reconstruct INPUT -o OUTPUT`: read a volume and write a surface file."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ... import readers
from ...core import (
    AUTO,
    Budget,
    ExplodedView,
    LabelError,
    Measure,
    Place,
    Reconstruction,
    ReconstructionSettings,
    Stage,
    Stages,
    Step,
    Steps,
    Volume,
    length_text,
    maps_of,
    measures_in,
    printed_of,
    reads_at_once,
    require_opacities,
    sizes_text,
    volume_text,
)
from ...core.files import mesh_files
from ...core.files.atomic_write import own_folder, require_writable
from ...core.volume import ValueKind, require_labels
from ...reporting.formatting import count
from ..flags.arguments import (
    UsageError,
    add_input,
    add_opacity,
    add_settings,
    add_work,
    asks_all_times,
    command_of,
    reading_of,
    with_flags,
)
from ..flags.described import add_described
from ..flags.maps import add_maps, asked_maps
from ..flags.solid import NOTHING, add_solid, may_have_parts, require_room_for_parts, settings_labels_and_solid
from ..machine.blender_host import require_blender
from ..outputs import Outputs, surface_output, written_steps
from ..surfaces import Surfaces, explode_of, may_be_several, open_words, surfaces_steps
from ..terminal import Progress, dimensions, listing, table, titled
from .slabs import workers_of
from .times import number_of_times, require_one_each, times_steps

FORMATS = tuple(suffix.lstrip(".") for suffix in mesh_files.SURFACE_SUFFIXES)
MOST_FILES = 8  # The summary names at most this many.
STAGES = {"Reading": 3, "Reconstructing": 6, "Writing": 1}


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`."""
    parser = commands.add_parser(
        "reconstruct",
        help="make a surface from a volume",
        description="Make a surface from a CT stack or a label volume. Without --threshold or --label "
        "Otsu's threshold is used.",
    )
    add_input(parser, all_times=True)
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="OUTPUT",
        help=f"{', '.join(mesh_files.SURFACE_SUFFIXES)} in an existing folder, or a folder ending in a "
        "slash for one file per label or time",
    )
    add_settings(parser, many=("label",))
    group = parser.add_argument_group("output")
    group.add_argument("--format", choices=FORMATS, default="stl", help="format of the files in a folder (default stl)")
    group.add_argument(
        "--space", choices=mesh_files.SPACES, default="ras", help="axes of .stl, .ply, .obj and .3mf, mm (default ras)"
    )
    group.add_argument("--report", metavar="FILE.json", help="counts, measures, stages, settings and notes")
    group.add_argument("--figure", metavar="FILE.png", help="picture of the surface, in the style illustration")
    add_opacity(group, "opacity", "default: by anatomical name, a single surface opaque")
    add_described(group, ExplodedView)
    group.add_argument(
        "--map-table", metavar="FILE.csv", help="position of every vertex, mm, and the values of every map there"
    )
    add_solid(parser)
    add_maps(parser)
    add_work(group)
    group.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="extract slabs on a dask.distributed cluster that can read INPUT, such as tcp://host:8786",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Read, reconstruct, write, and print what came out."""
    settings, choices, solid = settings_labels_and_solid(args)
    maps = asked_maps(args)
    if maps and settings.simplifies and settings.simplifier == "decimate":
        raise UsageError("maps are made on surfaces of the built-in simplifier; leave out --simplifier decimate")
    if maps and (asks_all_times(args) or args.scheduler):
        raise UsageError("maps are made here and of one time; leave out --scheduler, and give a single --time")
    if solid != NOTHING and (asks_all_times(args) or args.scheduler):
        raise UsageError("solids are made here and of one time; leave out --scheduler, and give a single --time")
    require_room_for_parts(solid, args.output)
    if asks_all_times(args):
        suffix = Path(args.output).suffix.lower()
        require_one_each(choices, suffix if suffix in mesh_files.SURFACE_SUFFIXES else "", args.figure, args.scheduler)
    outputs = Outputs(
        report=require_writable(args.report, (".json",)) if args.report else None,
        figure=require_writable(args.figure, (".png",)) if args.figure else None,
        space=args.space,
        opacity=tuple(args.opacity),
        holds_all=bool(maps) or solid != NOTHING,
        shown_map=maps.shown,
        map_table=require_writable(args.map_table, (".csv",)) if args.map_table else None,
        explode=explode_of(args, (may_be_several(choices) or may_have_parts(solid)) and not asks_all_times(args)),
        **surface_output(
            args.output,
            f".{args.format}",
            may_be_several(choices) or may_have_parts(solid) or asks_all_times(args),
            is_counted=(len(choices) > 1 and not solid.combinations) or asks_all_times(args),
        ),
    )
    if args.opacity and not (outputs.figure or set(outputs.suffixes) - set(mesh_files.SUFFIXES)):
        raise UsageError("STL and PLY files hold no opacity; write .glb, .obj, .3mf, .html, .blend or --figure")
    if outputs.explode and not outputs.can_explode:
        if outputs.folder is None:
            mesh_files.require_placements(Path(args.output))
        raise UsageError("each file of a folder holds one surface, which --explode cannot move; write one file")
    if purpose := outputs.blender_needed_for(settings.simplifier):
        require_blender(purpose)
    if asks_all_times(args):
        _run_times(args, settings, choices, outputs)
        return
    stages = Stages(STAGES | {"Writing": 6} if args.figure else STAGES)
    if args.scheduler and may_be_several(choices):
        raise UsageError("--scheduler extracts one surface; give one label, or leave --scheduler out")
    source = source_of(Path(args.input), settings.label)
    with (
        own_folder(outputs.folder or Path(args.output).parent),
        Progress() as progress,
        workers_of(args.scheduler, source, reading_of(args)) as workers,
        outputs.writer(settings.simplifier) as writer,
    ):
        reading = fetched_steps(args, settings, may_be_several(choices), bool(args.scheduler))
        volume = progress.finish(stages.run("Reading", reading))
        if not solid:
            require_opacities(args.opacity, volume.label_names.items())
        budget = Budget(args.threads, workers=workers)
        written_bytes = outputs.triangle_bytes(settings.simplifier)
        room = outputs.require_room_for
        making = surfaces_steps(volume, settings, choices, budget, writer, written_bytes, room, maps, solid)
        making = measured_steps(making, outputs)
        surfaces = progress.finish(stages.run("Reconstructing", making))
        if solid:  # whose parts have names of their own
            require_opacities(
                args.opacity, ((result.settings.label or 0, result.label_name) for result in surfaces.results)
            )
        stage = Stage("Reading", stages.seconds["Reading"])
        results = tuple(replace(result, stages=(stage, *result.stages)) for result in surfaces.results)
        writing = written_steps(replace(surfaces, results=results), outputs)
        surfaces, files = progress.finish(stages.run("Writing", writing))
    if surfaces.are_several:
        print(_summary_of_several(surfaces, volume, files, stages.seconds))
    else:
        print(summary(surfaces.results[0], volume, files))


def measured_steps(making: Steps[Surfaces], outputs: Outputs) -> Steps[Surfaces]:
    """Measure surfaces and reserve memory for their files before anything is written."""
    surfaces = yield from making
    for result in surfaces.results:
        yield Step(1.0, "Measuring the surface")
        result.measures  # noqa: B018  (kept by the mesh)
    outputs.require_memory(surfaces)
    return surfaces


def _run_times(
    args: argparse.Namespace, settings: ReconstructionSettings, choices: Sequence[int | str], outputs: Outputs
) -> None:
    """Read and reconstruct every time, write, and print what came out."""
    path, reading = Path(args.input), reading_of(args)
    budget = Budget(args.threads)
    stages = Stages({"Reading headers": 1, "Reading and reconstructing": 18, "Writing": 2})
    with (
        own_folder(outputs.folder or Path(args.output).parent),
        Progress() as progress,
        outputs.writer(settings.simplifier) as writer,
    ):
        opening = readers.open_volume_steps(source_of(path, settings.label), reading.allow_outside)
        source = progress.finish(stages.run("Reading headers", opening))

        def read_steps(time: int) -> Steps[Volume]:
            return (yield from needed_steps(source, path, replace(reading, time=time), settings, budget=budget))

        count = number_of_times(source, reading.series)
        making = times_steps(read_steps, count, settings, choices, budget, writer)
        surfaces, volume = progress.finish(stages.run("Reading and reconstructing", making))
        surfaces, files = progress.finish(stages.run("Writing", written_steps(surfaces, outputs)))
    print(_summary_of_several(surfaces, volume, files, stages.seconds))


def input_steps(args: argparse.Namespace, settings: ReconstructionSettings) -> Steps[Volume]:
    """Read INPUT as the flags say; where it does not fit, values are fetched later."""
    return (yield from fetched_steps(args, settings, several=True))


def fetched_steps(
    args: argparse.Namespace, settings: ReconstructionSettings, several: bool, by_workers: bool = False
) -> Steps[Volume]:
    """Read INPUT as the flags say; where only some of it is wanted or it does not fit, values are fetched later.

    `several` and `by_workers` are those of `needed_steps`.
    """
    path, reading = Path(args.input), reading_of(args)
    stages = Stages({"Reading headers": 1, "Reading values": 4})
    opening = readers.open_volume_steps(source_of(path, settings.label), reading.allow_outside)
    source = yield from stages.run("Reading headers", opening)
    needed = needed_steps(source, path, reading, settings, several, by_workers, Budget(args.threads))
    return (yield from stages.run("Reading values", needed))


def needed_steps(
    source: readers.VolumeSource,
    path: Path,
    reading: readers.ReadingOptions,
    settings: ReconstructionSettings,
    several: bool = False,
    by_workers: bool = False,
    budget: Budget | None = None,
) -> Steps[Volume]:
    """Read what was opened; where only some of it is needed or it does not fit, values are fetched later.

    Parameters
    ----------
    source : VolumeSource
        What `path`, or its segmentation, was opened as.
    path : Path
        For the note of where a label is taken from.
    reading : ReadingOptions
    settings : ReconstructionSettings
    several : bool
        Whether there will be several surfaces, of which any part of the volume is needed.
    by_workers : bool
        Whether workers fetch the values, so that none are read here.
    budget : Budget, optional
    """
    whole = not by_workers and _reads_whole(source, reading, settings, several, budget or Budget())
    if whole:
        return checked((yield from source.read_steps(reading, budget=budget)), source, path, settings.label)
    return checked((yield from source.slabs_steps(reading, budget=budget)), source, path, settings.label)


def _reads_whole(
    source: readers.VolumeSource,
    reading: readers.ReadingOptions,
    settings: ReconstructionSettings,
    several: bool,
    budget: Budget,
) -> bool:
    """Return whether all values are needed and leave enough of the budget's memory for a surface."""
    series = source.selected_series(reading.series)
    if series is None:
        return True
    every = ReconstructionSettings() if several else settings
    return reads_at_once(math.prod(series.shape) * series.voxel_bytes, every, budget)


def checked(volume: Volume, source: readers.VolumeSource, path: Path, label: int | None) -> Volume:
    """Return the volume with a note of where its label is taken from.

    Parameters
    ----------
    volume : Volume
    source : VolumeSource
        What was read.
    path : Path
        What was asked for.
    label : int or None

    Raises
    ------
    LabelError
        If the volume cannot have a label.
    """
    is_sibling = source.path == readers.segmentation_sibling(path)
    if label is not None:  # raises before the surface is made
        names = () if is_sibling else readers.segmentation_names(path)
        if names and volume.kind == ValueKind.HU:
            raise LabelError(
                f"{path.name} holds HU, and {names[0]} is not in its folder; put it there, or give a threshold"
            )
        require_labels(volume)
    if is_sibling:
        note = f"{path.name} holds gray values; labels come from {source.path.name} beside it"
        return replace(volume, notes=(note, *volume.notes))
    return volume


def source_of(path: Path, label: int | None) -> Path:
    """Return the file to read: for a label that of a LiTS volume's segmentation, where there is one.

    Parameters
    ----------
    path : Path
    label : int or None
    """
    return (readers.segmentation_sibling(path) if label is not None else None) or path


def _small_components_lines(result: Reconstruction) -> list[str]:
    """Return the number of small components and the flag that removes them; empty if they are few or were removed."""
    measures = result.measures
    if not measures.has_many_small_components or result.settings.min_part_mm3 >= measures.small:
        return []
    what = "components and cavities" if measures.cavities else "components"
    counts = f"{count(measures.small_components)} of {count(measures.components)} {what}"
    return [f"{counts} are smaller than {volume_text(measures.small)}; --min-part {measures.small:g} removes them"]


def summary(result: Reconstruction, volume: Volume, files: Sequence[Path]) -> str:
    """Return settings, stages, counts, measures and notes, for a person."""
    report = result.report()
    stages = [(stage.name, f"{stage.seconds:.3f}") for stage in result.stages]
    total = sum(stage.seconds for stage in result.stages)
    finished = result.finished
    shown = _measures_in(Place.TERMINAL, [result])
    measured = {each.name: (each.head, each.text(each.value(finished))) for each in shown}
    if report["full_faces"] != report["faces"]:
        head, faces = measured["faces"]
        measured["faces"] = (head, f"{faces} of {report['full_faces']}")
    facts = [
        *measured.values(),
        *(("small", line) for line in _small_components_lines(result)),
        *([] if result.settings.label is not None else [("threshold", f"{result.threshold:.6g}")]),
        ("voxels", f"{result.voxels_visited} visited"),
        *titled("note", [with_flags(note) for note in report["notes"]]),
        ("written", ", ".join(path.name for path in files)),
    ]
    settings = f"settings: {_command_of(result) or 'the defaults'}"
    stage_table = table([("stage", "seconds"), *stages, ("total", f"{total:.3f}")])
    return f"{head_of(volume)}\n{settings}\n\n{stage_table}\n\n{listing(facts)}"


def _command_of(result: Reconstruction) -> str:
    """Return the flags that make a surface; combinations name their labels themselves."""
    settings = _given_of(result)
    if result.solid is not None and result.solid.combinations:
        settings = replace(settings, label=None)
    return command_of(settings, result.solid)


def _measures_in(place: Place, results: Sequence[Reconstruction]) -> tuple[Measure, ...]:
    finished = [result.finished for result in results]
    return measures_in(place, maps_of(finished).items(), printed=printed_of(finished))


def _given_of(result: Reconstruction) -> ReconstructionSettings:
    """Return the settings that were given: with alpha as `auto` where it was chosen."""
    return result.settings if result.alpha_choice is None else replace(result.settings, alpha=AUTO)


def head_of(volume: Volume) -> str:
    """Return name, size and spacing of a volume in words."""
    return f"{volume.name}: {dimensions(volume.size)}, {sizes_text(volume.spacing, digits=6)}"


def _label_text(result: Reconstruction) -> str:
    """Return the label of a surface; none of a threshold's, nor of those that may be combined from several labels."""
    is_of_label = result.settings.label is not None and not (result.solid is not None and result.solid.combinations)
    return str(result.settings.label) if is_of_label else ""


def _summary_of_several(surfaces: Surfaces, volume: Volume, files: Sequence[Path], seconds: Mapping[str, float]) -> str:
    """Return a row for every surface, and what holds for all, for a person."""
    shared, chose = _given_of(surfaces.results[0]), surfaces.results[0].alpha_choice is not None
    measures = _measures_in(Place.SURFACES, surfaces.results)
    labels = [_label_text(result) for result in surfaces.results]
    numbers = list(map(str, surfaces.times)) or labels
    numbered = ["time" if surfaces.times else "label"] if any(numbers) else []  # a threshold's parts have no label
    head = (*numbered, "name", *(each.head for each in measures))
    rows: list[tuple[str, ...]] = [(*head, "alpha", "at most") if chose else head]
    for number, name, result in zip(numbers, surfaces.names, surfaces.results, strict=True):
        facts = [each.text(each.value(result.finished)) for each in measures]
        choice = result.alpha_choice
        if choice is not None:
            facts += [f"{choice.alpha:g}", length_text(choice.largest_mm, 3)]
        rows.append((*([number] if numbered else []), name, *facts))
    stages = [(stage, f"{taken:.3f}") for stage, taken in seconds.items()]
    stage_table = table([("stage", "seconds"), *stages, ("total", f"{sum(seconds.values()):.3f}")])
    settings = command_of(shared if surfaces.times else replace(shared, label=None), surfaces.results[0].solid)
    written = ", ".join(path.name for path in files[:MOST_FILES])
    more = f" and {len(files) - MOST_FILES} more" if len(files) > MOST_FILES else ""
    opened = sum(not result.measures.closed for result in surfaces.results)
    shown = [
        ("surfaces", open_words(len(surfaces.results), opened)),
        *titled("note", [with_flags(note) for note in surfaces.notes]),
        ("written", written + more),
    ]
    return (
        f"{head_of(volume)}\nsettings: {settings or 'the defaults'}\n\n{stage_table}\n\n{table(rows)}\n\n"
        f"{listing(shown)}"
    )
