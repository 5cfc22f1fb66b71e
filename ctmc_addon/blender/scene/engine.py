# SPDX-License-Identifier: GPL-3.0-or-later
"""Set the engine of F12 so that a picture of any surface ends in a minute or two without a graphics card.

Cycles takes few samples before its denoiser, more without one, and stops at a time limit with the noise that remains.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy

from ..figure.rendering.samples import can_denoise
from ..figure.spec import ENGINES
from ..figure.styles import require_engine
from ..viewport.shaders import draws_in_software

DENOISED, NOISY = 24, 64  # Samples of a pixel with and without the denoiser.
NOISE = 0.05  # Noise of a pixel, as Cycles measures it, at which it stops.
FEWEST = 8
LONGEST_S = 60.0  # Time limit of Cycles' samples, seconds.
EEVEE_SAMPLES = 32
BOUNCES, LAYERS = 4, 64  # Reflections of light, and transparent surfaces that it passes.
# Seconds of a processor core: of each triangle, of a thousand samples, and of a thousand pixels for the denoiser.
PER_TRIANGLE, PER_SAMPLES, PER_DENOISED = 3e-6, 1.6e-3, 4e-3


class RenderPlan(NamedTuple):
    """Settings with which F12 renders; `seconds` are predicted for Cycles without a graphics card."""

    engine: str
    samples: int
    size: tuple[int, int]
    seconds: float | None


def engine_here(engine: str) -> str:
    """Return the engine to use instead of a chosen one: without a graphics card EEVEE takes minutes, Cycles less."""
    has_cycles = hasattr(bpy.types.Scene, "cycles")
    return "cycles" if engine == "eevee" and has_cycles and draws_in_software() else engine


def engine_of(scene: bpy.types.Scene) -> str:
    """Return the name in `ENGINES` of a scene's engine; empty for any other."""
    identifier = scene.render.engine.removesuffix("_NEXT")
    return next((name for name, engine in ENGINES.items() if engine.identifier == identifier), "")


def set_render_engine(scene: bpy.types.Scene, engine: str) -> None:
    """Set engine, samples, denoiser and time limit of a scene.

    Raises
    ------
    OutputError
        If the engine does not work here.
    """
    require_engine(engine)
    render, identifier = scene.render, ENGINES[engine].identifier
    if engine == "eevee" and bpy.app.version < (5, 0, 0):
        identifier += "_NEXT"
    render.engine = identifier
    if engine == "cycles":
        _set_cycles(scene.cycles)
    elif engine == "eevee":
        scene.eevee.taa_render_samples, scene.eevee.use_shadows = EEVEE_SAMPLES, True
    else:
        shading = scene.display.shading
        shading.light, shading.color_type, shading.background_type = "STUDIO", "MATERIAL", "WORLD"
        shading.show_cavity = True
        scene.display.render_aa = "8"


def _set_cycles(cycles: Any) -> None:
    denoised = can_denoise()
    cycles.samples = DENOISED if denoised else NOISY
    cycles.use_adaptive_sampling, cycles.adaptive_threshold, cycles.adaptive_min_samples = True, NOISE, FEWEST
    cycles.time_limit = LONGEST_S
    cycles.use_denoising = denoised
    if denoised:
        # With albedo and normals as guides, translucent surfaces keep their grain, and white loses more at the border.
        cycles.denoiser, cycles.denoising_input_passes = "OPENIMAGEDENOISE", "RGB"
    cycles.max_bounces, cycles.transparent_max_bounces = BOUNCES, LAYERS


def render_plan(scene: bpy.types.Scene, triangles: int) -> RenderPlan:
    """Return the settings with which F12 renders a scene, and the predicted seconds for a number of triangles."""
    render, engine = scene.render, engine_of(scene)
    share = render.resolution_percentage / 100
    width, height = int(render.resolution_x * share), int(render.resolution_y * share)
    if engine != "cycles":
        samples = scene.eevee.taa_render_samples if engine == "eevee" else 0
        return RenderPlan(engine, samples, (width, height), None)
    if scene.cycles.device == "GPU":
        return RenderPlan(engine, scene.cycles.samples, (width, height), None)
    cycles, cores = scene.cycles, render.threads
    kilopixels = width * height / 1000
    traced = kilopixels * cycles.samples * PER_SAMPLES / cores
    if cycles.time_limit > 0.0:
        traced = min(traced, cycles.time_limit)
    rest = triangles * PER_TRIANGLE + (kilopixels * PER_DENOISED / cores if cycles.use_denoising else 0.0)
    return RenderPlan(engine, cycles.samples, (width, height), rest + traced)
