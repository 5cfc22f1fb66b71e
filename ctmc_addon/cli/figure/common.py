"""What the figure commands share: flags of the page and of the look, reading, surfaces in a scene of their own."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...blender.figure.spec import ENGINES, STYLES
from ...core import (
    OutputError,
    Reconstruction,
    ReconstructionSettings,
    SettingsError,
    Steps,
    Volume,
    reconstruct_steps,
    within,
)
from ...reporting.atomic_write import own_folder
from ...reporting.captions import figure_caption
from ..arguments import add_input, add_settings, given_settings, overridden
from ..blender_host import blender_at_work, load_scene
from ..commands.reconstruct import Work, volume_steps
from ..terminal import Progress, by, listing


def add_common(parser: argparse.ArgumentParser, output: str, width_mm: float, dpi: float) -> None:
    """INPUT, the output, the settings, and how a figure looks."""
    add_input(parser)
    parser.add_argument("-o", "--output", required=True, metavar="OUTPUT", help=output)
    add_settings(parser, many=("label",))
    parser.add_argument("--threads", type=int, metavar="N", help="default: one for each processor, at most 8")
    group = parser.add_argument_group("figure")
    group.add_argument(
        "--style",
        choices=STYLES,
        help="paper: red faces, yellow triangle edges (default); clinical: smooth, in the labels' colours (default for "
        "several labels); print: grey faces, dark edges",
    )
    group.add_argument("--edges", action=argparse.BooleanOptionalAction, help="triangle edges (default: the style's)")
    group.add_argument("--width-mm", type=float, default=width_mm, metavar="MM", help=f"(default {width_mm:g})")
    group.add_argument("--height-mm", type=float, metavar="MM", help="default: what the surface needs")
    group.add_argument("--dpi", type=float, default=dpi, metavar="N", help=f"pixels to the inch (default {dpi:g})")
    group.add_argument("--font-pt", type=float, default=8.0, metavar="PT", help="letters (default 8; turntables 12)")
    group.add_argument("--transparent", action="store_true", help="no background instead of a white one")
    group.add_argument("--azimuth", type=float, default=30.0, metavar="DEG", help="camera, from the front to the left")
    group.add_argument("--elevation", type=float, default=20.0, metavar="DEG", help="camera, upwards (default 20)")
    group.add_argument("--scale-bar", action=argparse.BooleanOptionalAction, default=True, help="(default: yes)")
    group.add_argument(
        "--orientation", action=argparse.BooleanOptionalAction, default=True, help="R L A P S I (default: yes)"
    )
    group.add_argument("--caption", metavar="TEXT", help="under the figure; '' for none")
    group.add_argument(
        "--engine", choices=ENGINES, default="cycles", help="cycles works on any machine; the others need EGL on Linux"
    )


def page_of(chosen: argparse.Namespace) -> Any:
    """The page that was asked for."""
    scene = load_scene()
    return scene.Page(chosen.width_mm, chosen.dpi, chosen.height_mm, chosen.transparent, chosen.font_pt)


def look_of(chosen: argparse.Namespace, several: bool, caption: str) -> Any:
    """The look that was asked for; `caption` where none was."""
    return load_scene().Look(
        style=chosen.style or ("clinical" if several else "paper"),
        engine=chosen.engine,
        azimuth=chosen.azimuth,
        elevation=chosen.elevation,
        edges=chosen.edges,
        scale_bar=chosen.scale_bar,
        orientation=chosen.orientation,
        caption=caption if chosen.caption is None else chosen.caption,
    )


def settings_of(chosen: argparse.Namespace) -> list[ReconstructionSettings]:
    """The settings that were asked for, one for every label."""
    values = given_settings(chosen)
    labels = values.get("label")
    if not isinstance(labels, list):
        return [ReconstructionSettings(**values)]
    labels = list(dict.fromkeys(labels))
    return [ReconstructionSettings(**overridden(values, {"label": label})) for label in labels]


def only_one(settings: Sequence[ReconstructionSettings], what: str) -> ReconstructionSettings:
    """The only settings, or a `SettingsError`."""
    if len(settings) > 1:
        raise SettingsError(f"{what} shows one label, not {len(settings)}; leave the others out")
    return settings[0]


def in_made_folders(run: Callable[[argparse.Namespace], None]) -> Callable[[argparse.Namespace], None]:
    """`run` with the folders of its outputs made, and removed again if nothing is written to them."""

    def running(chosen: argparse.Namespace) -> None:
        with own_folder(Path(chosen.output).parent), own_folder(Path(chosen.blend or chosen.output).parent):
            run(chosen)

    return running


def volume_of(chosen: argparse.Namespace, settings: ReconstructionSettings, work: Work, progress: Progress) -> Volume:
    """Read INPUT, the first tenth of the work."""
    return progress.drive(within(volume_steps(chosen, settings, work), 0.0, 0.1))


def surfaces_steps(
    volume: Volume, every: Sequence[ReconstructionSettings], threads: int | None
) -> Steps[list[Reconstruction]]:
    """A surface for each of the settings."""
    results = []
    for at, settings in enumerate(every):
        steps = reconstruct_steps(volume, settings, threads)
        results.append((yield from within(steps, at / len(every), (at + 1) / len(every))))
    return results


@contextmanager
def objects_of(results: Sequence[Reconstruction]) -> Iterator[tuple[Any, list[Any], list[Reconstruction]]]:
    """A scene of its own with an object for every surface, and the surfaces as the objects show them."""
    scene = load_scene()
    import bpy

    home = bpy.data.scenes.new("CTMC")
    things: list[Any] = []
    try:
        with blender_at_work():
            things += [scene.add_reconstruction(result, home) for result in results]
            shown = [
                replace(result, mesh=scene.evaluated_triangles(thing, home))
                if result.settings.simplifies and result.settings.simplifier == "decimate"
                else result
                for result, thing in zip(results, things, strict=True)
            ]
        yield home, things, shown
    finally:
        for thing in things:
            bpy.data.meshes.remove(thing.data)  # and the object with it
        bpy.data.scenes.remove(home)


def caption_of(results: Sequence[Reconstruction], names: Sequence[str] = ()) -> str:
    """What is shown, in a line."""
    triangles = sum(len(result.mesh.faces) for result in results)
    name = names[0] if names else ""
    return figure_caption([result.settings for result in results], results[0].threshold, triangles, name)


def add_map(parser: argparse.ArgumentParser) -> None:
    """Colours of distances."""
    group = parser.add_argument_group("map of distances")
    group.add_argument(
        "--deviation",
        action="store_true",
        help="colour the surface by its distance to the surface of full resolution, with a colour bar",
    )
    group.add_argument("--limit-mm", type=float, metavar="MM", help="end of the colour bar (default: 99 %% are within)")


def add_blend(parser: argparse.ArgumentParser) -> None:
    """Where the .blend goes."""
    parser.add_argument("--blend", metavar="FILE.blend", help="the figure's scene (default: beside the PNG)")
    parser.add_argument("--no-blend", action="store_true", help="write no .blend")


def blend_of(chosen: argparse.Namespace, target: Path) -> Path | None:
    """Where the .blend goes."""
    if chosen.no_blend:
        return None
    blend = Path(chosen.blend) if chosen.blend else target.with_suffix(".blend")
    if blend.suffix.lower() != ".blend":
        raise OutputError(f"{blend.name} is no .blend; the figure's scene is written as .blend")
    return blend


def add_surfaces(parser: argparse.ArgumentParser) -> None:
    """Names and transparency of several labels."""
    group = parser.add_argument_group("several labels")
    group.add_argument("--names", nargs="+", metavar="NAME", help="of the labels, for legend and caption")
    group.add_argument(
        "--see-through",
        type=int,
        action="append",
        metavar="N",
        help="a label to see through (default: what holds the others)",
    )
    group.add_argument("--opacity", type=float, default=0.3, metavar="A", help="of what is seen through (default 0.3)")


def require_names(chosen: argparse.Namespace, count: int) -> None:
    """Raise `SettingsError` for names that are not one for every label, or an opacity out of its limits."""
    if chosen.names and len(chosen.names) != count:
        raise SettingsError(f"{len(chosen.names)} names for {count} surfaces; give one for each")
    if not 0.02 <= chosen.opacity <= 1:
        raise SettingsError(f"opacity must be from 0.02 to 1, not {chosen.opacity:g}")


def shown_of(chosen: argparse.Namespace, things: Sequence[Any], results: Sequence[Reconstruction]) -> list[Any]:
    """How every surface is shown: several have a name and their label's colour, and the outermost is seen through."""
    scene = load_scene()
    if len(results) == 1:
        return [scene.Shown(things[0])]
    labels = [result.settings.label for result in results]
    names = chosen.names or [f"label {label}" for label in labels]
    unknown = [label for label in chosen.see_through or () if label not in labels]
    if unknown:
        raise SettingsError(f"label {unknown[0]} is to be seen through and is not shown; the labels are {labels}")
    meshes = [result.mesh for result in results]
    clear = chosen.see_through or [
        label for label, mesh in zip(labels, meshes, strict=True) if scene.holds_others(mesh, meshes)
    ]
    return [
        scene.Shown(
            thing,
            name,
            scene.colour_of(label) if chosen.style != "print" else None,
            chosen.opacity if label in clear else 1.0,
        )
        for thing, name, label in zip(things, names, labels, strict=True)
    ]


def size_of(page: Any, size: tuple[int, int]) -> str:
    """A figure's size: '85 x 59.1 mm, 669 x 465 pixels, 200 dpi'."""
    return f"{page.width_mm:g} x {size[1] / page.pixels_per_mm:.1f} mm, {by(size)} pixels, {page.dpi:g} dpi"


def told(facts: Sequence[tuple[str, str]], notes: Sequence[str], files: Sequence[Path | None]) -> str:
    """What came out, for a person: facts, notes, and the files that were written."""
    said = [("note" if not at else "", note) for at, note in enumerate(dict.fromkeys(notes))]
    written = ", ".join(file.name for file in files if file is not None)
    return listing([*facts, *said, ("written", written)])
