# SPDX-License-Identifier: GPL-3.0-or-later
"""Share code of the figure commands: flags of page and style, reading, surfaces in a separate scene."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...blender.figure.spec import (
    PAGES,
    DistanceMapSettings,
    ExplodedView,
    FigureStyle,
    Page,
    ShownSurface,
    Transparency,
)
from ...core import (
    OutputError,
    Reconstruction,
    ReconstructionSettings,
    chosen_opacities,
    defaults,
    descriptions,
    opacities_of,
    require_opacities,
)
from ...core.files.atomic_write import own_folder
from ...core.files.input_files import plan_output
from ...core.solid import SolidRequest
from ...core.volume import ALL, ValueKind
from ...reporting.captions import figure_caption
from ..flags.arguments import (
    UsageError,
    add_input,
    add_opacity,
    add_settings,
    add_work,
    flags_checked,
    given_table,
    settings_and_labels,
    with_flags,
)
from ..flags.described import add_described, add_flag
from ..flags.maps import AskedMaps, add_maps, asked_maps
from ..flags.solid import NOTHING, may_have_parts
from ..machine.blender_host import objects_of, silence
from ..surfaces import Surfaces, explode_of, may_be_several
from ..terminal import dimensions, listing, titled


def add_common(parser: argparse.ArgumentParser, output: str, kind: str) -> None:
    """Add INPUT, the output, the settings, and the style flags of a figure kind, a name in `PAGES`."""
    add_input(parser)
    parser.add_argument("-o", "--output", required=True, metavar="OUTPUT", help=output)
    add_settings(parser, many=("label",))
    add_work(parser)
    group = parser.add_argument_group("figure")
    page = PAGES[kind]
    add_described(group, Page, {name: getattr(page, name) for name in descriptions(Page)})
    for name, about in descriptions(FigureStyle).items():
        if name != "columns" or kind == "sheet":
            add_flag(group, name, about, defaults(FigureStyle)[name])
    parser.set_defaults(kind=kind)


def values_of(args: argparse.Namespace, kind: type) -> dict[str, Any]:
    """Return the values that the flags and the table `[figure]` of --settings give a described dataclass, by name."""
    return {name: value for name, value in given_table(args, "figure").items() if name in descriptions(kind)}


def page_of(args: argparse.Namespace) -> Page:
    """Return the page that the flags give."""
    with flags_checked():
        return replace(PAGES[args.kind], **values_of(args, Page))


def style_of(args: argparse.Namespace) -> FigureStyle:
    """Return the style of the flags."""
    with flags_checked():
        return FigureStyle(**values_of(args, FigureStyle))


def map_of(args: argparse.Namespace) -> DistanceMapSettings:
    """Return whether the flags ask for a distance map, and where its colors end."""
    with flags_checked():
        return DistanceMapSettings(**values_of(args, DistanceMapSettings))


def only_one(args: argparse.Namespace, what: str) -> ReconstructionSettings:
    """Return the settings of the only surface, or a `UsageError`."""
    settings, choices = settings_and_labels(args)
    if may_be_several(choices):
        count = "all" if ALL in choices else len(choices)
        raise UsageError(f"{what} shows one label, not {count}; leave the others out")
    if any(isinstance(choice, str) for choice in choices):
        raise UsageError(f"{what} takes a label by its number, not {choices[0]!r}; ctmc info lists them")
    return settings


def with_output_folders(run: Callable[[argparse.Namespace], None]) -> Callable[[argparse.Namespace], None]:
    """Wrap `run`: make the folders of its outputs first, and remove those that stay empty.

    An output that is a file of the input is refused as soon as the input is opened.
    """

    def run_there(args: argparse.Namespace) -> None:
        with own_folder(Path(args.output).parent), own_folder(Path(args.blend or args.output).parent):
            for path in (args.output, args.blend):
                plan_output(path or args.output)
            run(args)

    return run_there


def exploded_by(args: argparse.Namespace) -> float:
    """Return the shift of the farthest surface in an exploded view, mm."""
    with flags_checked():
        return ExplodedView(**values_of(args, ExplodedView)).explode


def caption_of(
    results: Sequence[Reconstruction], kind: ValueKind, names: Sequence[str], style: FigureStyle, explode: float = 0.0
) -> str:
    """Return in a line what is shown; of a single surface with a map, its numbers too."""
    triangles = sum(len(result.mesh.faces) for result in results)
    name = names[0] if names else ""
    first = results[0]
    settings = [result.settings for result in results]
    caption = figure_caption(settings, first.spacing_mm, first.threshold, triangles, name, kind.mark, explode)
    maps = [each for each in first.maps if style.colors is not None and each.name == style.colors.name]
    if len(results) > 1 or not maps:
        return caption
    from ...blender.figure.map_colors import statistics_text

    return f"{caption}; {statistics_text(maps[0])}"


def add_distance_map(parser: argparse.ArgumentParser) -> None:
    """Add the flags for colors of distances to full resolution."""
    group = parser.add_argument_group("distance map")
    add_described(group, DistanceMapSettings)


def add_map_colors(parser: argparse.ArgumentParser, without: Sequence[str] = ()) -> None:
    """Add the flags for maps, of which one is shown, but those of some quantities."""
    add_maps(parser, without=without)


def maps_of(args: argparse.Namespace, settings: ReconstructionSettings) -> AskedMaps:
    """Return the maps that the flags ask for.

    Raises
    ------
    UsageError
        If maps cannot be made on these surfaces, or the colors are those of --deviation.
    """
    maps = asked_maps(args)
    if maps and settings.simplifies and settings.simplifier == "decimate":
        raise UsageError("maps are made on surfaces of the built-in simplifier; leave out --simplifier decimate")
    if maps and values_of(args, DistanceMapSettings).get("deviation") and args.kind == "figure":
        raise UsageError("a figure shows one map; leave out --deviation, or the other maps")
    return maps


def require_no_solid(solid: SolidRequest) -> None:
    """Raise `UsageError` for a solid, whose distance to the surface of the volume is not that of simplification."""
    if solid:
        raise UsageError("a deviation map shows the surface of the volume; leave out --deviation, or flags of solids")


def in_colors(style: FigureStyle, results: Sequence[Reconstruction], maps: AskedMaps) -> FigureStyle:
    """Return a style that shows the map that the flags choose; without maps the same."""
    if not maps:
        return style
    from ...blender.figure.map_colors import style_with_map

    return style_with_map(style, results, maps.shown)


def add_blend(parser: argparse.ArgumentParser) -> None:
    """Add the flags for the .blend."""
    parser.add_argument("--blend", metavar="FILE.blend", help="the figure's scene (default: beside the PNG)")
    parser.add_argument("--no-blend", action="store_true", help="write no .blend")


def blend_of(args: argparse.Namespace, target: Path) -> Path | None:
    """Return the path of the .blend."""
    if args.no_blend:
        return None
    blend = Path(args.blend) if args.blend else target.with_suffix(".blend")
    if blend.suffix.lower() != ".blend":
        raise OutputError(f"{blend.name} is not a .blend; the figure's scene is written as .blend")
    return blend


def add_surfaces(parser: argparse.ArgumentParser) -> None:
    """Add the flags for names and transparency of several labels."""
    group = parser.add_argument_group("several labels")
    group.add_argument("--names", nargs="+", metavar="NAME", help="names of the labels, for legend and caption")
    add_opacity(
        group, "opacities", "default: --hiding-opacity for structures that hide a tumor, otherwise by anatomical name"
    )
    add_described(group, Transparency)
    add_described(group, ExplodedView)


def require_names(args: argparse.Namespace, count: int) -> None:
    """Refuse names that are not one for every label.

    Parameters
    ----------
    args : argparse.Namespace
    count : int
        Of labels.

    Raises
    ------
    UsageError
        If their numbers differ.
    """
    if args.names and len(args.names) != count:
        raise UsageError(f"{len(args.names)} names for {count} surfaces; give one for each")


def require_surfaces(args: argparse.Namespace, choices: Sequence[int | str], solid: SolidRequest = NOTHING) -> None:
    """Raise `UsageError` if the number of names is not that of the surfaces, or one is to be moved apart.

    How many parts a solid has is known once they are made.
    """
    explode_of(args, may_be_several(choices) or may_have_parts(solid))
    if not solid and all(isinstance(choice, int) for choice in choices):
        require_names(args, max(1, len(choices)))


@contextmanager
def shown_of(
    args: argparse.Namespace, style: FigureStyle, surfaces: Surfaces
) -> Iterator[tuple[Any, tuple[ShownSurface, ...], list[Reconstruction]]]:
    """Yield a separate scene with an object for every surface, how each is shown, and the shown surfaces.

    Several have a name and their label's color; what hides a tumor is translucent.
    """
    from ...blender.figure.shown import shown_surfaces

    names = tuple(args.names or surfaces.names)
    results = (
        [replace(result, label_name=name) for result, name in zip(surfaces.results, args.names, strict=True)]
        if args.names
        else list(surfaces.results)
    )
    require_opacities(args.opacities, ((result.settings.label or 0, result.label_name) for result in results))
    with objects_of(results, names=names, opacities=opacities_of(results)) as (scene, objects, shown):
        opacities, clear = chosen_opacities(results, args.opacities), Transparency(**values_of(args, Transparency))
        with silence():  # most of this is NumPy, which an interrupt may end
            cell = shown_surfaces(objects, scene, style, names, opacities, clear, exploded_by(args))
        yield scene, cell, shown


def size_of(page: Page, size: tuple[int, int]) -> str:
    """Return a figure's size in words: '85 x 59.1 mm, 669 x 465 pixels, 200 dpi'.

    Parameters
    ----------
    page : Page
    size : (width, height) int
        Pixels.
    """
    width_mm, height_mm = (side / page.pixels_per_mm for side in size)
    return f"{page.width_mm or round(width_mm):g} x {height_mm:.1f} mm, {dimensions(size)} pixels, {page.dpi:g} dpi"


def summary(facts: Sequence[tuple[str, str]], notes: Sequence[str], files: Sequence[Path | None]) -> str:
    """Return the result as text: facts, notes, and the files that were written."""
    written = ", ".join(file.name for file in files if file is not None)
    return listing([*facts, *titled("note", [with_flags(note) for note in dict.fromkeys(notes)]), ("written", written)])
