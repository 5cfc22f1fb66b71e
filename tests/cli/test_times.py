# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface of each time of a volume: in a folder, in turn on a .blend's timeline, in the report."""

import gc
import json
import math
import weakref

import numpy as np
import pytest
from shapes import distance_mm

from ctmc_addon import readers
from ctmc_addon.core import ReconstructionSettings, reconstruct

nibabel = pytest.importorskip("nibabel")
RADII = (4.0, 5.0, 6.0)


def balls(path, radii=RADII, label=False):
    """A ball in the middle of 20 mm, one radius after the other; gray values fall 10 with each mm."""
    distance = distance_mm((20, 20, 20))
    values = np.stack([1000 + 10 * (radius - distance) for radius in radii], axis=3).astype(np.float32)
    if label:
        values = (values >= 1000).astype(np.uint8)
    nibabel.Nifti1Image(values, np.eye(4)).to_filename(path)
    return path


@pytest.fixture
def beating(tmp_path):
    return balls(tmp_path / "heart.nii")


def test_every_time_becomes_a_file_and_an_entry_of_the_report(ctmc, beating, tmp_path):
    out, report = tmp_path / "out", tmp_path / "report.json"
    words = ("reconstruct", beating, "--time", "all", "--threshold", "1000")
    done = ctmc(*words, "-o", f"{out}/", "--report", report)
    assert done.code == 0, done.errors
    names = [f"heart time {time}" for time in (1, 2, 3)]
    assert sorted(path.name for path in out.iterdir()) == [f"{name}.stl" for name in names]
    said = json.loads(report.read_text("utf-8"))
    assert [(surface["time"], surface["name"]) for surface in said["surfaces"]] == list(enumerate(names, 1))
    assert [surface["stages"][0]["name"] for surface in said["surfaces"]] == ["Reading"] * 3
    for surface, radius in zip(said["surfaces"], RADII, strict=True):
        # Corners and triangles lie within the sphere; what is missing falls with the square of the radius in voxels.
        missing = 1 - surface["volume_mm3"] / (4 / 3 * math.pi * radius**3)
        assert 0 < missing < 0.65 / radius**2
        volume = readers.read_volume(beating, time=surface["time"])
        alone = reconstruct(volume, ReconstructionSettings(threshold=1000)).mesh
        alone.save(tmp_path / "alone.stl")
        assert (out / f"{surface['name']}.stl").read_bytes() == (tmp_path / "alone.stl").read_bytes()
    rows = [line.split() for line in done.out.splitlines()]
    assert ["time", "name", "triangles", "volume", "area", "components", "size", "cavities"] in rows
    table = [row[:4] for row in rows if row[1:2] == ["heart"] and row[0].isdigit()]
    assert table == [[str(time), "heart", "time", str(time)] for time in (1, 2, 3)]


def test_otsus_threshold_of_the_first_time_is_used_for_all(ctmc, tmp_path):
    heart, report = balls(tmp_path / "heart.nii"), tmp_path / "report.json"
    done = ctmc("reconstruct", heart, "--time", "all", "-o", f"{tmp_path / 'out'}/", "--report", report)
    assert done.code == 0, done.errors
    first = reconstruct(readers.read_volume(heart, time=1), ReconstructionSettings()).threshold
    said = json.loads(report.read_text("utf-8"))
    assert [surface["threshold"] for surface in said["surfaces"]] == [first] * 3
    note = f"Otsu's threshold of time 1, {first:.6g}, is used for all times"
    assert note in said["notes"]
    assert note in done.out
    own = [reconstruct(readers.read_volume(heart, time=time), ReconstructionSettings()).threshold for time in (1, 2)]
    assert own[1] != own[0]  # it would have moved


def test_names_sort_as_the_times_do(ctmc, tmp_path):
    heart = balls(tmp_path / "h.nii", [4 + 0.1 * time for time in range(10)], label=True)
    done = ctmc("reconstruct", heart, "--time", "ALL", "--label", "1", "--name", "beat", "-o", f"{tmp_path / 'out'}/")
    assert done.code == 0, done.errors
    files = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert files == [f"label 1 time {time:02d}.stl" for time in range(1, 11)]


