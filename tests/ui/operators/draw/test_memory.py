# SPDX-License-Identifier: GPL-3.0-or-later
"""What is kept in memory of a drawing goes with its structure, its slice and its CT."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
from ui.strokes import mask, middle, stroke

from ctmc_addon.ui.state.ct import scans, volumes
from ctmc_addon.ui.state.draw import drawings
from ctmc_addon.ui.viewport.draw import drawn


@pytest.fixture
def other_file(tmp_path):
    np.save(tmp_path / "other.npy", np.arange(24**3, dtype=np.int16).reshape(24, 24, 24))
    return tmp_path / "other.npy"


def shown():
    """Of which structures and slices there are pictures, and of which structures surfaces."""
    return {place[1:] for place in drawn._pictures}, {place[1] for place in drawn._surfaces}


def test_pictures_go_with_their_slice_their_structure_and_their_ct(drawing, other_file):
    scene = bpy.context.scene
    for _ in range(2):
        bpy.ops.ctmc.draw_add()
        stroke(middle())
    bpy.ops.ctmc.add_slice()
    plane, uid = bpy.context.object, bpy.context.object.session_uid
    first, second = (item.key for item in drawings.structures(scene))
    for key in (first, second):
        drawn._surfaces[scene.session_uid, key] = (1, None)
        for at in ("shown", uid):
            drawn._pictures[scene.session_uid, key, at] = (None, None)
    drawn._pictures[-1, first, "shown"] = (None, None)  # of a scene that was removed
    drawn.discard(scene)
    assert shown() == ({(first, "shown"), (first, uid), (second, "shown"), (second, uid)}, {first, second})
    bpy.data.objects.remove(plane)
    drawn.discard(scene)
    assert shown() == ({(first, "shown"), (second, "shown")}, {first, second})
    bpy.ops.ctmc.remove_structure()
    drawn.discard(scene)
    assert shown() == ({(first, "shown")}, {first})
    bpy.ops.ctmc.load(filepath=str(other_file), spacing=(1, 1, 2))
    drawn.discard(scene)
    assert shown() == (set(), set())


def test_masks_are_counted_with_their_ct_and_go_with_it(drawing, other_file, monkeypatch):
    scene = bpy.context.scene
    stroke(middle())
    fingerprint, before, room = scene.ctmc.volume_fingerprint, mask().copy(), volumes.current(scene).nbytes
    assert volumes.ct_of(fingerprint).nbytes == room + before.nbytes
    monkeypatch.setattr(volumes, "available_bytes", lambda: room + before.nbytes)
    bpy.ops.ctmc.load(filepath=str(other_file), spacing=(1, 1, 2))
    assert volumes.ct_of(fingerprint) is not None
    assert scans.activate(scene, fingerprint)
    monkeypatch.setattr(volumes, "available_bytes", lambda: room + before.nbytes - 1)
    bpy.ops.ctmc.load(filepath=str(other_file), spacing=(1, 1, 2))
    assert volumes.ct_of(fingerprint) is None


def test_a_mask_goes_along_when_its_ct_is_read_another_way(drawing):
    scene = bpy.context.scene
    stroke(middle())
    for spacing in (2.5, 3, 3.5):
        scene.ctmc.spacing = (1, 1, spacing)
        bpy.ops.ctmc.load(again=True)
        assert mask().any()
    assert [len(ct.drawn) for ct in volumes.all_cts()][-1] == sum(len(ct.drawn) for ct in volumes.all_cts()) == 1
