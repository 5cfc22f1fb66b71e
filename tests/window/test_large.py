# SPDX-License-Identifier: GPL-3.0-or-later
"""A CT that does not fit below the memory limit: seen coarsely, and its surface made from the file by the button."""

from __future__ import annotations

import numpy as np
import pytest
from window.scenes import IDLE, QUIET, begin, load

from ctmc_addon.core import ReconstructionSettings, Volume, reconstruct

pytestmark = [pytest.mark.window, pytest.mark.once]

SHAPE, MIDDLE, RADIUS = (280, 768, 768), (140, 384, 384), 60
PREFERENCES = "bpy.context.preferences.addons[ours('ui.properties.preferences').ADDON].preferences"
SHOWN = """
ct = ours("ui.state.ct.volumes").loaded(bpy.context.scene)
answer = [list(ct.shown_stride), list(ct.full.size), list(ct.volume.size)]
"""


@pytest.fixture
def large(desk, tmp_path):
    """The path of a ball in 165 MB, and the part of it that holds the ball."""
    part = tuple(slice(middle - RADIUS - 4, middle + RADIUS + 5) for middle in MIDDLE)
    z, y, x = np.ogrid[-RADIUS - 4 : RADIUS + 5, -RADIUS - 4 : RADIUS + 5, -RADIUS - 4 : RADIUS + 5]
    ball = np.clip(100 + 10 * (RADIUS - np.sqrt(x**2 + y**2 + z**2)), 0, 200).astype(np.uint8)
    values = np.zeros(SHAPE, np.uint8)
    values[part] = ball
    np.save(tmp_path / "large.npy", values)
    yield desk.bring(tmp_path / "large.npy"), ball
    (desk.folder / "large.npy").unlink()
    desk.ask(f"{PREFERENCES}.memory_gib = 0")


def test_a_ct_above_the_limit_is_seen_coarsely_and_its_surface_is_that_of_the_file(desk, large):
    path, ball = large
    begin(desk)
    desk.ask(f"{PREFERENCES}.memory_gib = 0.14")
    load(desk, path)
    stride, size, copy = desk.ask(SHOWN)
    assert stride[0] >= 2
    assert size == list(reversed(SHAPE))
    assert copy == [-(-length // step) for length, step in zip(size, stride, strict=True)]
    desk.ask("bpy.context.scene.ctmc.threshold = 100")
    desk.wait(QUIET)
    desk.look("large-01-coarse")
    desk.press("bpy.ops.ctmc.reconstruct()", "reconstruct")
    desk.wait(f"{IDLE} and len(bpy.data.meshes) == 1")
    desk.look("large-02-made")
    whole = reconstruct(Volume(ball, np.eye(4)), ReconstructionSettings(threshold=100)).mesh
    assert whole.volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.005)  # values are whole numbers
    assert desk.ask("m = bpy.data.meshes[0]; answer = [len(m.vertices), len(m.polygons)]") == [
        len(whole.vertices),
        len(whole.faces),
    ]