def test_one_time_is_in_memory_at_a_time(ctmc, beating, tmp_path, monkeypatch):
    read, alive = readers.VolumeSource.read_steps, []

    def remembered_steps(source, *args, **options):
        gc.collect()
        alive.append(sum(volume() is not None for volume in volumes))
        volume = yield from read(source, *args, **options)
        volumes.append(weakref.ref(volume.values))
        return volume

    volumes = []
    monkeypatch.setattr(readers.VolumeSource, "read_steps", remembered_steps)
    assert ctmc("reconstruct", beating, "--time", "all", "-o", f"{tmp_path / 'out'}/").code == 0
    assert alive == [0, 0, 0]


def check_turns(opened):
    """At each frame the object of its time is shown alone, in viewports and in renders."""
    assert (opened.frame_start, opened.frame_end, opened.frame_current) == (1, 3, 1)
    (collection,) = (folder for folder in opened.collection.children if folder.name != "CTMC Studio")
    assert collection.name == "heart"
    objects = list(collection.objects)
    assert [obj.name for obj in objects] == [f"heart time {time}" for time in (1, 2, 3)]
    assert [obj.hide_render for obj in objects] == [False, True, True]
    for frame in (3, 1, 2, 1):
        opened.frame_set(frame)
        graph = opened.view_layers[0].depsgraph
        for switch in ("hide_viewport", "hide_render"):
            shown = [not getattr(obj.evaluated_get(graph), switch) for obj in objects]
            assert shown == [time == frame for time in (1, 2, 3)], (frame, switch)
        seen = [item.object.original for item in graph.object_instances if item.object.type == "MESH"]
        assert seen == [objects[frame - 1]]


def test_a_blend_shows_one_time_after_the_other(ctmc, beating, tmp_path, scene):
    scene.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    target = tmp_path / "heart.blend"
    actions = len(scene.data.actions)
    done = ctmc("reconstruct", beating, "--time", "all", "--threshold", "1000", "-o", target)
    assert done.code == 0, done.errors
    assert len(scene.data.actions) == actions
    scene.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    for path in (target, tmp_path / "saved again.blend"):
        scene.ops.wm.open_mainfile(filepath=str(path), load_ui=False)
        check_turns(scene.context.scene)
        scene.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved again.blend"))
    scene.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


def test_a_time_without_a_surface_is_left_out_and_said(ctmc, refused, tmp_path):
    heart, report = balls(tmp_path / "heart.nii", [4.0, 0.0, 5.0], label=True), tmp_path / "report.json"
    words = ("reconstruct", heart, "--time", "all", "--label")
    done = ctmc(*words, "1", "-o", f"{tmp_path / 'out'}/", "--report", report)
    assert done.code == 0, done.errors
    assert "time 2 is left out: " in done.out
    assert [surface["time"] for surface in json.loads(report.read_text("utf-8"))["surfaces"]] == [1, 3]
    assert "label 7" in refused(*words, "7", "-o", f"{tmp_path / 'none'}/")


def test_what_cannot_be_is_one_sentence(ctmc, refused, misused, beating, tmp_path):
    folder = f"{tmp_path / 'out'}/"
    words = ("reconstruct", beating, "--time", "all", "-o")
    assert "one surface per time" in misused(*words, folder, "--label", "all")
    assert "one surface per time" in misused(*words, folder, "--label", "1,2")
    assert "leave --figure out" in misused(*words, folder, "--figure", tmp_path / "x.png")
    assert "leave --scheduler out" in misused(*words, folder, "--scheduler", "tcp://x:1")
    assert "which a .stl cannot show one after the other" in misused(*words, tmp_path / "x.stl")
    assert "which a .glb cannot show one after the other" in misused(*words, tmp_path / "x.glb")
    assert "write a whole number" in misused("info", beating, "--time", "all")
    single = balls(tmp_path / "one.nii", [5.0])
    assert "one.nii holds a single time; leave --time all out" in refused(
        "reconstruct", single, "--time", "all", "-o", folder
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["heart.nii", "one.nii"]
