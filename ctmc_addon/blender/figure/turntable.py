# SPDX-License-Identifier: GPL-3.0-or-later
"""Render a surface turning about the patient's vertical axis: one picture a frame, and a video of them.

The loop is seamless: of n frames, frame k stands at k/n of the turn.
Camera, light and letters stand still; the patient's axes turn with the surface. Every picture is written whole or not
at all, with a note of its settings next to it, so that interrupted work can resume.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import bpy

from ...core import VERSION, OutputError, Step, Steps
from ...core.files.atomic_write import create_folder, refused, whole_file, write_json
from ...core.files.input_files import require_no_input
from ...core.files.temporary_names import remove_leftovers
from ..maps import map_values
from ..surface import mesh_data as meshes
from .page.axes import PIVOT
from .page.compose import FigureScene, all_positions, center_of, compose_steps
from .rendering.picture import RenderRequest
from .rendering.render import require_own_blend
from .rendering.renderer import Renderer, renderer_of, write_scene
from .spec import Cell, FigureStyle, Page, Turn
from .video import Video, require_video

NOTE = "turntable.json"
FRAME = "frame_{:05d}.png"
FIRST_OF_EEVEE = ": Blender compiles shaders first and does not answer meanwhile"
FRAMES_FOLDER = ".frames"  # Folder next to a video until it is done.


def turntable_steps(
    cell: Cell,
    path: str | os.PathLike[str],
    page: Page,
    style: FigureStyle,
    turn: Turn,
    blend: str | os.PathLike[str] | None = None,
    scene: bpy.types.Scene | None = None,
    resume: bool = False,
    overwrite: bool = False,
    own_process: bool = False,
) -> Steps[tuple[tuple[int, int], int]]:
    """Render a turn to a video or a folder of PNG; return the size in pixels and the number of newly rendered frames.

    Parameters
    ----------
    path : path
        A video by its suffix, see `VIDEO_FORMATS`; anything else is a folder.
    resume : bool
        Go on where the same turntable was stopped.
    overwrite : bool
        Replace an older one.
    own_process : bool
        Render in a Blender of its own, which closing the steps ends at any moment.

    Raises
    ------
    CtmcError
        If the place is taken, this Blender does not write the format, or a file cannot be written.
    """
    target = Path(path)
    folder = _frames_folder(target)
    require_turntable(target, page, resume, overwrite)
    if blend is not None:
        require_own_blend(Path(blend))
    if is_video(target):  # The folder is removed once the video is complete.
        for file in folder.rglob("*"):
            require_no_input(file)
    yield Step(0.0, "Setting up the turntable")
    figure = yield from compose_steps([cell], page, style, scene, turning=True, even=True)
    try:
        pivot = _add_pivot(figure, turn)
        note = _note_of(figure, page, style, turn)
        create_folder(folder)
        _require_same(folder, note, overwrite)
        for each in {folder, *(file.resolve().parent for file in (target, Path(blend or target)))}:
            remove_leftovers(each)
        write_json(folder / NOTE, note)
        if blend is not None:
            with whole_file(Path(blend)) as temporary:
                write_scene(figure, temporary)
        # Blender evaluates no driver for a single picture of a scene that no window shows.
        pivot.driver_remove("rotation_euler", 2)
        picture = RenderRequest("", "", page.dpi, figure.paper, figure.written_rows, pivot.name)
        compiles = "EEVEE" in figure.scene.render.engine
        with renderer_of(figure, folder / NOTE, own_process) as renderer:
            rendered = yield from _frames_steps(renderer, picture, folder, turn, compiles)
            if is_video(target):
                yield from _video_steps(renderer, folder, target, turn, figure.size)
    finally:
        figure.remove()
    if is_video(target):
        shutil.rmtree(folder)
    yield Step(1.0, f"{target.name} written")
    return figure.size, rendered


def is_video(path: Path) -> bool:
    """Return whether a path is a video's and not a folder's."""
    return path.suffix != "" and not path.is_dir()


def _frames_folder(path: Path) -> Path:
    return path.with_name(path.stem + FRAMES_FOLDER) if is_video(path) else path


def _add_pivot(figure: FigureScene, turn: Turn) -> bpy.types.Object:
    """Add a pivot that turns the surfaces and the patient's axes with the frame, 1 to the last; return it."""
    pivot = bpy.data.objects.new("CTMC Turntable", None)
    figure.blocks.append(pivot)
    pivot.location = center_of(all_positions(figure)).tolist()
    figure.scene.collection.objects.link(pivot)
    figure.scene.view_layers[0].update()
    for obj in figure.shown(0):
        obj.parent = pivot
        obj.matrix_parent_inverse = pivot.matrix_world.inverted()
    # A driver holds without end where keys would need one frame too many.
    driver = pivot.driver_add("rotation_euler", 2).driver
    driver.expression = f"(frame - 1) * {math.radians(turn.degrees(1)):.17g}"
    for axes in [obj for obj in figure.scene.objects if obj.name.startswith(PIVOT)]:
        following = axes.constraints.new("COPY_ROTATION")
        following.target, following.mix_mode = pivot, "BEFORE"
    figure.scene.frame_start, figure.scene.frame_end = 1, turn.frames
    figure.scene.render.fps = turn.fps
    figure.scene.render.use_persistent_data = True
    return pivot


