# SPDX-License-Identifier: GPL-3.0-or-later
"""Time how long a surface takes to turn once around its z axis (Su and Ma, 4.3 and table 2).

Every level of simplification is an object of its own with a plain mesh, no modifier and no key, made before the clock
starts. A round turns each level once, from one step to 360 degrees; rounds go through the levels in turn, so that a
slow minute of the machine falls on all of them. Building, switching between levels and a first frame are left out.

How a frame is drawn is a `Drawing`: rendered off screen here, redrawn in the viewport by whoever has one, or the
triangles alone. Only `draw` is timed; between two frames the steps can be cancelled.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import bpy
import numpy as np

from ...core import Stages, Step, Steps, TriangleMesh
from ..datablocks import remove_blocks, remove_render_results, render_results
from ..figure.spec import AZIMUTH, ELEVATION
from ..scene.studio import frame, prepare_scene, swept, view_axes
from ..surface import mesh_data as meshes
from .levels import NAME, Level, levels_in, show_only
from .offscreen import TriangleDrawing

ROUNDS = 5
STEP_DEGREES = 20.0
# Pixels of a frame. In larger pictures a renderer without a graphics card measures pixels more than triangles.
SIZES = {"BLENDER_WORKBENCH": (640, 480), "CYCLES": (160, 120)}


class Drawing(Protocol):
    """A way to draw a frame."""

    def show(self, level: Level) -> None:
        """Prepare to draw this level and no other; not timed."""

    def draw(self, level: Level) -> None:
        """Draw the level at its present angle, and return when the picture is complete; timed."""


@dataclass(frozen=True)
class LevelTimes:
    """Seconds of every round of one level, as a whole frame and as drawing only."""

    percent: float
    faces: int
    rounds: tuple[float, ...]
    draw_rounds: tuple[float, ...] = ()


def frames_of(step_degrees: float) -> int:
    """Return the frames of one turn; the last is at 360 degrees, or the last step before.

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
            level.obj.rotation_euler.z = 0.0
            drawing.show(level)
            drawing.draw(level)  # Warm up.
            total = 0.0
            for angle in angles:
                level.obj.rotation_euler.z = angle
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
) -> Steps[list[LevelTimes]]:
    """Run the test without a window in a separate scene: whole frames by `engine`, and triangles only if possible.

    Parameters
    ----------
    simplified : sequence of (per cent, mesh)
        Result of `simplified_steps`, RAS+ mm.
    engine : {"BLENDER_WORKBENCH", "CYCLES"}
        Workbench needs EGL on Linux; without it Blender would end the process.
    size : (width, height) int, optional
        Size of a frame, pixels; by default that of `SIZES`.
    """
    size = size or SIZES[engine]
    scene = bpy.data.scenes.new(NAME)
    blocks: tuple[bpy.types.ID, ...] = ()
    renders = render_results()
    stages = Stages({"Timing whole frames": 8, "Timing only the triangles": 2})
    try:
        with levels_in(scene, simplified) as levels:
            show_only(levels, levels[0])
            blocks = prepare_scene(scene, [levels[0].obj], size)
            frame_turning(scene, levels[0], size)
            frame_drawing = RenderDrawing(scene, levels, engine)
            rounds_of = yield from stages.run(
                "Timing whole frames", rotation_steps(levels, frame_drawing, rounds, step_degrees)
            )
            drawn: list[list[float]] = [[] for _ in levels]
            if engine == "BLENDER_WORKBENCH":
                with TriangleDrawing(scene, levels, size) as triangles:
                    drawn = yield from stages.run(
                        "Timing only the triangles", rotation_steps(levels, triangles, rounds, step_degrees)
                    )
            return [
                LevelTimes(level.percent, len(level.mesh.faces), tuple(times), tuple(draws))
                for level, times, draws in zip(levels, rounds_of, drawn, strict=True)
            ]
    finally:
        remove_blocks(*blocks, scene)
        remove_render_results(renders)


def frame_turning(scene: bpy.types.Scene, level: Level, size: tuple[int, int]) -> None:
    """Move the camera back until the level stays in the picture at every angle about its z axis."""
    origin = np.array(level.obj.location, np.float64)
    points = meshes.read_positions(level.obj.data).astype(np.float64) + origin
    frame(scene.camera, swept(points, origin), view_axes(AZIMUTH, ELEVATION), size)


class RenderDrawing:
    """Draw a whole frame off screen: Blender evaluates the scene, passes the mesh to the engine, reads the picture."""

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
        """Render one frame to memory."""
        self.render(write_still=False, scene=self.scene.name)
