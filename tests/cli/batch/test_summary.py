# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of a batch: columns, outliers, totals, histogram, and the page's script where there is a Chromium."""

from __future__ import annotations

import csv
import re
import shutil
import subprocess
import sys

import pytest
from batches import page_content

from ctmc_addon.cli.batch import command, process
from ctmc_addon.cli.batch.summary import SummaryRow, write_summary
from ctmc_addon.cli.batch.summary.outliers import mark_outliers
from ctmc_addon.cli.batch.summary.page import bins_of, histogram, html_text
from ctmc_addon.core.measures.measures import MEASURES, Place, measures_in


def row(case, volume_mm3=1e6, **more):
    names = {each.name for each in MEASURES}
    values = {"faces": 1000, "components": 1, "closed": True, "volume_mm3": volume_mm3}
    values |= {name: value for name, value in more.items() if name in names}
    given = {"status": "done", "seconds": 1.0, "label": 1} | {n: value for n, value in more.items() if n not in names}
    return SummaryRow(case, values=values, **given)


@pytest.fixture
def cohort():
    rows = [row(f"c{number}", 1e6 + 1e4 * number) for number in range(9)]
    rows.append(row("huge", 3e6))
    rows.append(row("crumbs", components=40))
    rows.append(row("open", None, closed=False, notes="The surface is open."))
    rows.append(row("crossed", self_intersections=3))
    rows.append(row("ragged", notes="Slices 3 to 5 are ragged."))
    rows.append(row("tumor", 500.0, label=2))
    rows.append(SummaryRow("none", "absent", error="label 2 is empty here"))
    rows.append(SummaryRow("broken", "failed", error="it is <broken>"))
    return rows


def test_outliers_are_marked_with_their_reason_and_each_label_by_itself(cohort):
    mark_outliers(cohort)
    reasons = {row.case: row.outlier for row in cohort if row.outlier}
    assert reasons.pop("huge").startswith("volume ")
    assert reasons == {
        "crumbs": "40 components, the median is 1",
        "open": "open",
        "crossed": "3 self-intersections",
        "ragged": "Slices 3 to 5 are ragged.",
    }


def test_a_volume_three_deviations_off_is_none_where_the_cohort_varies_as_much():
    rows = [row(f"c{number}", 1e6 * (1 + number)) for number in range(9)]
    mark_outliers(rows)
    assert not any(each.outlier for each in rows)
    # Median 5.5e6, median absolute deviation 2.5e6: three deviations are 11.1e6.
    rows.append(row("far", 17e6))
    mark_outliers(rows)
    assert [each.case for each in rows if each.outlier] == ["far"]


def test_few_cases_have_no_outliers_by_volume_or_notes():
    rows = [row("a"), row("b", 1e9), row("c", notes="A note.")]
    mark_outliers(rows)
    assert [each.outlier for each in rows] == ["", "", ""]


@pytest.mark.parametrize("count", [1, 2, 7, 100, 500])
def test_every_volume_is_in_a_bin(count):
    values = [1e6 + 7.3e3 * (number**2 % 61) for number in range(count)]
    start, width, heights = bins_of(values)
    assert sum(heights) == count
    assert start <= min(values)
    assert max(values) < start + width * len(heights) * (1 + 1e-9)
    assert heights[0]
    assert heights[-1]
    assert (histogram(values) or {}).get("heights", []) == (heights if count > 1 else [])


def test_the_page_has_a_row_for_every_case_and_totals_for_every_label(cohort):
    mark_outliers(cohort)
    page = html_text(cohort, True)
    content = page_content(page)
    rows = content["rows"]
    assert [row["case"] for row in rows] == [row.case for row in cohort]
    assert rows[1]["texts"][:2] == ["1000", "1010 ml"]
    assert rows[-1]["error"] == "it is <broken>"
    assert "<broken" not in page
    assert [each["label"] for each in content["cohorts"]] == [1, 2]
    # 9 volumes from 1000 to 1080 ml, one of 3000, and three of 1000: the middle one of 13.
    assert ["volume", "13", "15360 ml", "1030 ml", "1000 ml", "3000 ml"] in content["cohorts"][0]["totals"]
    assert content["cohorts"][1]["histogram"] is None
    assert "://" not in page
    assert "prefers-color-scheme: dark" in page
    assert "{{" not in page
    assert 'http-equiv="refresh"' not in page
    assert 'http-equiv="refresh"' in html_text(cohort, False)