def _frames_steps(renderer: Renderer, picture: RenderRequest, folder: Path, turn: Turn, compiles: bool) -> Steps[int]:
    """Render the missing frames; the message has the time left after the first one.

    Parameters
    ----------
    renderer : Renderer
    picture : RenderRequest
        A frame without its path and angle.
    folder : Path
    turn : Turn
    compiles : bool
        Whether the engine compiles shaders before the first frame.
    """
    missing = [at for at in range(turn.frames) if not _is_complete_png(folder / FRAME.format(at + 1))]
    began = time.perf_counter()
    for done, at in enumerate(missing):
        left = FIRST_OF_EEVEE if compiles else ""
        if done:
            left = f", {_duration_left((time.perf_counter() - began) / done * (len(missing) - done))} left"
        step = Step(at / turn.frames, f"Rendering frame {at + 1} of {turn.frames}{left}")
        target, angle = folder / FRAME.format(at + 1), math.radians(turn.degrees(at))
        with whole_file(target) as temporary:
            frame = picture._replace(path=str(temporary), name=target.name, angle=angle)
            yield from renderer.make_steps(frame, step)
    return len(missing)


def _video_steps(renderer: Renderer, folder: Path, target: Path, turn: Turn, size: tuple[int, int]) -> Steps[None]:
    """Write the video of the frames in a folder, whole or not at all."""
    video_folder = renderer.folder / "video"
    video_folder.mkdir()
    frames = [str((folder / FRAME.format(at + 1)).resolve()) for at in range(turn.frames)]
    video = Video(frames, str(video_folder), target.name, turn.fps, size)
    yield from renderer.make_steps(video, Step(1.0, f"Writing {target.name}"))
    with whole_file(target) as temporary:
        shutil.copyfile(video.file, temporary)


def _duration_left(seconds: float) -> str:
    """Return the remaining time in words.

    Examples
    --------
    >>> _duration_left(41.2), _duration_left(312), _duration_left(9000)
    ('about 41 s', 'about 5 min', 'about 2.5 h')
    """
    if seconds < 90:
        return f"about {max(seconds, 1):.0f} s"
    return f"about {seconds / 60:.0f} min" if seconds < 5400 else f"about {seconds / 3600:.1f} h"


def _is_complete_png(path: Path) -> bool:
    """Return whether a PNG has its first and its last chunk."""
    try:
        with path.open("rb") as file:
            start = file.read(8)
            file.seek(-8, os.SEEK_END)
            return start == b"\x89PNG\r\n\x1a\n" and file.read(4) == b"IEND"
    except OSError:
        return False


def _note_of(figure: FigureScene, page: Page, style: FigureStyle, turn: Turn) -> dict[str, Any]:
    """Return a note that identifies a turntable: surfaces, page, style and turn."""
    surfaces = hashlib.sha256()
    for copy in figure.copies[0]:
        surfaces.update(str([round(part, 6) for row in copy.matrix_world for part in row]).encode())
        surfaces.update(meshes.read_positions(copy.data).tobytes())
        surfaces.update(meshes.read_triangles(copy.data).tobytes())
        if style.colors is not None and style.colors.name in copy.data.attributes:
            surfaces.update(map_values(copy.data, style.colors.name).tobytes())
    for obj in figure.scene.objects:
        if obj.type == "FONT":
            surfaces.update(obj.data.body.encode())
    for material in [block for block in figure.blocks if isinstance(block, bpy.types.Material)]:
        surfaces.update(str(tuple(round(part, 6) for part in material.diffuse_color)).encode())
    return {
        "version": VERSION,
        "surfaces": surfaces.hexdigest(),
        "page": asdict(page),
        "style": asdict(style),
        "turn": asdict(turn),
        "frames": turn.frames,
    }


def require_turntable(path: Path, page: Page, resume: bool, overwrite: bool) -> None:
    """Raise `OutputError` for a video format this Blender cannot write, or an occupied output path.

    A folder that holds anything but a turntable is never touched.
    """
    if is_video(path):
        require_video(path, page.transparent)
    folder = _frames_folder(path)
    try:
        names = sorted(path.name for path in folder.iterdir()) if folder.exists() else []
    except OSError as error:
        raise refused(folder, error) from error
    if names and NOTE not in names:
        raise OutputError(f"{folder.name} holds {names[0]} and not a turntable; choose another folder")
    if names and not resume and not overwrite:
        raise OutputError(f"{folder.name} is not empty; continue it (--resume), or start over (--overwrite)")
    if is_finished_video(path) and not resume and not overwrite:
        raise OutputError(f"{path.name} already exists; replace it (--overwrite), or choose another name")


def is_finished_video(path: Path) -> bool:
    """Return whether a video is there and no frames wait to become it."""
    return is_video(path) and path.exists() and not _frames_folder(path).exists()


def _require_same(folder: Path, note: dict[str, Any], overwrite: bool) -> None:
    """Raise `OutputError` if the folder has frames of another turntable; with `overwrite` remove them."""
    if overwrite:
        older = [*folder.glob("frame_*.png"), folder / NOTE]
        for file in older:
            require_no_input(file)
        for file in older:
            file.unlink(missing_ok=True)
    try:
        before = json.loads((folder / NOTE).read_text("utf-8")) if (folder / NOTE).exists() else None
    except ValueError:
        before = {}
    if before is not None and before != json.loads(json.dumps(note)):
        raise OutputError(
            f"{folder.name} holds the frames of another turntable; overwrite them (--overwrite), or choose another name"
        )
