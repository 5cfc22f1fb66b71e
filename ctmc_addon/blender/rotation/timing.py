"""The rotation test: how long a surface takes to turn once around its z axis (Su and Ma, 4.3 and table 2).

Every level of simplification is an object of its own with a plain mesh, no modifier and no key, made before the clock
starts. A round turns each level once, from one step to 360 degrees; rounds go through the levels in turn, so that a
slow minute of the machine falls on all of them. Building, switching between levels and a first frame are left out.

How a frame is drawn is a `Drawing`: rendered off screen here, redrawn in the viewport by whoever has one, or the
triangles alone. Only `draw` is timed; between two frames the steps can be cancelled.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import bpy
import numpy as np

from ...core import Step, Steps, TriangleMesh, simplify_steps, within
from ..datablocks import remove_blocks
from ..materials import BONE, surface_material
from ..studio import AZIMUTH, ELEVATION, frame, prepare_scene, view_axes
from ..surface import mesh_data as meshes
from ..surface.placement import SCALE, placed_at_center

LEVELS = (0.0, 50.0, 90.0)
ROUNDS = 5
STEP_DEGREES = 20.0
# Pixels of a frame. In larger pictures a renderer without a graphics card measures pixels more than triangles.
SIZES = {"BLENDER_WORKBENCH": (640, 480), "CYCLES": (160, 120)}


@dataclass(frozen=True)
class Level:
    """One level of simplification, as an object."""

    percent: float
    mesh: TriangleMesh
    thing: bpy.types.Object


class Drawing(Protocol):
    """A way to draw a frame."""

    def show(self, level: Level) -> None:
        """Get ready to draw this level and no other; not timed."""

    def draw(self, level: Level) -> None:
        """Draw the level as its object is turned now, and come back when the picture is there; timed."""


@dataclass(frozen=True)
class Turned:
    """What the test found for one level: seconds of every round, as a whole frame and as drawing alone."""

    percent: float
    faces: int
    rounds: tuple[float, ...]
    draw_rounds: tuple[float, ...] = ()


def simplified_steps(mesh: TriangleMesh, percents: Sequence[float]) -> Steps[list[tuple[float, TriangleMesh]]]:
    """The surface with these shares of its triangles removed, per cent."""
    made = []
    for at, percent in enumerate(percents):
        low, high = at / len(percents), (at + 1) / len(percents)
        yield Step(low, f"Simplifying by {percent:g} %")
        small = mesh
        if percent:
            small = yield from within(simplify_steps(mesh, reduction=percent / 100), low, high)
        made.append((percent, small))
    return made


@contextmanager
def levels_in(
    scene: bpy.types.Scene, simplified: Sequence[tuple[float, TriangleMesh]], scale: float = SCALE
) -> Iterator[list[Level]]:
    """Static objects of these meshes (RAS+ mm) in `scene`, about one origin; removed after the block."""
    placement = placed_at_center(simplified[0][1].vertices, scale)
    material = surface_material("CTMC Rotation Test", BONE)
    levels: list[Level] = []
    try:
        for percent, mesh in simplified:
            name = f"CTMC Rotation Test {percent:g} %"
            plain = meshes.new_mesh(name, placement.to_local(mesh.vertices), mesh.faces)
            plain.materials.append(material)
            thing = bpy.data.objects.new(name, plain)
            thing.location = placement.origin
            levels.append(Level(percent, mesh, thing))
            scene.collection.objects.link(thing)
        yield levels
    finally:
        remove_blocks(*(level.thing.data for level in levels))  # and the objects with them
        remove_blocks(material)


def show_only(levels: Sequence[Level], shown: Level) -> None:
    """Hide every level but one, from renders and viewports."""
    for level in levels:
        level.thing.hide_render = level.thing.hide_viewport = level is not shown


def frames_of(step_degrees: float) -> int:
    """Frames of one turn; the last is at 360 degrees, or the last step before.

    Examples
    --------
    >>> frames_of(20.0)
    18
    """
    return int(360 / step_degrees + 1e-9)


def rotation_steps(
    levels: Sequence[Level], drawing: Drawing, rounds: int = ROUNDS, step_degrees: float = STEP_DEGREES
) -> Steps[list[list[float]]]:
    """Turn every level once around in every round, and return the seconds of its rounds.

    Yields after every frame, outside the clock.
    """
    seconds: list[list[float]] = [[] for _ in levels]
    angles = [math.radians(step_degrees * (at + 1)) for at in range(frames_of(step_degrees))]
    frames = len(angles) * len(levels) * rounds
    done = 0
    for turn in range(rounds):
        for level, times in zip(levels, seconds, strict=True):
            level.thing.rotation_euler.z = 0.0
            drawing.show(level)
            drawing.draw(level)  # warms up
            total = 0.0
            for angle in angles:
                level.thing.rotation_euler.z = angle
                start = time.perf_counter()
                drawing.draw(level)
                total += time.perf_counter() - start
                done += 1
                yield Step(done / frames, f"Timing {level.percent:g} %, round {turn + 1} of {rounds}")
            times.append(total)
    return seconds


def rotation_test_steps(
    simplified: Sequence[tuple[float, TriangleMesh]],
    engine: str,
    rounds: int = ROUNDS,
    step_degrees: float = STEP_DEGREES,
    size: tuple[int, int] | None = None,
) -> Steps[list[Turned]]:
    """The test with no window, in a scene of its own: whole frames by `engine`, and the triangles alone if it can.

    Parameters
    ----------
    simplified : sequence of (per cent, mesh)
        As `simplified_steps` makes them, RAS+ mm.
    engine : {"BLENDER_WORKBENCH", "CYCLES"}
        Workbench needs EGL on Linux; without it Blender would end the process.
    size : (width, height) int, optional
        Of a frame, pixels; by default that of `SIZES`.
    """
    from .offscreen import TriangleDrawing

    size = size or SIZES[engine]
    home = bpy.data.scenes.new("CTMC Rotation Test")
    stage: tuple[bpy.types.ID, ...] = ()
    try:
        with levels_in(home, simplified) as levels:
            show_only(levels, levels[0])
            stage = prepare_scene(home, levels[0].thing, size)
            frame_turning(home, levels[0], size)
            whole = RenderDrawing(home, levels, engine)
            rounds_of = yield from within(rotation_steps(levels, whole, rounds, step_degrees), 0.0, 0.8)
            drawn: list[list[float]] = [[] for _ in levels]
            if engine == "BLENDER_WORKBENCH":
                with TriangleDrawing(home, levels, size) as triangles:
                    drawn = yield from within(rotation_steps(levels, triangles, rounds, step_degrees), 0.8, 1.0)
            return [
                Turned(level.percent, len(level.mesh.faces), tuple(times), tuple(draws))
                for level, times, draws in zip(levels, rounds_of, drawn, strict=True)
            ]
    finally:
        remove_blocks(*stage, home)


def frame_turning(scene: bpy.types.Scene, level: Level, size: tuple[int, int]) -> None:
    """Move the camera back until the level stays in the picture however it is turned about its z axis."""
    origin = np.array(level.thing.location, np.float64)
    points = meshes.read_positions(level.thing.data).astype(np.float64)
    reach = float(np.sqrt((points[:, :2] ** 2).sum(axis=1).max()))
    around = np.radians(np.arange(0, 360, 10))
    ring = np.stack([reach * np.cos(around), reach * np.sin(around)], axis=1)
    heights = (points[:, 2].min(), points[:, 2].max())
    swept = np.concatenate([np.column_stack([ring, np.full(len(ring), height)]) for height in heights])
    frame(scene.camera, swept + origin, view_axes(AZIMUTH, ELEVATION), size)


class RenderDrawing:
    """A whole frame off screen: Blender evaluates the scene, hands the mesh to the engine and reads the picture."""

    def __init__(self, scene: bpy.types.Scene, levels: Sequence[Level], engine: str) -> None:
        self.scene, self.levels = scene, levels
        scene.render.engine = engine
        scene.display.render_aa = "OFF"
        if engine == "CYCLES":
            scene.cycles.samples = 1
        self.render: Callable[..., object] = bpy.ops.render.render

    def show(self, level: Level) -> None:
        """Hide the other levels."""
        show_only(self.levels, level)

    def draw(self, level: Level) -> None:
        """Render to memory."""
        self.render(write_still=False, scene=self.scene.name)
