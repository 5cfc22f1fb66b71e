# SPDX-License-Identifier: GPL-3.0-or-later
"""Turntables: a seamless loop of whole pictures that can be gone on with, and films of it."""

from __future__ import annotations

import json

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
Image = pytest.importorskip("PIL.Image")

from ctmc_addon.blender.figure.spec import VIDEO_FORMATS, Cell, FigureStyle, Page, ShownSurface, Turn
from ctmc_addon.blender.figure.turntable import FRAME, turntable_steps
from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.core import finish
from ctmc_addon.core.errors import OutputError, SettingsError

PAGE = Page(40.0, 40.0)
STYLE = FigureStyle(style="clinical", orientation=False, scale_bar=False)
TURN = Turn(1.0, 4, 1)


@pytest.fixture
def thing(scene, torus):
    thing = add_reconstruction(torus(rings=16, sides=8), scene)
    thing.rotation_euler = (1.2, 0.0, 0.0)  # so that a turn is seen
    bpy.context.view_layer.update()
    return thing


def turntable(thing, path, page=PAGE, turn=TURN, **rest):
    return finish(turntable_steps(Cell((ShownSurface(thing),)), path, page, STYLE, turn, **rest))


def picture(path):
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), np.float64) / 255


def frames(folder):
    return sorted(one.name for one in folder.glob("*.png"))


@pytest.mark.parametrize(
    ("seconds", "fps", "revolutions", "count"), [(2.0, 12, 1, 24), (0.5, 30, 3, 15), (3, 25, -2, 75)]
)
def test_a_loop_has_even_steps_and_no_frame_twice(seconds, fps, revolutions, count):
    turn = Turn(seconds, fps, revolutions)
    assert turn.frames == count
    angles = np.array([turn.degrees(frame) for frame in range(count + 1)])
    assert np.diff(angles) == pytest.approx(360 * revolutions / count)
    assert angles[-1] == pytest.approx(360 * revolutions)  # the frame after the last is the first


@pytest.mark.parametrize(
    "given", [{"seconds": 0.0}, {"fps": 0}, {"revolutions": 0}, {"seconds": 0.1}, {"seconds": 1e6}, {"revolutions": 99}]
)
def test_what_is_no_loop_is_refused(given):
    with pytest.raises(SettingsError):
        Turn(**given)


def test_frames_turn_the_surface_and_keep_it_in_the_picture(thing, tmp_path):
    size, rendered = turntable(thing, tmp_path / "loop")
    assert rendered == 4
    assert frames(tmp_path / "loop") == [FRAME.format(at) for at in (1, 2, 3, 4)]
    pictures = [picture(tmp_path / "loop" / name) for name in frames(tmp_path / "loop")]
    assert all(one.shape == (size[1], size[0], 3) for one in pictures)
    assert size[0] % 2 == size[1] % 2 == 0
    for one, after in zip(pictures, [*pictures[1:], pictures[0]], strict=True):
        assert (np.abs(one - after).max(axis=2) > 0.2).mean() > 0.02
        shown = (one < 0.9).any(axis=2)
        assert not shown[0].any()
        assert not shown[-1].any()
        assert not shown[:, 0].any()
        assert not shown[:, -1].any()
    assert len(bpy.data.scenes) == 1
    assert len(bpy.data.objects) == 1


def test_work_that_was_stopped_goes_on(thing, tmp_path, name_of_an_ended_process):
    folder = tmp_path / "loop"
    messages = []
    steps = turntable_steps(Cell((ShownSurface(thing),)), folder, PAGE, STYLE, TURN)
    for step in steps:
        messages.append(step.message)
        if step.message.startswith("Rendering frame 3"):
            break
    steps.close()
    assert "left" not in messages[1]
    assert "left" in messages[-1]
    assert len(frames(folder)) == 2
    assert len(bpy.data.scenes) == 1
    first = (folder / FRAME.format(1)).stat().st_mtime_ns
    (folder / FRAME.format(2)).write_bytes((folder / FRAME.format(2)).read_bytes()[:500])  # as if cut by a crash
    (folder / f"{name_of_an_ended_process()}.png").write_bytes(b"half a frame")
    with pytest.raises(OutputError, match="not empty"):
        turntable(thing, folder)
    assert turntable(thing, folder, resume=True)[1] == 3
    assert not list(folder.glob(".*"))
    assert (folder / FRAME.format(1)).stat().st_mtime_ns == first
    assert turntable(thing, folder, resume=True)[1] == 0
    with pytest.raises(OutputError, match="another turntable"):
        turntable(thing, folder, turn=Turn(1.0, 5), resume=True)
    assert turntable(thing, folder, turn=Turn(1.0, 3), overwrite=True)[1] == 3
    assert len(frames(folder)) == 3


def test_a_folder_with_other_things_is_not_touched(thing, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    for rest in ({}, {"resume": True}, {"overwrite": True}):
        with pytest.raises(OutputError, match=r"holds notes\.txt"):
            turntable(thing, tmp_path, **rest)
    assert [one.name for one in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_a_film_has_as_many_frames_as_the_loop(thing, tmp_path, suffix):
    film = tmp_path / f"Bauch ä{suffix}"
    size, _ = turntable(thing, film)
    clip = bpy.data.movieclips.load(str(film))
    assert clip.frame_duration == 4
    assert tuple(clip.size) == size
    assert [one.name for one in tmp_path.iterdir()] == [film.name]
    assert str(tmp_path).encode() not in film.read_bytes()


def test_a_film_that_cannot_be_written_is_refused_before_the_work(thing, tmp_path, monkeypatch):
    with pytest.raises(OutputError, match=r"\.gif is not a video"):
        turntable(thing, tmp_path / "a.gif")
    with pytest.raises(OutputError, match="a video has a background"):
        turntable(thing, tmp_path / "a.mp4", Page(40.0, 40.0, transparent=True))
    monkeypatch.setitem(VIDEO_FORMATS, ".mp4", ("NOTHING", "H264"))
    with pytest.raises(OutputError, match=r"built without \.mp4"):
        turntable(thing, tmp_path / "a.mp4")
    assert not list(tmp_path.iterdir())


def test_the_blend_turns_by_itself(thing, tmp_path):
    turntable(thing, tmp_path / "loop", blend=tmp_path / "a.blend")
    with bpy.data.libraries.load(str(tmp_path / "a.blend")) as (there, here):
        here.scenes = there.scenes
    scene = here.scenes[0]
    assert (scene.frame_start, scene.frame_end, scene.render.fps) == (1, 4, 4)
    pivot = next(one for one in scene.objects if one.name.startswith("CTMC Turntable"))
    for frame in (1, 2, 4, 5):
        scene.frame_set(frame)
        depsgraph = scene.view_layers[0].depsgraph
        assert pivot.evaluated_get(depsgraph).rotation_euler.z == pytest.approx(np.radians(90 * (frame - 1)))
    assert json.loads((tmp_path / "loop" / "turntable.json").read_text("utf-8"))["frames"] == 4
