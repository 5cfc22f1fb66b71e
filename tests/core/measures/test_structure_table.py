# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of structures has the numbers of reports, and the gray values of the samples."""

import csv
import io

import numpy as np
import pytest

from ctmc_addon.core import (
    ReconstructionSettings,
    Volume,
    measure_structures,
    reconstruct,
    reconstruct_labels,
    table_csv,
)
from ctmc_addon.core.errors import VolumeError
from ctmc_addon.core.mesh import largest_diameter

AFFINE = np.diag([-0.8, 0.8, 2.5, 1.0])


def scan():
    """A CT and two labels on its grid, one of them at the border."""
    values = np.random.default_rng(1).integers(-200, 400, (12, 30, 40)).astype(np.int16)
    labels = np.zeros(values.shape, np.uint8)
    labels[3:9, 5:15, 5:20], labels[0:5, 18:26, 25:35] = 4, 9
    kinds = {"label_names": {4: "liver, left", 9: "rib"}, "kind": "label"}
    return Volume(values, AFFINE, kind="HU"), Volume(labels, AFFINE, **kinds)


def test_of_labels_it_has_the_numbers_of_the_report_and_of_their_voxels():
    ct, labels = scan()
    results = reconstruct_labels(labels, ReconstructionSettings()).surfaces
    rows = list(csv.DictReader(io.StringIO(table_csv(measure_structures(results, ct, labels), ct.kind))))
    assert [(row["name"], row["label"], row["threshold_hu"]) for row in rows] == [
        ("liver, left", "4", ""),
        ("rib", "9", ""),
    ]
    for row, result, label in zip(rows, results, (4, 9), strict=True):
        report, inside = result.report(), ct.values[labels.values == label].astype(float)
        assert float(row["area_cm2"]) == pytest.approx(report["area_mm2"] / 100, rel=1e-8)
        assert int(row["components"]) == report["components"]
        assert float(row["largest_diameter_mm"]) == pytest.approx(largest_diameter(result.mesh.vertices), rel=1e-8)
        assert float(row["mean_hu"]) == pytest.approx(inside.mean(), rel=1e-8)
        assert float(row["sd_hu"]) == pytest.approx(inside.std(), rel=1e-8)
    assert float(rows[0]["volume_ml"]) == pytest.approx(results[0].report()["volume_mm3"] / 1000, rel=1e-8)
    assert rows[1]["volume_ml"] == ""  # open at the border
    assert results[1].report()["volume_mm3"] is None


def test_of_a_threshold_it_has_the_values_that_this_takes_in_the_region():
    ct, _ = scan()
    settings = ReconstructionSettings(threshold=100.0, upper=300.0, region=(2, 3, 1, 30, 20, 9))
    row = measure_structures([reconstruct(ct, settings)], ct)[0]
    part = ct.values[1:10, 3:21, 2:31].astype(float)
    inside = part[(part >= 100) & (part <= 300)]
    assert (row.label, row.threshold) == (None, 100.0)
    assert row.surface.inside.mean == pytest.approx(inside.mean(), rel=1e-12)
    assert row.surface.inside.deviation == pytest.approx(inside.std(), rel=1e-12)


def test_without_a_ct_there_are_no_gray_values_and_another_grid_is_refused():
    ct, labels = scan()
    results = reconstruct_labels(labels, ReconstructionSettings(), [4]).surfaces
    row = measure_structures(results)[0]
    assert row.surface.inside is None
    moved = AFFINE.copy()
    moved[2, 3] += AFFINE[2, 2] / 2
    with pytest.raises(VolumeError, match="away from those of the CT"):
        measure_structures(results, Volume(ct.values, moved, kind="HU"), labels)
