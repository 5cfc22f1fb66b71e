# SPDX-License-Identifier: GPL-3.0-or-later
"""The cost estimate: counts are exact, memory and remedy hold, values are prepared once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from volumes import in_file

from ctmc_addon.core import Budget, ReconstructionSettings, Volume, finish, reconstruct
from ctmc_addon.core.errors import MeshError, ThresholdError
from ctmc_addon.core.planning import cost_estimate
from ctmc_addon.core.planning.cost_estimate import FieldCache, cost_estimate_steps
from ctmc_addon.core.planning.plan import FACE_BYTES


@pytest.fixture(scope="module")
def volume():
    """Waves and noise, -1000 to 1000."""
    z, y, x = np.ogrid[:30, :40, :50]
    waves = 600 * (np.sin(x / 3) + np.sin(y / 4) + np.sin(z / 2)) / 3
    noise = np.random.default_rng(1).normal(0, 60, waves.shape)
    return Volume((waves + noise).astype(np.int16), np.diag([0.7, 0.7, 2.0, 1.0]), kind="HU")


@pytest.mark.parametrize(
    "settings",
    [
        {"threshold": 100.0},
        {"threshold": 100.0, "stride": (2, 3, 1), "close_border": True},
        {"threshold": 50.0, "smoothing_mm": 1.0, "reduction": 0.5},
        {"region": (5.0, 5.0, 5.0, 30.0, 30.0, 20.0), "topology": "trilinear"},
    ],
)
def test_voxels_vertices_and_triangles_are_exact(volume, settings):
    chosen = ReconstructionSettings(**settings)
    found = finish(cost_estimate_steps(FieldCache(volume), chosen))
    real = reconstruct(volume, chosen)
    assert found.faces == real.full_faces
    assert found.voxels == real.voxels_visited
    if real.surface is not None:
        assert found.vertices == len(real.surface.midpoints)


def test_values_are_prepared_again_only_when_something_matters_to_them(volume, monkeypatch):
    made = []
    plain = cost_estimate.field_steps
    monkeypatch.setattr(cost_estimate, "field_steps", lambda *args: made.append(1) or plain(*args))
    cache = FieldCache(volume)
    for settings in (
        {"threshold": 100.0, "smoothing_mm": 1.0},
        {"threshold": 150.0, "smoothing_mm": 1.0, "stride": (2, 2, 2), "alpha": 0.5, "reduction": 0.5},
    ):
        finish(cost_estimate_steps(cache, ReconstructionSettings(**settings)))
    assert len(made) == 1
    finish(cost_estimate_steps(cache, ReconstructionSettings(threshold=150.0, smoothing_mm=2.0)))
    assert len(made) == 2


def test_a_threshold_without_a_surface_is_refused_after_another_one(volume):
    cache = FieldCache(volume)
    assert finish(cost_estimate_steps(cache, ReconstructionSettings(threshold=100.0))).faces > 0
    with pytest.raises(ThresholdError, match="5000"):
        finish(cost_estimate_steps(cache, ReconstructionSettings(threshold=5000.0)))


def test_what_is_smoothed_a_slab_at_a_time_is_counted_so_too():
    square = [np.square(np.arange(48) - 23.5) for _ in range(3)]
    ball = Volume(-np.add.outer(np.add.outer(*square[:2]), square[2]).astype(np.float32), np.eye(4))
    settings = ReconstructionSettings(threshold=-144.0, smoothing_mm=1.0, stride=(2, 1, 1))
    real = reconstruct(ball, settings)
    limit = 4 * real.full_faces * FACE_BYTES // 3
    assert limit < 9 * ball.values.size
    most = Budget(bytes=limit, slab_bytes=1, work_bytes=0)
    little = replace(most, bytes=limit // 3)
    cache = FieldCache(in_file(ball), most)
    found = finish(cost_estimate_steps(cache, settings))
    assert not cache.field.values.held
    assert (found.faces, found.vertices) == (real.full_faces, len(real.mesh.vertices))
    assert found.voxels == real.voxels_visited
    assert found.fits
    fetched = reconstruct(in_file(ball), settings, most)
    assert fetched.mesh.vertices.tobytes() == real.mesh.vertices.tobytes()
    assert fetched.mesh.faces.tobytes() == real.mesh.faces.tobytes()
    found = finish(cost_estimate_steps(FieldCache(ball, little), settings))
    assert "stride 3 2 2 would fit" in found.sentence
    wider = ReconstructionSettings(threshold=-144.0, smoothing_mm=1.0, stride=(3, 2, 2))
    assert finish(cost_estimate_steps(FieldCache(ball, little), wider)).fits
    nothing = ReconstructionSettings(threshold=-5.0, smoothing_mm=1.0, stride=(9, 9, 9))
    with pytest.raises(MeshError, match="threshold -5 separates no samples of this grid; use a smaller stride"):
        finish(cost_estimate_steps(FieldCache(ball, most), nothing))


def test_what_does_not_fit_is_said_with_a_stride_that_does(volume):
    settings = ReconstructionSettings(threshold=100.0)
    full = finish(cost_estimate_steps(FieldCache(volume, Budget(work_bytes=0)), settings))
    assert full.fits or full.available is not None
    found = finish(cost_estimate_steps(FieldCache(volume, Budget(bytes=full.memory // 2, work_bytes=0)), settings))
    assert not found.fits
    assert "GiB are available; stride" in found.sentence
    assert "would fit" in found.sentence
    words = found.remedy.split()
    wider = ReconstructionSettings(threshold=100.0, stride=tuple(int(word) for word in words[1:4]))
    assert finish(cost_estimate_steps(FieldCache(volume, Budget(bytes=full.memory // 2, work_bytes=0)), wider)).fits


def test_where_no_stride_fits_a_region_is_advised(volume):
    found = finish(cost_estimate_steps(FieldCache(volume, Budget(bytes=1)), ReconstructionSettings(threshold=100.0)))
    assert found.remedy == "choose a smaller region"
