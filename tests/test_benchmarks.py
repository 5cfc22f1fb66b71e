# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark's own arithmetic, and that the pages it writes into are ready for it."""

import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks import documents, growth, patient, peers, processes, reading
from benchmarks.accuracy import PAGE as ACCURACY
from benchmarks.bench import PARTS
from benchmarks.measuring import Row, Session, least_seconds, peak_bytes, processor_seconds, stage_seconds, timed
from ctmc_addon.core.extraction.marching_cubes import marching_cubes
from ctmc_addon.core.progress import Step
from ctmc_addon.readers import read_volume

pytestmark = pytest.mark.once


@pytest.fixture
def session(tmp_path):
    return Session("part", 3, show=lambda row: None, say=lambda sentence: None, scratch=tmp_path, data=tmp_path)


@pytest.mark.parametrize(("target", "verdict", "met"), [(0.5, "met", True), (0.49, "not met", False), (None, "", None)])
def test_a_target_is_met_up_to_and_with_its_ratio(target, verdict, met):
    row = Row("part", "work", "peer", 1.0, 2.0, target)
    assert (row.ratio, row.verdict, row.as_dict()["met"]) == (0.5, verdict, met)


def test_competitors_run_in_turn_and_the_first_round_does_not_count(session):
    calls = []
    session.compare("work", lambda: calls.append("ours"), {"peer": (lambda: calls.append("peer"), 1.0)})
    assert calls == ["ours", "peer"] * 4
    assert [len(runs) for runs in session.rows[0].runs.values()] == [3, 3]


def test_no_round_begins_after_the_time_of_a_row_and_one_counts_in_any_case(session):
    session.row_seconds = 0.0
    assert session.race({"ours": lambda: None, "peer": lambda: None}).keys() == {"ours", "peer"}
    assert [len(runs) for runs in session.race({"ours": lambda: None}, warm=False).values()] == [1]


@pytest.mark.parametrize(
    ("shared", "clock", "typical", "threads"),
    [(False, time.perf_counter, 3.0, (1, 2)), (True, processor_seconds, 1.0, (1,))],
)
def test_on_a_shared_machine_processor_time_and_the_least_of_the_calls_count(session, shared, clock, typical, threads):
    session.shared = shared
    assert session.clock is clock
    assert session.typical([4.0, 1.0, 3.0]) == typical
    assert session.threads == threads


def test_the_rows_of_a_part_say_when_how_and_beside_whom_they_were_measured():
    row = Row("part", "work", "peer", 1.0, 2.0, note="all of it").as_dict()
    machine = {"date": "D", "load": 7.2, "processor": "P", "cores": 2}
    known = {"command": "make x", "machine": machine, "rows": [row]}
    text = documents.rows_text(known)
    assert text.startswith("D, `make x`, P, 2 cores, load 7 at the start.\n\n| work |")
    assert text.endswith("| work (all of it) | peer | 1 s | 2 s | 0.50 |")
    machine["load"] = 0.3
    assert documents.rows_text(known).startswith("D, `make x`, P, 2 cores.\n")


def test_a_call_is_timed_without_what_comes_before_and_after():
    seconds, result = timed(lambda: time.sleep(0.02) or 42)
    assert result == 42
    assert seconds >= 0.02


def test_the_peak_is_what_is_held_beside_the_result():
    def call():
        buffer = np.ones(1 << 20, np.uint8)
        return np.full(1 << 18, buffer[0], np.uint8)

    assert peak_bytes(call, lambda result: result.nbytes) == pytest.approx(1 << 20, rel=0.02)


def test_stages_are_named_after_the_steps_that_end_them(session):
    def steps():
        time.sleep(0.02)
        yield Step(0.5, "first")
        yield Step(1.0, "second")

    seconds = stage_seconds(session, steps)
    assert list(seconds) == ["first", "second"]
    assert seconds["first"] >= 0.02


def test_gaps_have_the_name_shown_meanwhile_and_esc_is_timed():
    pytest.importorskip("bpy")
    from benchmarks.steps import CONCLUSION, ESC, PRESS, gaps

    def job():
        yield Step(0.0, "first")
        yield Step(0.5, "first")
        time.sleep(0.02)
        yield Step(1.0, "second")
        return lambda: time.sleep(0.01)

    found = gaps(job, 60.0)
    assert {name: gap.steps for name, gap in found.items()} == {PRESS: 1, "first": 2, "second": 1, CONCLUSION: 1}
    assert found["first"].longest >= 0.02
    assert found[CONCLUSION].longest >= 0.01
    assert list(gaps(job, 0.0)) == [ESC]


