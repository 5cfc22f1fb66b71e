# SPDX-License-Identifier: GPL-3.0-or-later
"""Every measure appears in every place that it names, with its value and its text."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace

import nibabel
import numpy as np
import pytest
from batches import page_content

from ctmc_addon.core import (
    MEASURES,
    PRINT_MEASURES,
    FinishedSurface,
    Place,
    ReconstructionSettings,
    StructureRow,
    Volume,
    measure,
    measures_in,
    printed_of,
    reconstruct,
    table_cells,
    table_csv,
)
from ctmc_addon.core.mesh import Measures, OneWayDistance, SurfaceDistance, TriangleQuality
from ctmc_addon.core.solid import PrintFacts, SolidRequest
from ctmc_addon.core.volume import InsideValues, ValueKind
from ctmc_addon.core.volume.statistics.sampled_inside import SampledValues

PRINTING = PrintFacts(
    *((90.0, 80.0, 40.5), 12.5, 99.0, 1.234, 0.125, 1, 0, 78.91, 0.25), least_wall_mm=1.5, bed_mm=(60.0, 220.0, 250.0),
    fits_bed=False, cuts=("--cut 45 40 20.25 1 0 0",),
)  # fmt: skip
FULL = FinishedSurface(
    measures=Measures(
        8, 2.5, 1.5, True, 2, 1, vertices=6, quality=TriangleQuality(9.0, 0.0, 0.25, 1.5), size=(3, 2, 1)
    ),
    full_faces=20,
    removed_components=1,
    collapsed_components={"count": 2, "mm3": 0.5},
    self_intersections=0,
    distance=SurfaceDistance(OneWayDistance(0.1, 0.2, 0.3)),
    largest_diameter_mm=3.5,
    inside=InsideValues(10, 40.0, 2.0),
    printing=PRINTING,
)

SAMPLED = {
    ValueKind.DOSE: SampledValues(ValueKind.DOSE, 10, 0, 40.0, 2.0, 50.0, d95=30.0, percent_at={20.0: 75.0}),
    ValueKind.SUV: SampledValues(ValueKind.SUV, 10, 0, 4.0, 2.0, 9.0, peak=6.0),
}

PRINT_TEXTS = {
    "thinnest wall": "1.23 mm",
    "below least wall": "12.5 %",
    "largest overhang": "78.9°",
    "overhang above 45°": "25 %",
    "fits the bed": "no",
}


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A CT with two labels on its grid, named as LiTS names them; voxels of 0.5 x 0.5 x 1 mm."""
    folder = tmp_path_factory.mktemp("case")
    labels = np.zeros((12, 20, 24), np.uint8)
    labels[3:9, 4:14, 4:16], labels[8:11, 14:18, 17:22] = 1, 2
    values = np.where(labels, 40 + np.arange(24), -500).astype(np.int16)
    for name, array in (("volume-3", values), ("segmentation-3", labels)):
        nibabel.save(nibabel.Nifti1Image(array.T, np.diag([0.5, 0.5, 1.0, 1.0])), folder / f"{name}.nii")
    return folder


def reports(ctmc, case, folder, *words):
    path = folder / "report.json"
    done = ctmc("reconstruct", case / "segmentation-3.nii", *words, "--report", path)
    assert done.code == 0, done.errors
    report = json.loads(path.read_text("utf-8"))
    return done, report.get("surfaces", [report])


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_each_name_and_column_belongs_to_one_measure_and_each_is_found_on_a_finished_surface():
    every = (*MEASURES, *PRINT_MEASURES)
    names = [each.name for each in every]
    columns = [column for each in every for column in each.cells(None)]
    assert len(set(names)) == len(names)
    assert len(set(columns)) == len(columns)
    for each in every:
        assert each.where, each.name
        assert each.summed in ("sum", "all", "none"), each.name
        value = each.value(FULL if each.kind is None else replace(FULL, inside=SAMPLED[each.kind]))
        assert value is not None, each.name
        assert json.loads(json.dumps(value)) == value
        assert None not in each.cells(value).values(), each.name
        assert each.text(value) != each.text(None) == "-", each.name
        assert each.value(FinishedSurface()) is None
        assert set(each.cells(None).values()) == {None}, each.name


