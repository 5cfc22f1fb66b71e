# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of all surfaces: the numbers of `ctmc measure`."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ui.drawing import drawn

from ctmc_addon.cli import main
from ctmc_addon.core import volume_text
from ctmc_addon.ui.operators.results.table import csv_of
from ctmc_addon.ui.panels.results.table import draw_measurements


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_it_is_what_the_command_measures_and_can_be_saved(loaded, ball_file, tmp_path):
    bpy.ops.ctmc.reconstruct()
    assert not bpy.ops.ctmc.table_copy.poll()
    assert bpy.ops.ctmc.table() == {"FINISHED"}
    bpy.ops.ctmc.table_save(filepath=str(tmp_path / "scene.csv"))
    words = ["--spacing", "1", "1", "2", "--threshold", "100", "-o", str(tmp_path / "command.csv"), "--quiet"]
    assert main(["measure", str(ball_file), *words]) == 0
    [own], [theirs] = (rows_of((tmp_path / f"{name}.csv").read_text("utf-8")) for name in ("scene", "command"))
    assert own.pop("name") == bpy.context.object.name
    assert theirs.pop("name") == "ball"
    for name, value in own.items():
        assert value == theirs[name] or float(value) == pytest.approx(float(theirs[name]), rel=1e-5), name
    texts = drawn(draw_measurements).texts
    assert f"{float(theirs['largest_diameter_mm']):.4g} mm" in texts
    assert volume_text(float(theirs["volume_ml"]) * 1000) in texts


def test_labels_are_measured_in_the_ct_on_their_grid(loaded, ball_file, tmp_path):
    labels = np.zeros((12, 24, 24), np.uint8)
    labels[3:9, 6:12, 5:20], labels[3:9, 12:15, 5:20] = 1, 2
    np.save(tmp_path / "labels.npy", labels)
    bpy.ops.ctmc.load(filepath=str(tmp_path / "labels.npy"), spacing=(1, 1, 2))
    loaded.ctmc.use_label = True
    for item in loaded.ctmc.labels:
        item.chosen = True
    bpy.ops.ctmc.reconstruct()
    bpy.ops.ctmc.table()
    values = np.load(ball_file)
    rows = rows_of(csv_of(loaded))
    assert [row["label"] for row in rows] == ["1", "2"]
    for row in rows:
        inside = values[labels == int(row["label"])]
        assert float(row["mean_gray"]) == pytest.approx(inside.mean(), rel=1e-8)
        assert float(row["sd_gray"]) == pytest.approx(inside.std(), rel=1e-8)
