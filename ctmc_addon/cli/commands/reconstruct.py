"""`ctmc reconstruct INPUT -o OUTPUT`: a volume in, a surface file out."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ... import readers
from ...core import (
    LabelError,
    Reconstruction,
    ReconstructionSettings,
    Stage,
    Step,
    Steps,
    Volume,
    reconstruct_steps,
    within,
)
from ...reporting.atomic_write import require_writable, whole_files, write_json
from ..arguments import add_input, add_settings, command_of, reading_of, settings_from
from ..blender_host import blender_at_work, load_scene
from ..terminal import Progress, by, listing, table


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


@dataclass
class Work:
    """What one reconstruction collects on its way: the stages outside core, and what the command has to say."""

    stages: list[Stage] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Add a stage with the seconds of the block."""
        start = time.perf_counter()
        yield
        self.stages.append(Stage(name, time.perf_counter() - start))


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`."""
    parser = commands.add_parser(
        "reconstruct",
        help="make a surface from a volume",
        description="Make a surface from a CT stack or a label volume. Without --threshold or --label "
        "Otsu's threshold is used.",
        allow_abbrev=False,
    )
    add_input(parser)
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="OUTPUT",
        help=".stl, .ply, .obj, .glb or .blend; its folder must exist",
    )
    add_settings(parser)
    group = parser.add_argument_group("output")
    group.add_argument(
        "--space", choices=("ras", "lps"), default="ras", help="axes of .stl, .ply and .obj, mm (default ras)"
    )
    group.add_argument("--report", metavar="FILE.json", help="counts, measures, stages, settings and notes")
    group.add_argument("--figure", metavar="FILE.png", help="a picture: red faces, yellow triangle edges")
    group.add_argument("--threads", type=int, metavar="N", help="default: one for each processor, at most 8")
    parser.set_defaults(run=run)


def run(chosen: argparse.Namespace) -> None:
    """Read, reconstruct, write, and print what came out."""
    settings = settings_from(chosen)
    scene = load_scene()
    outputs = Outputs(
        (require_writable(chosen.output, scene.SUFFIXES),),
        require_writable(chosen.report, (".json",)) if chosen.report else None,
        require_writable(chosen.figure, (".png",)) if chosen.figure else None,
        chosen.space,
    )
    work = Work()
    with Progress() as progress:
        volume = progress.drive(within(volume_steps(chosen, settings, work), 0.0, 0.3))
        result = progress.drive(within(reconstruct_steps(volume, settings, chosen.threads), 0.3, 0.9))
        result = progress.drive(within(written_steps(result, outputs, work), 0.9, 1.0))
    print(summary(result, volume, outputs, work.notes))


def volume_steps(chosen: argparse.Namespace, settings: ReconstructionSettings, work: Work) -> Steps[Volume]:
    """Read INPUT; of a LiTS volume whose label is asked for, its segmentation."""
    path = Path(chosen.input)
    source, notes = source_of(path, settings.label)
    work.notes += notes
    with work.timed("Reading"):
        volume = yield from readers.read_volume_steps(source, **reading_of(chosen))
    require_label_volume(volume, path, settings.label)
    return volume


def source_of(path: Path, label: int | None) -> tuple[Path, list[str]]:
    """The file to read, for a label that of a LiTS volume's segmentation, and a note if it is another than `path`."""
    sibling = readers.segmentation_sibling(path) if label is not None else None
    if sibling is None:
        return path, []
    return sibling, [f"{path.name} holds grey values: label {label} is taken from {sibling.name} beside it"]


def require_label_volume(volume: Volume, path: Path, label: int | None) -> None:
    """Raise `LabelError` if a label is asked of Hounsfield units."""
    if label is not None and volume.kind == "HU":
        raise LabelError(
            f"{path.name} holds HU, in which {label} is a density and no label; give the label volume, or --threshold"
        )


def written_steps(result: Reconstruction, outputs: Outputs, work: Work) -> Steps[Reconstruction]:
    """Write every output, all or none, and return the result as it was written."""
    with whole_files(outputs.paths) as places:
        result = yield from object_steps(result, outputs, places, work)
        first = [stage for stage in work.stages if stage.name == "Reading"]
        last = [stage for stage in work.stages if stage.name != "Reading"]
        result = replace(result, stages=(*first, *result.stages, *last), notes=(*work.notes, *result.notes))
        if outputs.report is not None:
            yield Step(0.98, f"Writing {outputs.report.name}")
            write_json(places[outputs.report], result.report() | {"files": outputs.names})
    return result


def object_steps(
    result: Reconstruction, outputs: Outputs, places: Mapping[Path, Path], work: Work
) -> Steps[Reconstruction]:
    """Make the Blender object and write what shows it to `places`; returns the result as it was written."""
    scene = load_scene()
    import bpy

    home = bpy.data.scenes.new("reconstruct")  # "CTMC" is the name of the scene in a .blend
    thing = None
    try:
        with work.timed("Building the object"), blender_at_work():
            thing = scene.add_reconstruction(result, home)
            if result.settings.simplifies and result.settings.simplifier == "decimate":
                # What is written is what the live modifier leaves.
                result = replace(result, mesh=scene.evaluated_triangles(thing, home))
        for path in outputs.surfaces:
            yield Step(0.2, f"Writing {path.name}")
            with work.timed(f"Writing {path.suffix.lower()}"), blender_at_work():
                scene.export(thing, places[path], space=outputs.space, scene=home)
        if outputs.figure is not None:
            yield Step(0.5, f"Rendering {outputs.figure.name}")
            with work.timed("Rendering the figure"), blender_at_work():
                small = {} if outputs.thumbnail is None else {"size": outputs.thumbnail, "edges": False}
                scene.render_figure(thing, home, places[outputs.figure], **small)
    finally:
        if thing is not None:
            bpy.data.meshes.remove(thing.data)  # and the object with it
        bpy.data.scenes.remove(home)
    return result


def summary(result: Reconstruction, volume: Volume, outputs: Outputs, notes: list[str]) -> str:
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
        ("threshold", f"{result.threshold:.6g}"),
        ("voxels", f"{result.voxels_visited} visited"),
    ]
    facts += [("note" if not at else "", note) for at, note in enumerate(report["notes"])]
    facts.append(("written", ", ".join(outputs.names)))
    head = f"{volume.name}: {by(volume.size)}, {by(volume.spacing)} mm"
    settings = f"settings: {command_of(result.settings) or 'the defaults'}"
    stage_table = table([("stage", "seconds"), *stages, ("together", f"{total:.3f}")])
    return f"{head}\n{settings}\n\n{stage_table}\n\n{listing(facts)}"