def test_reports_and_the_terminal_have_each_of_their_measures(ctmc, case, tmp_path):
    done, [report] = reports(ctmc, case, tmp_path, "--label", "1", "--smoothing", "none", "-o", tmp_path / "a.stl")
    lines = [re.split(r" {2,}", line) for line in done.out.splitlines()]
    for each in measures_in(Place.REPORT):
        assert report[each.name] is not None, each.name
    for each in measures_in(Place.TERMINAL):
        assert [each.head, each.text(report[each.name])] in lines, each.name
    # A box of 12 x 10 x 6 voxels, whose corners are cut.
    assert report["size_mm"] == pytest.approx([6.0, 5.0, 6.0], abs=1e-5)
    assert ["size", "6 x 5 x 6 mm"] in lines


def test_the_table_of_several_surfaces_has_each_of_its_measures(ctmc, case, tmp_path):
    done, surfaces = reports(ctmc, case, tmp_path, "--label", "all", "-o", f"{tmp_path / 'out'}/")
    lines = [re.split(r" {2,}", line.strip()) for line in done.out.splitlines()]
    shown = measures_in(Place.SURFACES)
    assert ["label", "name", *(each.head for each in shown)] in lines
    for surface in surfaces:
        texts = [each.text(surface[each.name]) for each in shown]
        assert [str(surface["label"]), surface["name"], *texts] in lines


def test_the_table_of_structures_has_each_of_its_measures(ctmc, case, tmp_path):
    words = ("--ct", case / "volume-3.nii", "--label", "all", "-o", tmp_path / "table.csv")
    done = ctmc("measure", case / "segmentation-3.nii", *words)
    assert done.code == 0, done.errors
    _, surfaces = reports(ctmc, case, tmp_path, "--label", "all", "-o", f"{tmp_path / 'out'}/")
    rows = rows_of(tmp_path / "table.csv")
    assert len(rows) == len(surfaces) == 2
    heads = ["name", "label", "threshold HU", *(each.head for each in measures_in(Place.TABLE))]
    lines = [re.split(r" {2,}", line.strip()) for line in done.out.splitlines()]
    assert heads in lines
    for each in measures_in(Place.TABLE):
        for row, surface in zip(rows, surfaces, strict=True):
            if each.name in surface:
                [shown] = [dict(zip(heads, line, strict=False)) for line in lines if line[0] == row["name"]]
                assert shown[each.head] == each.text(surface[each.name])
            for column, value in each.table_cells(surface.get(each.name)).items():
                assert row[column], column
                assert value is None or float(row[column]) == pytest.approx(value, rel=1e-8)


@pytest.fixture(scope="module")
def batch(case, tmp_path_factory):
    """A batch of a row with two labels, and one with a row for a label alone, with HU."""
    from ctmc_addon.cli import main

    folders = {}
    for name, words in (("several", ["--label", "all"]), ("one", ["--label", "1"])):
        folders[name] = tmp_path_factory.mktemp(name)
        flags = ["--hu", "--no-thumbnails", "--quiet"]
        assert main(["batch", str(case / "volume-3.nii"), "-o", str(folders[name]), *words, *flags]) == 0
    return folders


def test_a_batch_has_each_of_its_measures_in_its_tables(batch):
    for folder in batch.values():
        [row], [plain] = rows_of(folder / "summary.csv"), json.loads((folder / "summary.json").read_text("utf-8"))
        record = json.loads((folder / f"{row['case']}.json").read_text("utf-8"))
        surfaces = record.get("surfaces", [record])
        for each in measures_in(Place.BATCH):
            values = [surface[each.name] for surface in surfaces]
            together = values[0]
            if len(values) > 1:
                combine = {"sum": added, "all": all, "none": lambda _: None}[each.summed]
                together = combine(values)
            for column, value in each.cells(together).items():
                assert plain[column] == value, column
                assert row[column] == ("" if value is None else str(value)), column


def added(values):
    first, second = values
    return {part: first[part] + second[part] for part in first} if isinstance(first, dict) else first + second