def test_the_csv_has_every_column_with_its_unit(cohort, tmp_path):
    write_summary(tmp_path, cohort, True)
    with (tmp_path / "summary.csv").open(encoding="utf-8", newline="") as stream:
        table = list(csv.DictReader(stream))
    # Scripts read these; new measures follow.
    assert list(table[0])[:25] == [
        "case", "status", "faces", "volume_mm3", "seconds", "error", "label", "components", "closed", "area_mm2",
        "spacing_x_mm", "spacing_y_mm", "spacing_z_mm", "self_intersections", "removed_components",
        "collapsed_components",
        "collapsed_mm3", "mean_hu", "sd_hu", "memory_bytes", "notes", "outlier", "size_x_mm", "size_y_mm", "size_z_mm",
    ]  # fmt: skip
    assert [line["outlier"] for line in table if line["case"] == "crumbs"] == ["40 components, the median is 1"]


def test_the_table_of_labels_of_an_older_run_goes_and_no_other(tmp_path):
    several = row(
        "a", surfaces=[dict.fromkeys(each.name for each in measures_in(Place.LABELS)) | {"name": "liver", "label": 1}]
    )
    write_summary(tmp_path, [several], True)
    assert (tmp_path / "labels.csv").read_text("utf-8").startswith("case,label,name,faces,")
    write_summary(tmp_path, [row("a")], False)
    assert not (tmp_path / "labels.csv").exists()
    (tmp_path / "labels.csv").write_text("case,label,name,faces,volume_mm3,area_mm2,parts,closed\n")  # of 0.3
    write_summary(tmp_path, [row("a")], True)
    assert not (tmp_path / "labels.csv").exists()
    (tmp_path / "labels.csv").write_text("number,name\n1,liver\n")
    write_summary(tmp_path, [row("a")], True)
    assert (tmp_path / "labels.csv").exists()


def test_a_row_of_several_surfaces_sums_them():
    surface = {"name": "a", "label": 1, "faces": 10, "volume_mm3": 5.0, "area_mm2": 2.5, "components": 2}
    surface |= {"closed": True, "spacing_mm": [1.0, 1.0, 2.0]}
    record = {"status": "done", "faces": 20, "volume_mm3": None, "seconds": 1.0, "error": None}
    together = SummaryRow("a")
    together.fill(record | {"surfaces": [surface, surface | {"closed": False}]})
    columns = together.columns()
    assert (columns["components"], columns["area_mm2"], columns["closed"]) == (4, 5.0, False)
    assert (columns["spacing_z_mm"], columns["self_intersections"]) == (2.0, None)


@pytest.mark.parametrize(
    ("seconds", "share", "least", "most"), [(600.0, 1.0, 2, 2), (0.0, 1e-9, 2, 2), (0.0, 1e9, 4, 9)]
)
def test_the_summary_of_a_batch_that_runs_is_written_at_its_time_and_the_last_always(
    ctmc, tmp_path, monkeypatch, seconds, share, least, most
):
    for name in "abcd":
        (tmp_path / f"{name}.npy").touch()
    written = []

    def noted(folder, rows, over):
        written.append((over, {row.status for row in rows}))
        write_summary(folder, rows, over)

    monkeypatch.setattr(command, "SUMMARY_SECONDS", seconds)
    monkeypatch.setattr(command, "SUMMARY_SHARE", share)
    monkeypatch.setattr(command, "write_summary", noted)
    monkeypatch.setattr(process, "command", lambda: [sys.executable, "-c", ""])
    assert ctmc("batch", tmp_path, "-o", tmp_path / "out", "--jobs", "2").code == 1
    assert written[0] == (False, {"waiting"})
    assert written[-1] == (True, {"failed"})
    assert [over for over, _ in written].count(True) == 1
    assert least <= len(written) <= most


def test_the_script_sorts_filters_and_searches(cohort, tmp_path):
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("there is no Chromium")
    write_summary(tmp_path, cohort, True)

    command = [chromium, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    address = f"{(tmp_path / 'summary.html').as_uri()}#sort=8-&filter=outlier&search=cr"
    made = subprocess.run([*command, "--dump-dom", address], capture_output=True, text=True, timeout=60, check=True)
    head, _, body = made.stdout.partition('<table id="cases">')[2].partition("<tbody>")
    rows = re.findall(r'<tr class="[^"]*"( hidden="")?><td></td><td>([^<]*)<', body)
    assert len(rows) == len(cohort) - 1
    assert [name for hidden, name in rows if not hidden] == ["crossed", "crumbs"]
    assert re.search(r'<th[^>]*aria-sort="descending"[^>]*>self-intersections', head)
    assert "2 of 16" in made.stdout
    assert "1 absent: without the label" in made.stdout
