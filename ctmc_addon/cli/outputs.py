# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the files of surfaces: one for all of them, or one for each; a report and a picture; all, or none."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..core import (
    Budget,
    OutputError,
    Reconstruction,
    Stage,
    Step,
    Steps,
    chosen_opacities,
    files_of,
    opacities_of,
    structures_of,
    triangle_bytes,
)
from ..core.files import mesh_files
from ..core.files.atomic_write import require_writable, whole_files, write_json
from ..core.files.file_names import file_names
from ..core.mesh import coarse_mesh
from .machine.blender_host import blender_at_work, objects_of, quiet_steps
from .surface_writer import SurfaceWriter, surface_writer
from .surfaces import Surfaces

THUMBNAIL_FACES = 100_000  # Enough for a picture of 160 x 120 pixels.
FEWEST_FACES = 200  # Each of many surfaces keeps this many.


@dataclass(frozen=True)
class Outputs:
    """The files that a command writes.

    Parameters
    ----------
    surfaces : tuple of Path
        Files that hold all surfaces each.
    report, figure : Path or None
    space : {"ras", "lps"}
    thumbnail : (width, height) int or None
        Pixels of a small figure.
    folder : Path or None
        With a file for each surface.
    suffix : str
        Of the files in the folder, such as ".stl".
    opacity : tuple of (label number, name or 'all', float)
        Chosen for structures.
    holds_all : bool
        Whether all surfaces are held until they are written, as those with maps and the parts of solids are.
    shown_map : str
        Name of the map whose colors are shown; empty for the first.
    map_table : Path or None
    explode : float
        Shift of the farthest surface in an exploded view, mm, in the figure and in files that hold placements.
    """

    surfaces: tuple[Path, ...] = ()
    report: Path | None = None
    figure: Path | None = None
    space: str = "ras"
    thumbnail: tuple[int, int] | None = None
    folder: Path | None = None
    suffix: str = ""
    opacity: tuple[tuple[int | str, float], ...] = ()
    holds_all: bool = False
    shown_map: str = ""
    map_table: Path | None = None
    explode: float = 0.0

    def surfaces_in(self, surfaces: Surfaces) -> dict[Path, list[int]]:
        """Return every file with surfaces, and the numbers of those in it."""
        everything = list(range(len(surfaces.results)))
        files = dict.fromkeys(self.surfaces, everything)
        self.require_room_for(len(everything))
        if self.folder is not None:
            stems = file_names(surfaces.titles)
            files |= {self.folder / f"{stems[at]}{self.suffix}": [at] for at in everything}
        return files

    def paths(self, surfaces: Surfaces) -> list[Path]:
        """Return all files, in the order in which they are written."""
        companions = [path for path in (self.figure, self.map_table, self.report) if path is not None]
        return [*self.surface_files(surfaces), *companions]

    def surface_files(self, surfaces: Surfaces) -> list[Path]:
        """Return the files with surfaces, and what comes with them, such as the materials of an OBJ."""
        return [file for path in self.surfaces_in(surfaces) for file in files_of(path)]

    def blender_needed_for(self, simplifier: str) -> str:
        """Return the purpose for which Blender is needed; empty if it is not."""
        if simplifier == "decimate":
            return "--simplifier decimate"
        suffixes = [suffix for suffix in self.suffixes if suffix in mesh_files.BLENDER_SUFFIXES]
        return f"writing {suffixes[0]}" if suffixes else "rendering a figure" if self.figure else ""

    @property
    def suffixes(self) -> list[str]:
        """Return the suffixes of the surface files."""
        return [path.suffix.lower() for path in self.surfaces] + ([self.suffix] if self.folder else [])

    @contextmanager
    def writer(self, simplifier: str) -> Iterator[SurfaceWriter | None]:
        """Give a writer of each surface as it is made; None where all are held until they are written."""
        path = self.surfaces[0] if len(self.surfaces) == 1 and self.folder is None else None
        held = (
            self.holds_all
            or bool(self.blender_needed_for(simplifier))
            or not set(mesh_files.SUFFIXES).issuperset(self.suffixes)
        )
        if held or (path is None and (self.folder is None or self.surfaces)):
            yield None
            return
        folder = path.parent if path is not None else self.folder
        assert folder is not None
        suffix = self.suffix if path is None else path.suffix.lower()
        with surface_writer(folder, suffix, self.space) as writer:
            yield writer

    def map_shown_of(self, results: Sequence[Reconstruction]) -> str:
        """Return the name of the map whose colors are shown, by default the first; empty without maps."""
        return self.shown_map or next((each.name for result in results for each in result.maps), "")

    @property
    def can_explode(self) -> bool:
        """Return whether a file that holds several surfaces, or the figure, can show them moved apart."""
        return self.figure is not None or any(
            path.suffix.lower() in mesh_files.PLACED_SUFFIXES for path in self.surfaces
        )

    def require_room_for(self, count: int) -> None:
        """Raise `OutputError` where one file is to hold more surfaces than its format can."""
        for path in self.surfaces:
            mesh_files.require_one_surface(path, count)

    def triangle_bytes(self, simplifier: str) -> int:
        """Return the bytes that writing adds for each triangle; 0 for an STL or PLY without Blender."""
        objects = self.needs_objects(simplifier)  # a thumbnail is of few triangles, whatever the surface has
        return triangle_bytes(self.suffixes, objects, self.figure is not None and self.thumbnail is None)

    def needs_objects(self, simplifier: str) -> bool:
        """Return whether the surfaces become objects with all of their triangles, as for a thumbnail they do not."""
        return bool((replace(self, figure=None) if self.thumbnail else self).blender_needed_for(simplifier))

    def require_memory(self, surfaces: Surfaces) -> None:
        """Raise `MemoryLimitError` where writing would find no memory, which Blender does not survive."""
        faces = sum(len(result.mesh.faces) for result in surfaces.results)
        simplifier = surfaces.results[0].settings.simplifier
        by = " by Blender" if self.blender_needed_for(simplifier) else ""
        remedy = "simplify the surface, or write .stl or .ply"
        Budget().require(faces * self.triangle_bytes(simplifier), f"writing {faces} triangles{by}", remedy)