def test_a_batch_has_each_of_its_measures_of_labels(batch):
    folder = batch["several"]
    rows, [plain] = rows_of(folder / "labels.csv"), json.loads((folder / "summary.json").read_text("utf-8"))
    surfaces = json.loads((folder / f"{plain['case']}.json").read_text("utf-8"))["surfaces"]
    page = page_content((folder / "summary.html").read_text("utf-8"))
    assert page["surface_heads"] == [each.head for each in measures_in(Place.LABELS)]
    for at, each in enumerate(measures_in(Place.LABELS)):
        for shown, row, of_label, surface in zip(
            page["rows"][0]["surfaces"], rows, plain["surfaces"], surfaces, strict=True
        ):
            assert shown["texts"][at] == each.text(surface[each.name]), each.name
            for column, value in each.cells(surface[each.name]).items():
                assert value is not None, column
                assert row[column] == str(value), column
                assert of_label[column] == value, column


def test_a_batch_has_each_of_its_measures_on_its_page(batch):
    folder = batch["one"]
    [plain] = json.loads((folder / "summary.json").read_text("utf-8"))
    record = json.loads((folder / f"{plain['case']}.json").read_text("utf-8"))
    page = page_content((folder / "summary.html").read_text("utf-8"))
    [shown] = page["rows"]
    assert plain.items() <= shown.items()
    for about, text, each in zip(page["measures"], shown["texts"], measures_in(Place.PAGE), strict=True):
        assert (about["head"], text) == (each.head, each.text(record[each.name]))
        assert {name: shown[name] for name in about["columns"]} == each.cells(record[each.name])
    totals = {name: facts for name, *facts in page["cohorts"][0]["totals"]}
    for each in measures_in(Place.TOTALS):
        assert totals[each.head] == ["1", *[each.text(record[each.name])] * 4], each.name


def test_a_batch_has_each_of_its_measures_on_the_terminal(ctmc, case, tmp_path):
    done = ctmc("batch", case / "volume-3.nii", "-o", tmp_path, "--label", 1, "--no-thumbnails")
    record = json.loads((tmp_path / "volume-3.json").read_text("utf-8"))
    shown = measures_in(Place.LINE)
    assert ["case", "status", *(each.head for each in shown), "seconds"] in [
        re.split(r" {2,}", line.strip()) for line in done.out.splitlines()
    ]
    assert "  ".join(["done", "volume-3", *(each.text(record[each.name]) for each in shown)]) in done.out


@pytest.mark.parametrize(
    ("record", "expected"),
    [
        # 0.2 has the components as parts, and neither quality nor collapsed components.
        ({"parts": 3, "volume_mm3": 5.0, "area_mm2": 9.0}, {"volume_mm3": 5.0, "components": None}),
        (
            {"components": 3, "volume_mm3": 5.0, "collapsed_components": {"count": 2, "mm3": 0.5}},
            {"components": 3, "collapsed_components": 2, "collapsed_mm3": 0.5, "size_x_mm": None, "size_z_mm": None},
        ),
    ],
)
def test_records_of_older_versions_are_read_and_what_they_lack_is_empty(record, expected):
    from ctmc_addon.cli.batch.summary import SummaryRow

    row = SummaryRow("a")
    row.fill({"status": "done", "faces": 10, "seconds": 1.0, "error": None, **record})
    columns = row.columns()
    assert {name: columns[name] for name in expected} == expected
    assert row.text(measure("size_mm")) == ""


def ball():
    z, y, x = np.ogrid[-8:9, -8:9, -8:9]
    return Volume((6.0 - np.sqrt(x * x + y * y + z * z)).astype(np.float32), np.eye(4))


def test_the_terminal_shows_the_facts_for_print_of_a_part_and_nothing_that_was_not_asked_for():
    from ctmc_addon.cli.commands.reconstruct import summary

    volume = ball()
    result = reconstruct(volume, ReconstructionSettings(threshold=0.0))
    part = replace(result, printing=PRINTING)

    def lines(of):
        return dict(line.split("  ", 1) for line in summary(of, volume, []).splitlines() if "  " in line)

    shown = {head: text.strip() for head, text in lines(part).items()}
    assert PRINT_TEXTS.items() <= shown.items()
    assert not PRINT_TEXTS.keys() & lines(result).keys()
    unasked = replace(part, printing=replace(PRINTING, below_least_wall=None, fits_bed=None))
    assert lines(part).keys() - lines(unasked).keys() == {"below least wall", "fits the bed"}


