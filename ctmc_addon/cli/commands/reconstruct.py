# SPDX-License-Identifier: GPL-3.0-or-later
"""`ctmc reconstruct INPUT -o OUTPUT`: a volume in, a surface file out."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from ... import readers
from ...core import (
    LabelError,
    Reconstruction,
    ReconstructionSettings,
    Stage,
    Stages,
    Step,
    Steps,
    Volume,
    equal_part,
    reconstruct_steps,
)
from ...core.files import mesh_files
from ...core.files.atomic_write import require_writable, whole_files, write_json
from ...core.mesh import SMALL
from ...core.streaming import fits_in_memory
from ...core.volume import SlabVolume
from ...reporting.formatting import count
from ..arguments import add_input, add_settings, add_work, command_of, reading_of, settings_from
from ..blender_host import blender_at_work, objects_of, require_blender
from ..terminal import Progress, dimensions, listing, table, titled
from .slabs import workers_of

AnyVolume = TypeVar("AnyVolume", Volume, SlabVolume)
STAGES = {"Reading": 3, "Reconstructing": 6, "Writing": 1}


@dataclass(frozen=True)
class Outputs:
    """Files to write."""

    surfaces: tuple[Path, ...]
    report: Path | None = None
    figure: Path | None = None
    space: str = "ras"
    thumbnail: tuple[int, int] | None = None  # pixels of a small figure without edges

    @property
    def paths(self) -> list[Path]:
        """All of them, in the order in which they are written."""
        return [path for path in (*self.surfaces, self.figure, self.report) if path is not None]

    @property
    def names(self) -> list[str]:
        """Names without folders."""
        return [path.name for path in self.paths]

    def blender_needed_for(self, simplifier: str) -> str:
        """What Blender is needed for, empty if for nothing."""
        if simplifier == "decimate":
            return "--simplifier decimate"
        suffixes = [path.suffix.lower() for path in self.surfaces if path.suffix.lower() not in mesh_files.SUFFIXES]
        return f"writing {suffixes[0]}" if suffixes else "rendering a figure" if self.figure else ""


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`."""
    parser = commands.add_parser(
        "reconstruct",
        help="make a surface from a volume",
        description="Make a surface from a CT stack or a label volume. Without --threshold or --label "
        "Otsu's threshold is used.",
    )
    add_input(parser)
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="OUTPUT",
        help=f"{', '.join(mesh_files.SURFACE_SUFFIXES)}; its folder must exist",
    )
    add_settings(parser)
    group = parser.add_argument_group("output")
    group.add_argument(
        "--space", choices=mesh_files.SPACES, default="ras", help="axes of .stl, .ply and .obj, mm (default ras)"
    )
    group.add_argument("--report", metavar="FILE.json", help="counts, measures, stages, settings and notes")
    group.add_argument("--figure", metavar="FILE.png", help="a picture: red faces, yellow triangle edges")
    add_work(group)
    group.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="have slabs extracted by a dask.distributed cluster that sees INPUT, such as tcp://host:8786",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Read, reconstruct, write, and print what came out."""
    settings = settings_from(args)
    outputs = Outputs(
        (require_writable(args.output, mesh_files.SURFACE_SUFFIXES),),
        require_writable(args.report, (".json",)) if args.report else None,
        require_writable(args.figure, (".png",)) if args.figure else None,
        args.space,
    )
    if purpose := outputs.blender_needed_for(settings.simplifier):
        require_blender(purpose)
    stages = Stages(STAGES)
    source = source_of(Path(args.input), settings.label)
    with Progress() as progress, workers_of(args.scheduler, source, reading_of(args)) as workers:
        volume = progress.finish(stages.run("Reading", fetched_steps(args, settings)))
        reconstructing = reconstruct_steps(volume, settings, args.threads, workers=workers)
        result = progress.finish(stages.run("Reconstructing", reconstructing))
        result = replace(result, stages=(Stage("Reading", stages.seconds["Reading"]), *result.stages))
        result = progress.finish(stages.run("Writing", written_steps(result, outputs)))
    print(summary(result, volume, outputs))


def volume_steps(path: str | Path, reading: Mapping[str, Any], label: int | None) -> Steps[Volume]:
    """Read a volume; of a LiTS volume whose label is asked for, its segmentation, which a note says."""
    path = Path(path)
    stages = Stages({"Reading headers": 1, "Reading values": 4})
    source = yield from stages.run("Reading headers", readers.open_volume_steps(source_of(path, label)))
    return (yield from stages.run("Reading values", values_steps(source, path, reading, label)))


def input_steps(args: argparse.Namespace, settings: ReconstructionSettings) -> Steps[Volume]:
    """Read INPUT as the flags say."""
    volume = yield from volume_steps(args.input, reading_of(args), settings.label)
    return replace(volume, name=args.name or volume.name)


def fetched_steps(args: argparse.Namespace, settings: ReconstructionSettings) -> Steps[Volume | SlabVolume]:
    """Read INPUT as the flags say; where only some of it is wanted or it does not fit, values are fetched later."""
    path = Path(args.input)
    stages = Stages({"Reading headers": 1, "Reading values": 4})
    opening = readers.open_volume_steps(source_of(path, settings.label))
    source = yield from stages.run("Reading headers", opening)
    needed = needed_steps(source, path, reading_of(args), settings, bool(args.scheduler))
    volume = yield from stages.run("Reading values", needed)
    return replace(volume, name=args.name or volume.name)


def needed_steps(
    source: readers.VolumeSource,
    path: Path,
    reading: Mapping[str, Any],
    settings: ReconstructionSettings,
    by_workers: bool = False,
) -> Steps[Volume | SlabVolume]:
    """Read what was opened for `path`; where only some of it is wanted or it does not fit, values are fetched later."""
    if not by_workers and reads_whole(source, reading, settings):
        return (yield from values_steps(source, path, reading, settings.label))
    return checked((yield from source.slabs_steps(**reading)), source, path, settings.label)


def reads_whole(source: readers.VolumeSource, reading: Mapping[str, Any], settings: ReconstructionSettings) -> bool:
    """Whether all values are wanted and leave memory for a surface."""
    series = source.selected_series(reading["series"])
    if settings.region is not None or max(settings.stride) > 1:
        return False
    if series is None:
        return True
    return fits_in_memory(math.prod(series.shape) * series.voxel_bytes)


def values_steps(
    source: readers.VolumeSource, path: Path, reading: Mapping[str, Any], label: int | None
) -> Steps[Volume]:
    """Read what was opened for `path`."""
    return checked((yield from source.read_steps(**reading)), source, path, label)


def checked(volume: AnyVolume, source: readers.VolumeSource, path: Path, label: int | None) -> AnyVolume:
    """The volume with a note of where its label is taken from, or an error where it cannot have one."""
    if label is not None and volume.kind == "HU":
        raise LabelError(
            f"{path.name} holds HU, in which {label} is a density and not a label; "
            "give the label volume, or --threshold"
        )
    if source.path != path:
        note = f"{path.name} holds gray values: label {label} is taken from {source.path.name} beside it"
        return replace(volume, notes=(note, *volume.notes))
    return volume


def surfaces_steps(
    volume: Volume, variants: Sequence[ReconstructionSettings], threads: int | None
) -> Steps[list[Reconstruction]]:
    """A surface for each of the settings."""
    results = []
    for at, settings in enumerate(variants):
        results.append((yield from equal_part(reconstruct_steps(volume, settings, threads), at, len(variants))))
    return results


def source_of(path: Path, label: int | None) -> Path:
    """The file to read: for a label that of a LiTS volume's segmentation."""
    return (readers.segmentation_sibling(path) if label is not None else None) or path


