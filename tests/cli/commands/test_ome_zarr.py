# SPDX-License-Identifier: GPL-3.0-or-later
"""OME-Zarr through the command line: a sphere of known volume, levels, labels, and what info says."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

zarr = pytest.importorskip("zarr")

from zarr_stores import LENGTHS, attributes, save_store

RADIUS = 12.0
SHAPE = (20, 64, 56)
LENGTHS_ZYX = [LENGTHS[axis] for axis in "zyx"]


def distances():
    """Distance of every sample from a center between the samples, mm."""
    axes = [(np.arange(size) - size / 2 + 0.3) * length for size, length in zip(SHAPE, LENGTHS_ZYX, strict=True)]
    z, y, x = np.meshgrid(*axes, indexing="ij")
    return np.sqrt(x * x + y * y + z * z)


@pytest.fixture(scope="module", params=["0.4", "0.5"])
def ball(request, tmp_path_factory):
    """A ball whose values fall by 10 a millimeter, 0 at its surface, beside labels of it and of a shell."""
    path = tmp_path_factory.mktemp("zarr") / "ball.ome.zarr"
    away = distances()
    save_store(path, (10 * (RADIUS - away)).astype("f4"), request.param, levels=2, chunks=(6, 20, 20))
    group = zarr.open_group(str(path / "labels"), mode="w", zarr_format=2 if request.param == "0.4" else 3)
    group.attrs.update(attributes(request.param, labels=["organs"]))
    organs = np.where(away < 8, 1, np.where(away < RADIUS, 2, 0)).astype("u1")
    properties = [{"label-value": 1, "name": "core"}, {"label-value": 2, "name": "shell"}]
    colors = [{"label-value": 1, "rgba": [255, 0, 0, 255]}]
    about = {"image-label": {"properties": properties, "colors": colors}}
    save_store(path / "labels" / "organs", organs, request.param, chunks=(6, 20, 20), about=about)
    return path


def report(outcome, path):
    assert outcome.code == 0, outcome.errors
    return json.loads(path.read_text("utf-8"))


@pytest.mark.parametrize(("level", "below"), [(0, 0.01), (1, 0.03)])
def test_a_ball_has_its_volume_at_every_level(ctmc, ball, tmp_path, level, below):
    saved = tmp_path / "ball.json"
    flags = ["--threshold", 0, "--level", level, "-o", tmp_path / "ball.stl", "--report", saved]
    facts = report(ctmc("reconstruct", ball, *flags), saved)
    exact = 4 / 3 * math.pi * RADIUS**3
    assert facts["closed"]
    assert (1 - below) * exact < facts["volume_mm3"] < exact
    sizes = "0 (56 x 64 x 20), 1 (28 x 32 x 10)"
    assert f"level {level} was read of the levels of resolution {sizes}" in facts["notes"]


def test_a_region_with_a_stride_gives_the_bytes_of_npy_at_the_same_place(ctmc, ball, tmp_path):
    np.save(tmp_path / "ball.npy", zarr.open_array(str(ball / "0"), mode="r")[...])
    flags = ["--threshold", 0, "--region", 10, 9, 3, 50, 60, 15, "--stride", 2, 3, 1, "--close-border"]
    for source, name in ((ball, "zarr"), (tmp_path / "ball.npy", "npy")):
        spacing = ["--spacing", 0.7, 0.5, 2] if name == "npy" else []
        assert ctmc("reconstruct", source, *flags, *spacing, "-o", tmp_path / f"{name}.stl").code == 0
    triangles = [
        np.frombuffer((tmp_path / f"{name}.stl").read_bytes()[84:], np.dtype([("xyz", "<f4", (4, 3)), ("", "<u2")]))
        for name in ("zarr", "npy")
    ]
    assert len(triangles[0]) == len(triangles[1]) > 1000
    apart = triangles[0]["xyz"][:, 1:] - triangles[1]["xyz"][:, 1:]
    np.testing.assert_allclose(apart, np.broadcast_to([30.0, -20.0, 10.0], apart.shape), atol=1e-4)


def test_all_labels_are_written_by_their_names(ctmc, ball, tmp_path):
    (tmp_path / "out").mkdir()
    outcome = ctmc("reconstruct", ball / "labels" / "organs", "--label", "all", "-o", f"{tmp_path}/out/")
    assert outcome.code == 0, outcome.errors
    assert sorted(path.name for path in (tmp_path / "out").glob("*.stl")) == ["core.stl", "shell.stl"]


def test_info_lists_levels_and_label_groups(ctmc, ball):
    out = ctmc("info", ball).out
    for line in ("OME-Zarr", "0: 56 x 64 x 20", "1: 28 x 32 x 10", "labels/organs"):
        assert line in out
    facts = json.loads(ctmc("info", ball, "--level", 1, "--json").out)
    assert (facts["format"], facts["size"], facts["spacing_mm"]) == ("OME-Zarr", [28, 32, 10], [1.4, 1.0, 4.0])
    assert facts["levels"] == [[56, 64, 20], [28, 32, 10]]
    assert facts["label_groups"] == ["labels/organs"]
    labels = json.loads(ctmc("info", ball / "labels" / "organs", "--json").out)["labels"]
    assert [(label["value"], label["name"], label["color"]) for label in labels] == [
        (0, "", None),
        (1, "core", "#ff0000"),
        (2, "shell", None),
    ]


def test_a_level_that_is_not_there_is_refused(ctmc, refused, misused, ball, tmp_path):
    sentence = refused("reconstruct", ball, "--level", 2, "-o", tmp_path / "x.stl")
    assert sentence == "ctmc: ball.ome.zarr has no level 2; choose from 0 to 1"
    assert "must be 0 or more, not -1" in misused("reconstruct", ball, "--level=-1", "-o", tmp_path / "x.stl")
    np.save(tmp_path / "a.npy", np.zeros((3, 4, 5), np.int16))
    assert "has one resolution" in refused("info", tmp_path / "a.npy", "--level", 1)


def test_a_manifest_has_a_level(ctmc, ball, tmp_path):
    (tmp_path / "cases.csv").write_text(f"input,case,level,threshold\n{ball},fine,,0\n{ball},coarse,1,0\n")
    outcome = ctmc("batch", tmp_path / "cases.csv", "-o", tmp_path / "out", "--no-thumbnails", "--jobs", 1)
    assert outcome.code == 0, outcome.errors
    faces = [json.loads((tmp_path / "out" / f"{name}.json").read_text())["faces"] for name in ("fine", "coarse")]
    assert faces[0] > 3 * faces[1] > 0
