"""A surface turning about the patient's vertical axis: pictures, one a frame, and a film made of them.

The loop is seamless: of n frames, frame k stands at k/n of the turn, so the first follows the last as any other does.
Camera, light and letters stand still; the patient's axes turn with the surface. Every picture is written whole or not
at all, with a note of what it shows beside it, so that work which was stopped can go on.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import bpy

from ...core import VERSION, OutputError, SettingsError, Step, Steps
from ...reporting.atomic_write import made_folder, refused, write_json
from ..output_files import require_room, written_whole
from ..surface import mesh_data as meshes
from .annotations import PIVOT
from .compose import Cell, Look, Stage, middle_of, seen_points, staged
from .page import Page, finished_png
from .render import require_own_blend, write_stage
from .tiles import render_to
from .video import encode, require_film

NOTE = "turntable.json"
FRAME = "frame_{:05d}.png"
SECONDS, FPS, REVOLUTIONS = 3600.0, (1, 120), 100  # at most, from and to, at most
FRAMES_FOLDER = ".frames"  # beside a film, until it is done


@dataclass(frozen=True)
class Turn:
    """How long and how far.

    Parameters
    ----------
    seconds : float
        Of the whole loop.
    fps : int
        Frames a second.
    revolutions : int
        Whole turns in the loop; negative ones turn the other way.

    Raises
    ------
    SettingsError
        If a value lies outside its limits.
    """

    seconds: float = 6.0
    fps: int = 24
    revolutions: int = 1

    def __post_init__(self) -> None:
        if not FPS[0] <= self.fps <= FPS[1]:
            raise SettingsError(f"a turntable has from {FPS[0]} to {FPS[1]} frames a second, not {self.fps:g}")
        if self.revolutions == 0 or abs(self.revolutions) > REVOLUTIONS:
            raise SettingsError(f"revolutions must be from 1 to {REVOLUTIONS}, or negative, not {self.revolutions}")
        if not 0 < self.seconds <= SECONDS or self.frames < 2 * abs(self.revolutions) + 1:
            raise SettingsError(
                f"{self.seconds:g} s at {self.fps} frames a second are too few or too many frames for "
                f"{abs(self.revolutions)} revolutions; take up to {SECONDS:g} s and at least 3 frames a revolution"
            )

    @property
    def frames(self) -> int:
        """Pictures in the loop."""
        return round(self.seconds * self.fps)

    def degrees(self, frame: int) -> float:
        """How far the surface has turned in frame 0, 1, ..."""
        return 360.0 * self.revolutions * frame / self.frames


def turntable_steps(
    cell: Cell,
    path: str | os.PathLike[str],
    page: Page,
    look: Look,
    turn: Turn,
    blend: str | os.PathLike[str] | None = None,
    scene: bpy.types.Scene | None = None,
    resume: bool = False,
    overwrite: bool = False,
) -> Steps[tuple[tuple[int, int], int]]:
    """Render a turn to a film, or to a folder of PNG; returns the size in pixels and the number of frames rendered now.

    Parameters
    ----------
    path : path
        A film by its suffix, see `FILMS`; anything else is a folder.
    resume : bool
        Go on where the same turntable was stopped.
    overwrite : bool
        Replace an older one.

    Raises
    ------
    CtmcError
        If the place is taken, the format is none of this Blender's, or a file cannot be written.
    """
    target = Path(path)
    film, folder = is_film(target), frames_folder(target)
    require_turntable(target, page, resume, overwrite)
    if blend is not None:
        require_own_blend(Path(blend))
    yield Step(0.0, "Setting up the turntable")
    stage = staged([cell], page, look, scene, turning=True, even=True)
    try:
        pivot = spin(stage, turn)
        note = note_of(stage, page, look, turn)
        made_folder(folder)
        require_same(folder, note, overwrite)
        for half in folder.glob(".ctmc-*"):  # of work that was killed
            half.unlink(missing_ok=True)
        write_json(folder / NOTE, note)
        if blend is not None:
            with written_whole(Path(blend)) as beside:
                write_stage(stage, beside)
        rendered = yield from frames_steps(stage, pivot, folder, page, turn)
    finally:
        stage.take_down()
    if film:
        yield Step(0.97, f"Writing {target.name}")
        encode([folder / FRAME.format(at + 1) for at in range(turn.frames)], target, turn.fps, stage.size)
        shutil.rmtree(folder)
    yield Step(1.0, f"{target.name} written")
    return stage.size, rendered


def is_film(path: Path) -> bool:
    """Whether a path is a film's and not a folder's."""
    return path.suffix != "" and not path.is_dir()


def frames_folder(path: Path) -> Path:
    """Where the pictures of a turntable are."""
    return path.with_name(path.stem + FRAMES_FOLDER) if is_film(path) else path


def spin(stage: Stage, turn: Turn) -> bpy.types.Object:
    """Turn the surfaces and the patient's axes with the scene's frame, 1 to the last; returns their pivot."""
    copies = stage.copies[0]
    pivot = bpy.data.objects.new("CTMC Turntable", None)
    stage.made.append(pivot)
    pivot.location = middle_of(seen_points(stage, turning=False)).tolist()
    stage.scene.collection.objects.link(pivot)
    stage.scene.view_layers[0].update()
    for copy in copies:
        copy.parent = pivot
        copy.matrix_parent_inverse = pivot.matrix_world.inverted()
    # A driver holds without end where keys would need one frame too many.
    driver = pivot.driver_add("rotation_euler", 2).driver
    driver.expression = f"(frame - 1) * {math.radians(turn.degrees(1)):.17g}"
    for axes in [thing for thing in stage.scene.objects if thing.name.startswith(PIVOT)]:
        following = axes.constraints.new("COPY_ROTATION")
        following.target, following.mix_mode = pivot, "BEFORE"
    stage.scene.frame_start, stage.scene.frame_end = 1, turn.frames
    stage.scene.render.fps = turn.fps
    stage.scene.render.use_persistent_data = True
    return pivot


def frames_steps(stage: Stage, pivot: bpy.types.Object, folder: Path, page: Page, turn: Turn) -> Steps[int]:
    """Render the frames that are missing; says how long the rest takes once one is done."""
    missing = [at for at in range(turn.frames) if not whole_png(folder / FRAME.format(at + 1))]
    # Blender evaluates no driver for a single picture of a scene that no window shows.
    pivot.driver_remove("rotation_euler", 2)
    began = time.perf_counter()
    for done, at in enumerate(missing):
        left = ""
        if done:
            left = f", {told_time((time.perf_counter() - began) / done * (len(missing) - done))} left"
        yield Step(0.02 + 0.95 * (at / turn.frames), f"Rendering frame {at + 1} of {turn.frames}{left}")
        pivot.rotation_euler.z = math.radians(turn.degrees(at))
        target = folder / FRAME.format(at + 1)
        with written_whole(target) as beside:
            require_room(beside, 4 * stage.size[0] * stage.size[1] + 10_000)
            render_to(stage.scene, beside)
            beside.write_bytes(finished_png(beside.read_bytes(), target.name, page.dpi))
    return len(missing)


def told_time(seconds: float) -> str:
    """A time to wait for.

    Examples
    --------
    >>> told_time(41.2), told_time(312), told_time(9000)
    ('about 41 s', 'about 5 min', 'about 2.5 h')
    """
    if seconds < 90:
        return f"about {max(seconds, 1):.0f} s"
    return f"about {seconds / 60:.0f} min" if seconds < 5400 else f"about {seconds / 3600:.1f} h"


def whole_png(path: Path) -> bool:
    """Whether a PNG is there from its first to its last chunk."""
    try:
        with path.open("rb") as file:
            start = file.read(8)
            file.seek(-8, os.SEEK_END)
            return start == b"\x89PNG\r\n\x1a\n" and file.read(4) == b"IEND"
    except OSError:
        return False


def note_of(stage: Stage, page: Page, look: Look, turn: Turn) -> dict[str, Any]:
    """What tells one turntable from another: the surfaces, page, look and turn."""
    surfaces = hashlib.sha256()
    for copy in stage.copies[0]:
        surfaces.update(meshes.read_positions(copy.data).tobytes())
        surfaces.update(meshes.read_triangles(copy.data).tobytes())
    for thing in stage.scene.objects:
        if thing.type == "FONT":
            surfaces.update(thing.data.body.encode())
    for material in [one for one in stage.made if isinstance(one, bpy.types.Material)]:
        surfaces.update(str(tuple(round(part, 6) for part in material.diffuse_color)).encode())
    return {
        "version": VERSION,
        "surfaces": surfaces.hexdigest(),
        "page": asdict(page),
        "look": asdict(look),
        "turn": asdict(turn),
        "frames": turn.frames,
    }


def require_turntable(path: Path, page: Page, resume: bool, overwrite: bool) -> None:
    """Raise `OutputError` for a film this Blender cannot write, or a place that is taken.

    A folder that holds anything but a turntable is never touched.
    """
    if is_film(path):
        require_film(path, page.transparent)
    folder = frames_folder(path)
    try:
        names = sorted(one.name for one in folder.iterdir()) if folder.exists() else []
    except OSError as error:
        raise refused(folder, error) from error
    if names and NOTE not in names:
        raise OutputError(f"{folder.name} holds {names[0]} and no turntable; choose another folder")
    if names and not resume and not overwrite:
        raise OutputError(f"{folder.name} is not empty; go on with it (--resume), or begin anew (--overwrite)")
    if finished_film(path) and not resume and not overwrite:
        raise OutputError(f"{path.name} is there already; replace it (--overwrite), or choose another name")


def finished_film(path: Path) -> bool:
    """Whether a film is there and no frames wait to become it."""
    return is_film(path) and path.exists() and not frames_folder(path).exists()


def require_same(folder: Path, note: dict[str, Any], overwrite: bool) -> None:
    """Raise `OutputError` if the folder has frames of another turntable; remove them if it may be overwritten."""
    if overwrite:
        for old in [*folder.glob("frame_*.png"), folder / NOTE]:
            old.unlink(missing_ok=True)
    try:
        before = json.loads((folder / NOTE).read_text("utf-8")) if (folder / NOTE).exists() else None
    except ValueError:
        before = {}
    if before is not None and before != json.loads(json.dumps(note)):
        raise OutputError(
            f"{folder.name} holds the frames of another turntable; overwrite them (--overwrite), or take another name"
        )
