# SPDX-License-Identifier: GPL-3.0-or-later
"""A specimen of 0.02 mm3 is said in its own units in every place, and files keep mm."""

from __future__ import annotations

import json
import re

import nibabel
import numpy as np
import pytest
from batches import page_content
from shapes import distance_mm

SIDE = 0.012  # mm of a voxel
RADIUS = 0.168  # mm: 0.0199 mm3
TOO_LARGE = re.compile(r"\bml\b|\bcm2\b|\b0(\.0+)? (mm|mm3)\b|e-\d\d mm")
"""A unit that is too large for it, or a number that is lost in its unit."""

pytestmark = pytest.mark.once


def grain(moved=0):
    """A ball, and eleven grains of a voxel around it."""
    values = 1000 * (RADIUS - distance_mm((34, 34, 34), (16.5 + moved, 16.5, 16.5), (SIDE,) * 3)) / SIDE
    for at in range(11):
        values[2, 2, 1 + 3 * at] = 500
    return np.rint(values).clip(-2000, 2000).astype(np.int16)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("specimen")
    affine = np.diag([SIDE, SIDE, SIDE, 1.0])
    nibabel.save(nibabel.Nifti1Image(grain(), affine), folder / "grain.nii")
    for name, moved in (("before", 0), ("after", 2)):
        nibabel.save(nibabel.Nifti1Image((grain(moved) >= 0).astype(np.uint8), affine), folder / f"{name}.nii")
    return folder


def said(done):
    assert done.code == 0, done.errors
    return done.out


def test_the_terminal_says_it_in_mm3_and_um_and_its_hint_works(ctmc, folder, tmp_path):
    words = ("reconstruct", folder / "grain.nii", "--threshold", "0", "-o", tmp_path / "a.ply")
    out = said(ctmc(*words, "--report", tmp_path / "a.json", "--simplify", "0.5", "--deviation"))
    assert not TOO_LARGE.search(out), out
    assert re.search(r"^volume +0\.0\d+ mm3$", out, re.MULTILINE)
    assert re.search(r"^deviation_mm +median [\d.]+ um, mean [\d.]+, ", out, re.MULTILINE)
    report = json.loads((tmp_path / "a.json").read_text("utf-8"))
    assert report["volume_mm3"] == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.02)
    assert report["components"] == 12
    [hint] = re.findall(r"11 of 12 components are smaller than .* um3; (--min-part \S+) removes them", out)
    assert "components    1\n" in said(ctmc(*words, *hint.split()))


def test_tables_of_structures_and_of_changes_say_it_so_and_files_keep_ml(ctmc, folder, tmp_path):
    words = ("--label", "1", "--thickness", "-o", tmp_path / "one.csv")
    out = said(ctmc("measure", folder / "before.nii", *words))
    assert not TOO_LARGE.search(out), out
    assert re.search(r"^name +label +threshold HU +volume +area ", out, re.MULTILINE)
    head, row = (tmp_path / "one.csv").read_text("utf-8").splitlines()
    assert float(dict(zip(head.split(","), row.split(","), strict=True))["volume_ml"]) == pytest.approx(2e-5, rel=0.02)
    changed = said(ctmc("measure", folder / "before.nii", folder / "after.nii", "--label", "1"))
    assert not TOO_LARGE.search(changed.replace("0 um", "")), changed
    assert re.search(r"^label 1 +1 +stable +1 +1 +0\.0\d+ mm3 +0\.0\d+ mm3 ", changed, re.MULTILINE)


def test_pages_of_batches_and_refusals_say_it_so(ctmc, folder, tmp_path):
    said(ctmc("batch", folder / "grain.nii", "-o", tmp_path / "out", "--threshold", "0", "--no-thumbnails"))
    content = page_content((tmp_path / "out" / "summary.html").read_text("utf-8"))
    assert not any(TOO_LARGE.search(text) for text in content["rows"][0]["texts"])
    assert any(re.fullmatch(r"0\.0\d+ mm3", text) for text in content["rows"][0]["texts"])
    refused = ctmc("reconstruct", folder / "grain.nii", "--threshold", "0", "--min-part", "1", "-o", tmp_path / "b.stl")
    assert "no component has a volume of 1 mm3 or more: the largest of 12 has 0.0" in refused.errors[-1]
