# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel, command line, batch and Python write the same bytes, of one surface and of labels that touch."""

from __future__ import annotations

import shlex

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.cli import main
from ctmc_addon.core import ReconstructionSettings, finish, reconstruct, reconstruct_labels_steps, save_structures
from ctmc_addon.readers import read_volume
from ctmc_addon.reporting.command_line import command_of

SPACING = ("--spacing", "1", "1", "2")
OF_THRESHOLDS = (
    {},
    {"upper": 140.0, "close_border": True},
    {"alpha": 0.3},
    {"stride": (2, 2, 1), "topology": "trilinear"},
    {"smoothing": "gaussian", "smoothing_mm": 1.0},
    {"region": (2.0, 2.0, 2.0, 20.0, 16.0, 10.0)},
    {"keep_parts": 1, "min_part_mm3": 5.0, "normals": "mesh"},
    {"reduction": 0.5},
    {"max_error_mm": 0.2},
)
NAME = "totalsegmentator_seg"
OF_LABELS = ({}, {"interfaces": "separate"}, {"reduction": 0.4})


def test_each_setting_of_these_works_makes_another_surface_than_none(ball_file):
    volume = read_volume(ball_file, (1, 1, 2))
    results = [reconstruct(volume, ReconstructionSettings(threshold=100.0, **work)) for work in OF_THRESHOLDS]
    meshes = [
        (each.mesh.vertices.tobytes(), each.mesh.faces.tobytes(), each.mesh.normals.tobytes()) for each in results
    ]
    assert len(set(meshes)) == len(OF_THRESHOLDS)


@pytest.mark.parametrize("work", OF_THRESHOLDS, ids=str)
def test_a_threshold_has_the_same_bytes_everywhere(scene, ball_file, tmp_path, work):
    settings = ReconstructionSettings(threshold=100.0, **work)
    files = [tmp_path / name for name in ("panel.ply", "command.ply", "python.ply", "batch/ball.ply")]
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    scene.ctmc.from_settings(settings)
    assert scene.ctmc.to_settings() == settings
    bpy.ops.ctmc.reconstruct()
    bpy.ops.ctmc.export(filepath=str(files[0]))
    flags = [*SPACING, *shlex.split(command_of(settings))]
    assert main(["reconstruct", str(ball_file), "-o", str(files[1]), *flags]) == 0
    reconstruct(read_volume(ball_file, (1, 1, 2)), settings).mesh.save(files[2])
    batch = ["batch", str(ball_file), "-o", str(tmp_path / "batch"), "--output-format", "ply", "--no-thumbnails"]
    assert main([*batch, *flags]) == 0
    assert len({file.read_bytes() for file in files}) == 1


@pytest.mark.parametrize("work", OF_LABELS, ids=str)
def test_labels_that_touch_have_the_same_bytes_everywhere(scene, tmp_path, work):
    values = np.zeros((10, 12, 14), np.uint8)
    values[3:7, 3:9, 3:7], values[3:7, 3:9, 7:11] = 2, 5  # liver and kidney
    np.save(tmp_path / f"{NAME}.npy", values)
    (tmp_path / "command").mkdir()
    (tmp_path / "panel").mkdir()
    (tmp_path / "python").mkdir()
    files = [tmp_path / name / f"{NAME}.obj" for name in ("panel", "command", "python", "batch")]
    settings = ReconstructionSettings(label=2, **work)
    bpy.ops.ctmc.load(filepath=str(tmp_path / f"{NAME}.npy"), spacing=(1, 1, 2))
    scene.ctmc.from_settings(settings)
    for item in scene.ctmc.labels:
        item.chosen = True
    bpy.ops.ctmc.reconstruct()
    bpy.ops.ctmc.export(filepath=str(files[0]))
    given = command_of(ReconstructionSettings(**work))
    flags = [*SPACING, *shlex.split(given), "--label", "all"]
    assert main(["reconstruct", str(tmp_path / f"{NAME}.npy"), "-o", str(files[1]), *flags]) == 0
    volume = read_volume(tmp_path / f"{NAME}.npy", (1, 1, 2))
    made = finish(reconstruct_labels_steps(volume, settings, None))
    save_structures(files[2], made.surfaces)
    batch = [
        "batch",
        str(tmp_path / f"{NAME}.npy"),
        "-o",
        str(tmp_path / "batch"),
        "--output-format",
        "obj",
        "--no-thumbnails",
    ]
    assert main([*batch, *flags]) == 0
    assert len({file.read_bytes() for file in files}) == 1