def surface_output(text: str, suffix: str, several: bool, is_counted: bool = True) -> dict[str, Any]:
    """Return the fields of `Outputs` that an OUTPUT names: a file for all surfaces, or a folder for a file of each.

    Checked before the work. A folder is one that exists, or ends in a slash; its parent must exist.

    Parameters
    ----------
    text, suffix : str
        The OUTPUT, and the suffix of files in a folder.
    several : bool
        Whether there may be several surfaces.
    is_counted : bool
        Whether there are several; else `Outputs.require_room_for` is asked once their number is known.

    Raises
    ------
    OutputError
        If it is neither, cannot be written to, or is a file that cannot hold several surfaces.
    """
    path = Path(text)
    is_surface = path.suffix.lower() in mesh_files.SURFACE_SUFFIXES
    if text.endswith(("/", "\\")) or (text and path.is_dir() and not is_surface):
        require_writable(path / f"surface{suffix}" if path.is_dir() else path)
        return {"folder": path, "suffix": suffix}
    if path.suffix.lower() == ".png":
        raise OutputError(f"{path.name} is a picture; add --figure {path.name} to a surface, or use ctmc figure")
    if several and text and not path.suffix:
        raise OutputError(f"{path.name} has no suffix; a folder for several surfaces ends in a slash: -o {path.name}/")
    if several and is_counted:
        mesh_files.require_one_surface(path)
    surface = require_writable(path, mesh_files.SURFACE_SUFFIXES)
    for companion in files_of(surface)[1:]:
        require_writable(companion)
    return {"surfaces": (surface,)}


def written_steps(surfaces: Surfaces, outputs: Outputs) -> Steps[tuple[Surfaces, list[Path]]]:
    """Write every output, all or none; return the surfaces as they were written, and the files."""
    outputs.require_memory(surfaces)
    paths = outputs.paths(surfaces)
    with whole_files(paths) as temporaries:
        if outputs.blender_needed_for(surfaces.results[0].settings.simplifier):
            surfaces = yield from _with_blender_steps(surfaces, outputs, temporaries)
        stages: list[Stage] = []
        for path, numbers in outputs.surfaces_in(surfaces).items():
            if path.suffix.lower() in mesh_files.SUFFIXES:
                yield Step(0.8, f"Writing {path.name}")
                with timed(stages, f"Writing {path.suffix.lower()}"):
                    if surfaces.files:
                        surfaces.files[numbers[0]].replace(temporaries[path])
                    else:
                        result = surfaces.results[numbers[0]]
                        result.mesh.save(temporaries[path], outputs.space, result.maps)
            elif path.suffix.lower() in mesh_files.STRUCTURE_SUFFIXES:
                from ..core import write_structures_steps

                with timed(stages, f"Writing {path.suffix.lower()}"):
                    results = [surfaces.results[number] for number in numbers]
                    shares = opacities_of(results, outputs.opacity)
                    titles = [surfaces.titles[number] for number in numbers]
                    structures = structures_of(results, titles, shares, outputs.map_shown_of(results))
                    apart = outputs.explode if path.suffix.lower() in mesh_files.PLACED_SUFFIXES else 0.0
                    for step in write_structures_steps(temporaries[path], structures, outputs.space, apart):
                        yield Step(0.8 + 0.1 * step.fraction, step.message)
        if outputs.map_table is not None:
            from ..core.files.map_table import write_map_table_steps

            with timed(stages, "Writing .csv"):
                structures = structures_of(surfaces.results, surfaces.titles)
                for step in write_map_table_steps(temporaries[outputs.map_table], structures, outputs.space):
                    yield Step(0.9, step.message)
        surfaces = _with_stages(surfaces, stages)
        if outputs.report is not None:
            yield Step(0.9, f"Writing {outputs.report.name}")
            write_json(temporaries[outputs.report], surfaces.report() | {"files": [path.name for path in paths]})
    return surfaces, paths


