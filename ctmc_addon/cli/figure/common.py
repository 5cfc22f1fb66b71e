# SPDX-License-Identifier: GPL-3.0-or-later
"""What the figure commands share: flags of the page and of the look, reading, surfaces in a scene of their own."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ...blender.colors import color_of
from ...blender.figure.spec import (
    AZIMUTH,
    ELEVATION,
    ENGINES,
    OPACITIES,
    STYLES,
    FigureStyle,
    Page,
    ShownSurface,
    require_within,
)
from ...core import OutputError, Reconstruction, ReconstructionSettings
from ...core.files.atomic_write import own_folder
from ...core.volume import ALL
from ...reporting.captions import figure_caption
from ..arguments import (
    UsageError,
    add_input,
    add_settings,
    add_work,
    flags_checked,
    settings_and_labels,
)
from ..surfaces import Surfaces, may_be_several
from ..terminal import dimensions, listing, titled


def add_common(parser: argparse.ArgumentParser, output: str, width_mm: float, dpi: float) -> None:
    """INPUT, the output, the settings, and how a figure looks."""
    add_input(parser)
    parser.add_argument("-o", "--output", required=True, metavar="OUTPUT", help=output)
    add_settings(parser, many=("label",))
    add_work(parser)
    group = parser.add_argument_group("figure")
    group.add_argument(
        "--style",
        choices=tuple(STYLES),
        help="; ".join(f"{name}: {style.text}" for name, style in STYLES.items())
        + " (default paper, of several labels clinical)",
    )
    group.add_argument("--edges", action=argparse.BooleanOptionalAction, help="triangle edges (default: the style's)")
    group.add_argument("--width-mm", type=float, default=width_mm, metavar="MM", help=f"(default {width_mm:g})")
    group.add_argument("--height-mm", type=float, metavar="MM", help="default: what the surface needs")
    group.add_argument("--dpi", type=float, default=dpi, metavar="N", help=f"pixels to the inch (default {dpi:g})")
    group.add_argument("--font-pt", type=float, default=8.0, metavar="PT", help="letters (default 8; turntables 12)")
    group.add_argument("--transparent", action="store_true", help="no background instead of a white one")
    group.add_argument(
        "--azimuth", type=float, default=AZIMUTH, metavar="DEG", help="camera, from the front to the left"
    )
    group.add_argument(
        "--elevation", type=float, default=ELEVATION, metavar="DEG", help=f"camera, upwards (default {ELEVATION:g})"
    )
    group.add_argument("--scale-bar", action=argparse.BooleanOptionalAction, default=True, help="(default: yes)")
    group.add_argument(
        "--orientation", action=argparse.BooleanOptionalAction, default=True, help="R L A P S I (default: yes)"
    )
    group.add_argument("--caption", metavar="TEXT", help="under the figure; '' for none")
    group.add_argument(
        "--engine",
        choices=tuple(ENGINES),
        default=FigureStyle().engine,
        help="cycles works on any machine; the others need EGL on Linux",
    )


def page_of(args: argparse.Namespace) -> Page:
    """The page that the flags give."""
    with flags_checked():
        return Page(args.width_mm, args.dpi, args.height_mm, args.transparent, args.font_pt)


def style_of(args: argparse.Namespace, several: bool = False) -> FigureStyle:
    """How the flags have one or several surfaces look."""
    with flags_checked():
        return FigureStyle(
            style=args.style or ("clinical" if several else "paper"),
            engine=args.engine,
            azimuth=args.azimuth,
            elevation=args.elevation,
            edges=args.edges,
            scale_bar=args.scale_bar,
            orientation=args.orientation,
            caption=args.caption or "",
        )


def only_one(args: argparse.Namespace, what: str) -> ReconstructionSettings:
    """The settings of the only surface, or a `UsageError`."""
    settings, choices = settings_and_labels(args)
    if may_be_several(choices):
        count = "all" if ALL in choices else len(choices)
        raise UsageError(f"{what} shows one label, not {count}; leave the others out")
    if any(isinstance(choice, str) for choice in choices):
        raise UsageError(f"{what} takes a label by its number, not {choices[0]!r}; ctmc info lists them")
    return settings


def in_made_folders(run: Callable[[argparse.Namespace], None]) -> Callable[[argparse.Namespace], None]:
    """`run` with the folders of its outputs made, and removed again if nothing is written to them."""

    def run_there(args: argparse.Namespace) -> None:
        with own_folder(Path(args.output).parent), own_folder(Path(args.blend or args.output).parent):
            run(args)

    return run_there


def caption_of(results: Sequence[Reconstruction], names: Sequence[str] = ()) -> str:
    """What is shown, in a line."""
    triangles = sum(len(result.mesh.faces) for result in results)
    name = names[0] if names else ""
    first = results[0]
    return figure_caption([result.settings for result in results], first.spacing_mm, first.threshold, triangles, name)


def add_map(parser: argparse.ArgumentParser) -> None:
    """Colors of distances."""
    group = parser.add_argument_group("map of distances")
    group.add_argument(
        "--deviation",
        action="store_true",
        help="color the surface by its distance to the surface of full resolution, with a color bar",
    )
    group.add_argument("--limit-mm", type=float, metavar="MM", help="end of the color bar (default: 99 %% are within)")


def add_blend(parser: argparse.ArgumentParser) -> None:
    """Where the .blend goes."""
    parser.add_argument("--blend", metavar="FILE.blend", help="the figure's scene (default: beside the PNG)")
    parser.add_argument("--no-blend", action="store_true", help="write no .blend")


def blend_of(args: argparse.Namespace, target: Path) -> Path | None:
    """Where the .blend goes."""
    if args.no_blend:
        return None
    blend = Path(args.blend) if args.blend else target.with_suffix(".blend")
    if blend.suffix.lower() != ".blend":
        raise OutputError(f"{blend.name} is not a .blend; the figure's scene is written as .blend")
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
        help="a transparent label (default: what holds the others)",
    )
    group.add_argument("--opacity", type=float, default=0.3, metavar="A", help="of transparent labels (default 0.3)")


def require_names(args: argparse.Namespace, count: int) -> None:
    """Raise `UsageError` for names that are not one for every label."""
    if args.names and len(args.names) != count:
        raise UsageError(f"{len(args.names)} names for {count} surfaces; give one for each")


def require_surfaces(args: argparse.Namespace, choices: Sequence[int | str]) -> None:
    """Raise `UsageError` for an opacity out of its limits, and for names of labels that are known to be others."""
    with flags_checked():
        require_within("opacity", args.opacity, OPACITIES)
    if all(isinstance(choice, int) for choice in choices):
        require_names(args, max(1, len(choices)))


def shown_of(args: argparse.Namespace, objects: Sequence[Any], surfaces: Surfaces) -> tuple[ShownSurface, ...]:
    """How every surface is shown: several have a name and their label's color, and the outermost is transparent."""
    from ...blender.figure.sheet import holds_others

    results = surfaces.results
    if len(results) == 1 and not args.names:
        return (ShownSurface(objects[0], "".join(surfaces.names)),)
    labels = [result.settings.label for result in results]
    names = args.names or surfaces.names
    unknown = [label for label in args.see_through or () if label not in labels]
    if unknown:
        raise UsageError(f"label {unknown[0]} is to be transparent and is not shown; the labels are {labels}")
    meshes = [result.mesh for result in results]
    transparent = args.see_through or [
        label for label, mesh in zip(labels, meshes, strict=True) if holds_others(mesh, meshes)
    ]
    return tuple(
        ShownSurface(
            obj,
            name,
            color_of(label, result.label_color) if args.style != "print" else None,
            args.opacity if label in transparent else 1.0,
        )
        for obj, name, label, result in zip(objects, names, labels, results, strict=True)
    )


def size_of(page: Page, size: tuple[int, int]) -> str:
    """A figure's size: '85 x 59.1 mm, 669 x 465 pixels, 200 dpi'."""
    return f"{page.width_mm:g} x {size[1] / page.pixels_per_mm:.1f} mm, {dimensions(size)} pixels, {page.dpi:g} dpi"


def summary(facts: Sequence[tuple[str, str]], notes: Sequence[str], files: Sequence[Path | None]) -> str:
    """What came out, for a person: facts, notes, and the files that were written."""
    written = ", ".join(file.name for file in files if file is not None)
    return listing([*facts, *titled("note", list(dict.fromkeys(notes))), ("written", written)])
