# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures of pieces are those of the whole surface."""

from dataclasses import astuple

import numpy as np
import pytest

from ctmc_addon.core import ReconstructionSettings, reconstruct
from ctmc_addon.core.mesh.completed_pieces import completed_pieces_steps
from ctmc_addon.core.progress import Step, finish
from ctmc_addon.core.streaming import parts, surface_pieces_steps
from ctmc_addon.core.streaming.piece_measures import PieceMeasures
from ctmc_addon.core.volume import SlabVolume, Volume


def measured(pieces):
    measures = PieceMeasures()
    for item in completed_pieces_steps(pieces):
        if not isinstance(item, Step):
            finish(measures.add_steps(item))
    return measures


def noise(shape=(40, 30, 26)):
    """Many components, cavities and open borders, far from the origin."""
    values = np.random.default_rng(3).integers(0, 100, shape).astype(np.uint8)
    affine = np.diag([0.7, 0.8, 1.3, 1.0])
    affine[:3, 3] = 900, -700, 1200
    return Volume(values, affine)


@pytest.mark.parametrize("threshold", [50.0, 80.0, 95.0])
@pytest.mark.parametrize("more", [{}, {"close_border": True}, {"keep_parts": 3}, {"topology": "trilinear"}])
def test_measures_of_pieces_are_those_of_the_whole(threshold, more, monkeypatch):
    monkeypatch.setattr(parts, "SLAB_BYTES", 3000)
    volume, settings = noise(), ReconstructionSettings(threshold=threshold, **more)
    whole = reconstruct(volume, settings).mesh
    pieces = measured(surface_pieces_steps(SlabVolume.of(volume), settings, memory_limit=1 << 10, any_order=True))
    expected, found = whole.measures, finish(pieces.measures_steps())
    assert astuple(found)[3:] == astuple(expected)[3:]
    assert found.faces == expected.faces
    assert found.area == pytest.approx(expected.area, rel=1e-10)
    assert found.volume == pytest.approx(expected.volume, rel=1e-9, nan_ok=True)
    assert expected.closed or not more.get("close_border")


def test_a_sample_of_the_vertices_is_even_along_the_surface(monkeypatch):
    monkeypatch.setattr(parts, "SLAB_BYTES", 3000)
    monkeypatch.setattr("ctmc_addon.core.streaming.piece_measures.MOST_SAMPLED", 1000)
    volume, settings = noise(), ReconstructionSettings(threshold=50.0)
    pieces = measured(surface_pieces_steps(SlabVolume.of(volume), settings, memory_limit=1 << 10))
    vertices = reconstruct(volume, settings).mesh.vertices
    every = 1 << int(np.ceil(np.log2(len(vertices) / 1000)))
    assert every > 1
    np.testing.assert_array_equal(pieces.sample, vertices[::every])