def _with_blender_steps(surfaces: Surfaces, outputs: Outputs, temporaries: Mapping[Path, Path]) -> Steps[Surfaces]:
    """Make objects in a scene of their own, and write what only Blender writes; returns the surfaces as shown."""
    from ..blender.exploded import moved_apart
    from ..blender.export import export_together
    from ..blender.figure.map_colors import scale_shown
    from ..blender.figure.rendering.render import PICTURE_SIZE, render_figure_steps
    from ..blender.maps import show_map

    yield Step(0.0, "Building the objects" if surfaces.are_several else "Building the object")
    stages: list[Stage] = []
    start = time.perf_counter()
    shown: Sequence[Reconstruction] = surfaces.results
    with ExitStack() as stack:
        objects: list[Any] = []
        opacities = opacities_of(surfaces.results, outputs.opacity)
        if outputs.needs_objects(surfaces.results[0].settings.simplifier):
            # A .blend has a scene "CTMC", a name that only one can have.
            objects_shown = objects_of(surfaces.results, "CTMC objects", surfaces.names, opacities)
            scene, objects, shown = stack.enter_context(objects_shown)
            stages.append(Stage("Building the object", time.perf_counter() - start))
        for path, numbers in outputs.surfaces_in(surfaces).items():
            if path.suffix.lower() in mesh_files.BLENDER_SUFFIXES:
                yield Step(0.2, f"Writing {path.name}")
                those = [objects[number] for number in numbers]
                collection = surfaces.name if len(those) > 1 else ""
                with timed(stages, f"Writing {path.suffix.lower()}"), blender_at_work():
                    for obj in those:
                        show_map(obj, outputs.map_shown_of(surfaces.results))
                    with moved_apart(those, scene, outputs.explode):
                        export_together(those, temporaries[path], outputs.space, scene, collection, surfaces.times)
        if outputs.figure is not None:
            width, height = outputs.thumbnail or PICTURE_SIZE
            yield Step(0.4, f"Rendering {outputs.figure.name}, {width} x {height} pixels")
            with timed(stages, "Rendering the figure"):
                small: dict[str, Any] = {}
                if outputs.thumbnail:
                    small = {"size": outputs.thumbnail}
                    objects_shown = objects_of(_coarse_surfaces(shown), "CTMC thumbnail", surfaces.names, opacities)
                    scene, objects, _ = stack.enter_context(objects_shown)
                names, given = surfaces.titles, chosen_opacities(surfaces.results, outputs.opacity)
                # Thumbnails are a batch's, whose processes end with it: another takes longer to start than to render.
                colors = None if outputs.thumbnail else scale_shown(shown, outputs.map_shown_of(shown))
                how = {
                    "names": names,
                    "opacities": given,
                    "own_process": not outputs.thumbnail,
                    "colors": colors,
                    "explode": outputs.explode,
                    **small,
                }
                rendering = render_figure_steps(objects, scene, temporaries[outputs.figure], **how)
                yield from quiet_steps(rendering)
    return _with_stages(replace(surfaces, results=tuple(shown)), stages)


def _coarse_surfaces(results: Sequence[Reconstruction]) -> list[Reconstruction]:
    """Return surfaces simplified for a thumbnail, with about `THUMBNAIL_FACES` triangles in total at most."""
    total = max(1, sum(len(result.mesh.faces) for result in results))
    coarse = []
    for result in results:
        share = THUMBNAIL_FACES * len(result.mesh.faces) / total
        mesh = coarse_mesh(result.mesh, max(FEWEST_FACES, math.floor(share)))
        # The few triangles are all there is of these: no alpha is left to choose, and no modifier to apply.
        settings = replace(result.settings, reduction=None, target_faces=None)
        measured = result.measures
        coarse.append(
            replace(result, mesh=mesh, surface=None, beyond=None, measured=measured, settings=settings, maps=())
        )
    return coarse


def _with_stages(surfaces: Surfaces, stages: Sequence[Stage]) -> Surfaces:
    """Return the surfaces with further stages; stages of one name are added up, and every surface gets all of them."""
    seconds: dict[str, float] = {}
    for stage in stages:
        seconds[stage.name] = seconds.get(stage.name, 0.0) + stage.seconds
    more = tuple(Stage(name, taken) for name, taken in seconds.items())
    return replace(
        surfaces, results=tuple(replace(result, stages=(*result.stages, *more)) for result in surfaces.results)
    )


@contextmanager
def timed(stages: list[Stage], name: str) -> Iterator[None]:
    """Add a stage with the seconds of the block."""
    start = time.perf_counter()
    yield
    stages.append(Stage(name, time.perf_counter() - start))
