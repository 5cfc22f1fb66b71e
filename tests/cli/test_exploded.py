# SPDX-License-Identifier: GPL-3.0-or-later
"""`--explode` of `ctmc reconstruct` and `ctmc figure`: files that show structures apart, and those that cannot."""

from __future__ import annotations

import html
import json
import re
import struct

import numpy as np
import pytest


@pytest.fixture
def halves(tmp_path):
    """A block of 20 mm that two labels share, 1 below 2, as a command's INPUT."""
    folder = tmp_path / "in"
    folder.mkdir()
    values = np.zeros((24, 24, 24), np.uint8)
    values[2:12, 2:22, 2:22], values[12:22, 2:22, 2:22] = 1, 2
    np.save(folder / "seg.npy", values)
    return folder / "seg.npy"


LABELS = ("--label", "1", "2", "--smoothing", "none", "--spacing", "1", "1", "1", "--explode", "12")


def nodes_of(path):
    raw = path.read_bytes()
    return json.loads(raw[20 : 20 + struct.unpack_from("<I", raw, 12)[0]])["nodes"]


def test_a_glb_and_a_page_hold_the_shifts(ctmc, halves, tmp_path):
    for suffix in (".glb", ".html"):
        assert ctmc("reconstruct", halves, *LABELS, "-o", tmp_path / f"a{suffix}").code == 0
    below, above = nodes_of(tmp_path / "a.glb")
    assert below == {"name": "label 1", "mesh": 0, "translation": [0.0, -0.012, 0.0]}
    assert above == {"name": "label 2", "mesh": 1, "translation": [0.0, 0.012, 0.0]}
    found = re.search(r'class="explode" data-facts="(.*?)"', (tmp_path / "a.html").read_text("utf-8"))
    slider = json.loads(html.unescape(found[1]))
    assert slider["start"] == slider["most"] == 12.0
    assert slider["away"] == [pytest.approx([0, 0, -1], abs=1e-5), pytest.approx([0, 0, 1], abs=1e-5)]


def test_a_report_is_the_same_with_and_without_it(ctmc, halves, tmp_path):
    reports = []
    for words in (LABELS, LABELS[:-2]):
        report = tmp_path / "report.json"
        assert ctmc("reconstruct", halves, *words, "-o", tmp_path / "a.glb", "--report", report).code == 0
        reports.append(json.loads(report.read_text("utf-8"))["surfaces"])
    assert [surface["area_mm2"] for surface in reports[0]] == [surface["area_mm2"] for surface in reports[1]]
    assert [surface["volume_mm3"] for surface in reports[0]] == [surface["volume_mm3"] for surface in reports[1]]


def test_a_blend_has_objects_apart_whose_meshes_and_locations_stay(scene, ctmc, halves, tmp_path):
    for name, words in (("plain", LABELS[:-2]), ("apart", LABELS)):
        assert ctmc("reconstruct", halves, *words, "-o", tmp_path / f"{name}.blend").code == 0
    kept = []
    for name in ("plain", "apart"):
        scene.ops.wm.open_mainfile(filepath=str(tmp_path / f"{name}.blend"))
        objects = [scene.data.objects[f"label {label}"] for label in (1, 2)]
        kept.append([(tuple(obj.location), tuple(obj.data.vertices[0].co)) for obj in objects])
        deltas = [tuple(obj.delta_location) for obj in objects]
        shift = 0.12 if name == "apart" else 0.0
        assert deltas == [pytest.approx((0, 0, -shift), abs=1e-5), pytest.approx((0, 0, shift), abs=1e-5)]
    assert kept[0] == kept[1]


def test_a_figure_beside_files_of_coordinates_shows_them_apart(
    scene, small_pictures, ctmc, halves, tmp_path, monkeypatch
):
    from ctmc_addon.blender.figure.rendering import render

    plain, shown = render.shown_surfaces, []
    monkeypatch.setattr(render, "shown_surfaces", lambda *words, **rest: shown.append(rest) or plain(*words, **rest))
    words = ("-o", tmp_path / "a.3mf", "--figure", tmp_path / "a.png")
    assert ctmc("reconstruct", halves, *LABELS, *words).code == 0
    assert shown == [{"explode": 12.0}]
    assert ctmc("reconstruct", halves, *LABELS[:-2], "-o", tmp_path / "b.3mf").code == 0
    assert (tmp_path / "a.3mf").read_bytes() == (tmp_path / "b.3mf").read_bytes(), "it keeps the patient's coordinates"


@pytest.mark.parametrize("suffix", [".obj", ".3mf"])
def test_a_file_of_coordinates_alone_is_refused(refused, halves, tmp_path, suffix):
    sentence = refused("reconstruct", halves, *LABELS, "-o", tmp_path / f"a{suffix}")
    assert f"a{suffix} holds the patient's coordinates alone" in sentence
    assert "write .glb, .html or .blend" in sentence


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("reconstruct", *LABELS, "--format", "glb", "-o", "out/"), "each file of a folder holds one surface"),
        (("reconstruct", "--label", "1", "--explode", "5", "-o", "a.glb"), "there is one; give several labels"),
        (("reconstruct", "--threshold", "1", "--explode", "5", "-o", "a.glb"), "there is one; give several labels"),
        (("reconstruct", "--time", "all", "--explode", "5", "-o", "a.blend"), "several surfaces of one time"),
        (("reconstruct", "--label", "all", "--explode", "-5", "-o", "a.glb"), "--explode: must be from 0 to 1000"),
        (("figure", "--label", "1", "--explode", "5", "-o", "a.png"), "there is one; give several labels"),
        (("figure", "turntable", "--label", "1", "--explode", "5", "-o", "t"), "there is one; give several labels"),
        (("figure", "--label", "all", "--explode", "2000", "-o", "a.png"), "must be from 0 to 1000, not 2000"),
    ],
)
def test_what_cannot_be_moved_apart_is_wrong_usage(misused, halves, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    assert said in misused(*words, halves)
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_a_figure_says_that_it_is_exploded(scene, ctmc, halves, tmp_path):
    words = ("--dpi", "40", "--style", "clinical", "-o", tmp_path / "a.png")
    assert ctmc("figure", halves, *LABELS, *words).code == 0
    scene.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    texts = " ".join(obj.data.body for obj in scene.data.objects if obj.type == "FONT").replace("\n", " ")
    assert "exploded by 12 mm" in texts


def test_a_settings_file_gives_a_figure_its_shift_and_one_surface_stays(scene, ctmc, halves, tmp_path):
    (tmp_path / "a.toml").write_text("[figure]\nexplode = 12.0\n", "utf-8")
    words = ("--smoothing", "none", "--spacing", "1", "1", "1", "--settings", tmp_path / "a.toml", "--dpi", "40")
    for labels in (("1",), ("1", "2")):
        done = ctmc("figure", halves, "--label", *labels, *words, "-o", tmp_path / f"{len(labels)}.png")
        assert done.code == 0, done.errors
        scene.ops.wm.open_mainfile(filepath=str(tmp_path / f"{len(labels)}.blend"))
        texts = " ".join(obj.data.body for obj in scene.data.objects if obj.type == "FONT").replace("\n", " ")
        assert ("exploded" in texts) == (len(labels) > 1)