def test_bytes_read_and_written_take_their_own_time():
    assert least_seconds(10.0, 6.0, {"read": 5.0, "write": 2.0}) == 5.0


def test_linear_growth_is_found_and_what_departs_from_it_said():
    points = [
        {"voxels": voxels, "triangles": triangles, "seconds": 2e-9 * voxels + 5e-8 * triangles + 1e-3}
        for voxels, triangles in ((1e6, 1e4), (1e7, 1e5), (1e8, 3e5), (2e8, 1e6))
    ]
    price = growth.prices(points)
    np.testing.assert_allclose(price, [2e-9, 5e-8, 1e-3], rtol=1e-6)
    points[0]["seconds"] *= 1.5
    assert growth.departure(points[0], price) == pytest.approx(0.5)


def test_only_what_stands_between_the_markers_is_replaced():
    page = "before\n<!-- rows: made by a command -->\nold\n<!-- end of rows -->\nafter\n"
    assert documents.replaced(page, "rows", r"new \1") == page.replace("\nold\n", "\n\nnew \\1\n\n")
    with pytest.raises(ValueError, match="no markers for growth"):
        documents.replaced(page, "growth", "new")


@pytest.mark.parametrize(
    ("page", "names"),
    [
        (documents.PAGE, ["run", "stages", "growth", *(f"the rows of {part}" for part in documents.WITH_ROWS)]),
        (ACCURACY, ["geometry", "alpha", "normals", "tumors"]),
    ],
    ids=lambda value: value.name if isinstance(value, Path) else "",
)
def test_the_pages_have_the_markers(page, names):
    text = page.read_text(encoding="utf-8")
    for name in names:
        assert documents.replaced(text, name, "new") != text


def test_a_whole_process_gives_the_triangles_it_wrote(tmp_path):
    z, y, x = np.ogrid[-9:10, -9:10, -9:10]
    values = (64 - z * z - y * y - x * x).astype(np.int16)
    source = processes.written(tmp_path / "ball.nii", values, np.eye(4))
    out = tmp_path / "ball.stl"
    assert processes.reconstruct(source, out, ["--threshold", "0.5"]) == len(marching_cubes(values, 0.5).faces)
    assert out.stat().st_size == 84 + 50 * len(marching_cubes(values, 0.5).faces)


def test_mask_folders_are_the_largest_organs_and_read_as_one_label_volume(tmp_path):
    labels = np.zeros((3, 6, 12), np.uint8)
    for label in range(1, 11):
        labels[1, 1 : 2 + label // 3, label] = label  # of 1 to 4 voxels
    organs = processes.written(tmp_path / "organs.nii", labels, np.eye(4))
    volume = read_volume(reading.mask_folders(organs, tmp_path / "masks"))
    voxels = {name: np.count_nonzero(volume.values == label) for label, name in volume.label_names.items()}
    assert voxels == {f"organ_{label}": reading.WIDER**2 * (1 + label // 3) for label in range(3, 11)}


def test_slicers_recipe_closes_a_label_and_decimates_it(tmp_path):
    pytest.importorskip("vtkmodules", reason="VTK is a peer of the benchmark, not of the tests")
    label = np.zeros((12, 20, 20), np.uint8)
    label[:, 4:16, 4:16] = 1  # up to both ends: Slicer closes it there
    source = processes.written(tmp_path / "label.nii", label, np.eye(4))
    full = processes.recipe(source, tmp_path / "out.stl", ["--label", "1"])
    assert full == len(marching_cubes(label, 0.5, close_border=True).faces)
    assert processes.recipe(source, tmp_path / "out.stl", ["--label", "1", "--decimate", "0.5"]) < 0.6 * full


def test_blenders_mesher_places_a_ball_where_it_is():
    pytest.importorskip("bpy")
    z, y, x = np.ogrid[-9:10, -9:10, -9:10]
    values = (8 - np.sqrt(z * z + y * y + x * x)).astype(np.float32)
    mesher = peers.openvdb(values, 0.5)
    if mesher is None:
        pytest.skip("this Blender has no OpenVDB module")
    points, _triangles, quads = mesher()
    assert len(quads) > 500
    np.testing.assert_allclose(np.linalg.norm(points - 9, axis=1), 7.5, atol=0.35)


def test_every_part_can_be_loaded_and_has_its_title():
    assert {patient.__name__, processes.__name__} <= {f"benchmarks.{part}" for part in PARTS}
    assert set(documents.WITH_ROWS) <= set(PARTS)
