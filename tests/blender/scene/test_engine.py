# SPDX-License-Identifier: GPL-3.0-or-later
"""The engine of F12: what is set, what is said, and Cycles where the processor would draw for EEVEE."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.scene import engine as engines
from ctmc_addon.blender.scene.engine import engine_here, engine_of, render_plan, set_render_engine
from ctmc_addon.blender.viewport.shaders import draws_in_software


@pytest.mark.parametrize(("can_denoise", "samples"), [(True, engines.DENOISED), (False, engines.NOISY)])
def test_cycles_has_a_time_limit_and_the_denoiser_if_there_is_one(scene, monkeypatch, can_denoise, samples):
    monkeypatch.setattr(engines, "can_denoise", lambda: can_denoise)
    set_render_engine(scene, "cycles")
    cycles = scene.cycles
    assert (scene.render.engine, cycles.samples, cycles.use_denoising) == ("CYCLES", samples, can_denoise)
    assert cycles.use_adaptive_sampling
    assert cycles.time_limit == engines.LONGEST_S
    assert engine_of(scene) == "cycles"


@pytest.mark.parametrize("engine", ["eevee", "workbench"])
def test_other_engines_are_set_and_found_again(scene, monkeypatch, engine):
    monkeypatch.setattr(engines, "require_engine", lambda _name: None)
    set_render_engine(scene, engine)
    assert engine_of(scene) == engine
    assert render_plan(scene, 10).seconds is None


@pytest.mark.parametrize(
    ("renderer", "software"),
    [
        ("llvmpipe (LLVM 19.1.7, 256 bits)", True),
        ("Microsoft Basic Render Driver", True),
        ("NVIDIA GeForce RTX 3060/PCIe/SSE2", False),
        ("Apple M2", False),
    ],
)
def test_eevee_gives_way_to_cycles_where_the_processor_draws(monkeypatch, renderer, software):
    gpu = SimpleNamespace(platform=SimpleNamespace(renderer_get=lambda: renderer))
    monkeypatch.setitem(sys.modules, "gpu", gpu)
    assert draws_in_software() is software
    assert engine_here("eevee") == ("cycles" if software else "eevee")
    assert engine_here("workbench") == "workbench"


def test_the_predicted_time_grows_with_triangles_and_pixels_up_to_the_limit(scene):
    set_render_engine(scene, "cycles")
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 1000, 1000, 50
    scene.render.threads_mode, scene.render.threads = "FIXED", 2
    small, many = render_plan(scene, 0), render_plan(scene, 1_000_000)
    assert small.size == (500, 500)
    assert many.seconds - small.seconds == pytest.approx(engines.PER_TRIANGLE * 1_000_000)
    scene.render.resolution_percentage = 100
    assert render_plan(scene, 0).seconds == pytest.approx(4 * small.seconds, rel=1e-6)
    scene.cycles.samples = 100_000
    denoised = 1000 * engines.PER_DENOISED / 2 if scene.cycles.use_denoising else 0.0
    assert render_plan(scene, 0).seconds == pytest.approx(engines.LONGEST_S + denoised)
    scene.cycles.device = "GPU"
    assert render_plan(scene, 0).seconds is None