def test_the_notes_of_several_parts_name_those_that_do_not_fit():
    from ctmc_addon.cli.surfaces import Surfaces

    result = reconstruct(ball(), ReconstructionSettings(threshold=0.0))
    result = replace(result, solid=SolidRequest(bed=PRINTING.bed_mm))
    part = replace(result, printing=PRINTING, notes=(*result.notes, *PRINTING.notes))
    fitting = replace(result, printing=replace(PRINTING, fits_bed=True, cuts=()))
    told = "The part does not fit the bed of 60 x 220 x 250 mm; cut it with --cut 45 40 20.25 1 0 0"
    assert Surfaces("hips", (part, fitting), ("hip a", "hip b")).notes == [*result.notes, f"hip a: {told}"]
    assert Surfaces("hips", (part, part), ("hip a", "hip b")).notes == [*result.notes, told]


def test_the_table_of_structures_has_the_facts_for_print_of_parts_alone():
    rows = [
        StructureRow(name, 1, None, FinishedSurface(printing=facts)) for name, facts in (("a", PRINTING), ("b", None))
    ]
    [head, first, second] = csv.reader(table_csv(rows).splitlines())
    facts = {"thinnest_wall_mm": "1.234", "below_least_wall": "0.125", "largest_overhang_deg": "78.91"}
    facts |= {"overhang_share": "0.25", "fits_bed": "False"}
    assert facts.items() <= dict(zip(head, first, strict=True)).items()
    assert {dict(zip(head, second, strict=True))[name] for name in facts} == {""}
    assert not facts.keys() & set(table_csv(rows[1:]).splitlines()[0].split(","))
    shown = dict(zip(*table_cells(rows)[:2], strict=True))
    assert PRINT_TEXTS.items() <= shown.items()


def test_a_batch_reads_the_facts_for_print_from_its_records():
    from ctmc_addon.cli.batch.summary import SummaryRow
    from ctmc_addon.cli.batch.summary.page import html_text

    done = {"status": "done", "seconds": 1.0, "error": None}
    parts = [PRINTING, replace(PRINTING, thinnest_wall_mm=2.0, fits_bed=True)]
    surfaces = [
        {"name": name, "label": 1, "faces": 10, "print": facts.report()}
        for name, facts in zip(("hip a", "hip b"), parts, strict=True)
    ]
    one, several, plain = SummaryRow("one"), SummaryRow("several"), SummaryRow("plain")
    one.fill({**done, "faces": 10, "print": PRINTING.report()})
    several.fill({**done, "surfaces": surfaces})
    plain.fill({**done, "faces": 10, "print": None})
    names = [each.name for each in PRINT_MEASURES]
    assert [one.columns()[name] for name in names] == [1.234, 0.125, 78.91, 0.25, False]
    assert [several.columns()[name] for name in names] == [None, None, None, None, False]
    assert [row["thinnest_wall_mm"] for row in several.label_rows()] == [1.234, 2.0]
    assert not set(names) & plain.columns().keys()
    page = page_content(html_text([one, several, plain], over=True))
    heads = [about["head"] for about in page["measures"]]
    assert dict(zip(heads, page["rows"][0]["texts"], strict=True)).items() >= PRINT_TEXTS.items()
    assert {dict(zip(heads, page["rows"][2]["texts"], strict=True))[head] for head in PRINT_TEXTS} == {""}
    assert (
        dict(zip(page["surface_heads"], page["rows"][1]["surfaces"][1]["texts"], strict=True))["fits the bed"] == "yes"
    )


def test_only_facts_that_are_known_are_shown():
    known = FinishedSurface(printing=replace(PRINTING, below_least_wall=None))
    assert printed_of([known, FinishedSurface()]) == {each.name for each in PRINT_MEASURES} - {"below_least_wall"}
    assert printed_of([FinishedSurface()]) == frozenset()
