"""Measures taken in steps are those the mesh gives at once; the survey of a volume."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ctmc_addon.core import Volume, marching_cubes
from ctmc_addon.core.mesh import measures
from ctmc_addon.core.progress import finish
from ctmc_addon.core.volume.statistics import survey_steps
from ctmc_addon.core.volume.thresholding import otsu


@pytest.fixture(params=[1 << 18, 50])
def block(request, monkeypatch):
    """Faces at once: all of them, and few."""
    monkeypatch.setattr(measures, "FACES_AT_ONCE", request.param)
    monkeypatch.setattr(measures._blocks, "__defaults__", (request.param,))


@pytest.mark.parametrize("close", [True, False])
def test_measures_in_steps_are_the_meshs_own(block, close):
    values = np.random.default_rng(3).integers(0, 100, (9, 10, 11)).astype(np.uint8)
    mesh = marching_cubes(values, 60.5, close_border=close)
    found = finish(measures.measures_steps(mesh))
    assert found.area == pytest.approx(mesh.area)
    assert found.closed == mesh.closed == close
    assert (found.faces, found.euler, found.parts) == (len(mesh.faces), mesh.euler, mesh.parts)
    if close:
        assert found.volume == pytest.approx(mesh.volume)


def test_a_mesh_with_one_triangle_turned_over_is_not_closed(block):
    mesh = marching_cubes(np.pad(np.ones((2, 2, 2), np.uint8), 2), 0.5)
    faces = mesh.faces.copy()
    faces[0] = faces[0, ::-1]
    assert finish(measures.measures_steps(mesh)).closed
    assert not finish(measures.measures_steps(replace(mesh, faces=faces))).closed


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32])
def test_a_survey_has_range_otsu_and_labels(dtype):
    values = np.zeros((4, 5, 6), dtype)
    values[1, 1], values[2, 2, :3], values[3, 3, 3] = 2, 7, 100
    seen = finish(survey_steps(Volume(values, np.eye(4), kind="label")))
    assert (seen.low, seen.high) == pytest.approx((0, 100))
    assert seen.labels == ((2, 6), (7, 3), (100, 1))
    assert seen.otsu == otsu(values)
    assert seen.heights(50)[[0, 1, 3, 49]] == pytest.approx(np.log1p([110, 6, 3, 1]) / np.log1p(110))


def test_a_fingerprint_changes_with_a_voxel_and_with_the_place():
    values = np.arange(27, dtype=np.int16).reshape(3, 3, 3)
    other = values.copy()
    other[0, 0, 0] = 5
    marks = [
        finish(survey_steps(Volume(*made))).fingerprint
        for made in ((values, np.eye(4)), (values, np.diag([1, 1, 2.0, 1])), (other, np.eye(4)))
    ]
    assert len(set(marks)) == 3
    assert finish(survey_steps(Volume(values.copy(), np.eye(4)))).fingerprint == marks[0]


def test_a_volume_with_no_finite_value_is_surveyed():
    seen = finish(survey_steps(Volume(np.full((2, 2, 2), np.nan), np.eye(4))))
    assert (seen.broken, seen.otsu, seen.histogram) == (8, None, None)
    assert not seen.heights(4).any()