def written_steps(result: Reconstruction, outputs: Outputs) -> Steps[Reconstruction]:
    """Write every output, all or none, and return the result as it was written."""
    with whole_files(outputs.paths) as places:
        if outputs.blender_needed_for(result.settings.simplifier):
            result = yield from with_blender_steps(result, outputs, places)
        stages: list[Stage] = []
        for path in outputs.surfaces:
            if path.suffix.lower() in mesh_files.SUFFIXES:
                yield Step(0.8, f"Writing {path.name}")
                with timed(stages, f"Writing {path.suffix.lower()}"):
                    result.mesh.save(places[path], outputs.space)
        result = replace(result, stages=(*result.stages, *stages))
        if outputs.report is not None:
            yield Step(0.9, f"Writing {outputs.report.name}")
            write_json(places[outputs.report], result.report() | {"files": outputs.names})
    return result


def with_blender_steps(result: Reconstruction, outputs: Outputs, places: Mapping[Path, Path]) -> Steps[Reconstruction]:
    """Make an object in a scene of its own, and write what only Blender writes; returns the result as it is shown."""
    from ...blender.export import export
    from ...blender.figure.render import render_figure

    yield Step(0.0, "Building the object")
    stages: list[Stage] = []
    start = time.perf_counter()
    # A .blend has a scene "CTMC", a name that only one can have.
    with objects_of([result], "CTMC objects") as (scene, [obj], [result]):
        stages.append(Stage("Building the object", time.perf_counter() - start))
        for path in outputs.surfaces:
            if path.suffix.lower() not in mesh_files.SUFFIXES:
                yield Step(0.2, f"Writing {path.name}")
                with timed(stages, f"Writing {path.suffix.lower()}"), blender_at_work():
                    export(obj, places[path], space=outputs.space, scene=scene)
        if outputs.figure is not None:
            yield Step(0.4, f"Rendering {outputs.figure.name}")
            with timed(stages, "Rendering the figure"), blender_at_work():
                small: dict[str, Any] = {"size": outputs.thumbnail, "edges": False} if outputs.thumbnail else {}
                render_figure(obj, scene, places[outputs.figure], **small)
    return replace(result, stages=(*result.stages, *stages))


@contextmanager
def timed(stages: list[Stage], name: str) -> Iterator[None]:
    """Add a stage with the seconds of the block."""
    start = time.perf_counter()
    yield
    stages.append(Stage(name, time.perf_counter() - start))


def small_components_lines(result: Reconstruction) -> list[str]:
    """Return how many components are small and which flag removes them; empty where they are few or were removed."""
    measures = result.mesh.measures
    if not measures.has_many_small_components or result.settings.min_part_mm3 >= SMALL:
        return []
    counts = f"{count(measures.small_components)} of {count(measures.components)} components"
    return [f"{counts} are smaller than {SMALL:g} mm3; --min-part {SMALL:g} removes them"]


def summary(result: Reconstruction, volume: Volume | SlabVolume, outputs: Outputs) -> str:
    """Settings, stages, counts, measures and notes, for a person."""
    report = result.report()
    stages = [(stage.name, f"{stage.seconds:.3f}") for stage in result.stages]
    total = sum(stage.seconds for stage in result.stages)
    faces = f"{report['faces']}"
    if report["full_faces"] != report["faces"]:
        faces += f" of {report['full_faces']}"
    shape = "closed" if report["closed"] else "open"
    volume_mm3 = report["volume_mm3"]
    parts = f"{report['parts']} {'part' if report['parts'] == 1 else 'parts'}"
    facts = [
        ("triangles", faces),
        ("volume", "-" if volume_mm3 is None else f"{volume_mm3 / 1000:.3f} ml ({volume_mm3:.1f} mm3)"),
        ("area", f"{report['area_mm2'] / 100:.2f} cm2"),
        ("surface", f"{shape}, {parts}, Euler number {report['euler']}"),
        *(("small", line) for line in small_components_lines(result)),
        ("threshold", f"{result.threshold:.6g}"),
        ("voxels", f"{result.voxels_visited} visited"),
        *titled("note", report["notes"]),
        ("written", ", ".join(outputs.names)),
    ]
    head = f"{volume.name}: {dimensions(volume.size)}, {dimensions(volume.spacing)} mm"
    settings = f"settings: {command_of(result.settings) or 'the defaults'}"
    stage_table = table([("stage", "seconds"), *stages, ("together", f"{total:.3f}")])
    return f"{head}\n{settings}\n\n{stage_table}\n\n{listing(facts)}"
