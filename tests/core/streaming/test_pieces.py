# SPDX-License-Identifier: GPL-3.0-or-later
"""The pieces of a surface, one after the other, are the mesh of the volume in memory."""

import weakref

import numpy as np
import pytest
from core.streaming.test_surface import AFFINE, REGION, fetched, waves

from ctmc_addon.core import (
    STREAMED_NOTE,
    MemoryLimitError,
    ReconstructionSettings,
    Volume,
    finish,
    pipeline,
    reconstruct,
    result_and_full_steps,
)
from ctmc_addon.core.mesh.triangle_mesh import SurfacePiece
from ctmc_addon.core.pipeline import reconstruct_steps
from ctmc_addon.core.simplification.simplify import memory_needed
from ctmc_addon.core.simplification.streaming import reduce_pieces
from ctmc_addon.core.streaming import surface_pieces_steps
from ctmc_addon.core.volume import SlabVolume

__all__ = ["fetched"]


def pieces_of(volume, settings, **options):
    steps = surface_pieces_steps(volume, settings, 2, **options)
    pieces = []
    while True:
        try:
            item = next(steps)
        except StopIteration as end:
            return pieces, end.value
        if isinstance(item, SurfacePiece):
            pieces.append(item)


def concatenated(pieces):
    first = np.cumsum([0] + [len(piece.vertices) for piece in pieces])
    faces = np.concatenate([piece.faces + np.int32(start) for piece, start in zip(pieces, first, strict=False)])
    normals = None if pieces[0].normals is None else np.concatenate([piece.normals for piece in pieces])
    return np.concatenate([piece.vertices for piece in pieces]), faces, normals


SETTINGS = [
    {},
    {"alpha": 0.3, "close_border": True},
    {"stride": (2, 3, 1)},
    {"stride": (1, 1, 4), "normals": "mesh"},
    {"stride": (3, 2, 4), "close_border": True},
    {"topology": "trilinear", "close_border": True},
    {"smoothing": "gaussian", "smoothing_mm": 1.1},
    {"region": REGION, "close_border": True},
    {"threshold": None},
]


@pytest.mark.parametrize("slab_bytes", [1, 7 * 2 * 21 * 70])
@pytest.mark.parametrize("extra", SETTINGS)
@pytest.mark.parametrize("in_memory", [False, True])
def test_all_pieces_are_the_mesh_in_memory(fetched, slab_bytes, extra, in_memory):
    fetched(slab_bytes)
    settings = ReconstructionSettings(**({"threshold": 120.0} | extra))
    volume = Volume(waves(), AFFINE)
    expected = reconstruct(volume, settings, threads=2)
    pieces, facts = pieces_of(volume if in_memory else SlabVolume.of(volume), settings)
    vertices, faces, normals = concatenated(pieces)
    assert len(pieces) > 4 or settings.stride != (1, 1, 1)
    assert vertices.tobytes() == expected.mesh.vertices.tobytes()
    assert faces.tobytes() == expected.mesh.faces.tobytes()
    if settings.normals == "gradient":
        assert normals.tobytes() == expected.mesh.normals.tobytes()
    assert (facts.threshold, facts.notes) == (expected.threshold, expected.notes)


@pytest.mark.parametrize("smoothing", ["none", "gaussian", "constrained"])
def test_pieces_of_a_label_are_the_mesh_in_memory(fetched, smoothing):
    fetched(3000)
    settings = ReconstructionSettings(label=1, smoothing=smoothing)
    volume = Volume(np.digitize(waves(), [120, 300]).astype(np.uint8), AFFINE, kind="label")
    expected = reconstruct(volume, settings, threads=2)
    pieces, facts = pieces_of(SlabVolume.of(volume), settings)
    vertices, faces, _ = concatenated(pieces)
    assert vertices.tobytes() == expected.mesh.vertices.tobytes()
    assert faces.tobytes() == expected.mesh.faces.tobytes()
    assert (facts.wrong_side, facts.slice_steps) == (expected.wrong_side, expected.slice_steps)


def test_pieces_in_any_order_have_the_same_triangles(fetched):
    fetched(3 * 2 * 21 * 70)
    volume, settings = Volume(waves(), AFFINE), ReconstructionSettings(threshold=120, close_border=True)
    mesh = reconstruct(volume, settings, threads=2).mesh
    vertices, faces, _ = concatenated(pieces_of(SlabVolume.of(volume), settings, any_order=True)[0])
    ours, theirs = (
        sorted(tuple(sorted(map(tuple, triangle))) for triangle in points[corners].tolist())
        for points, corners in ((vertices, faces), (mesh.vertices, mesh.faces))
    )
    assert ours == theirs


def test_a_full_surface_is_gone_before_it_is_simplified_as_it_is_extracted(fetched, monkeypatch):
    fetched(5 * 2 * 21 * 70)
    settings = ReconstructionSettings(threshold=120.0, reduction=0.9)
    volume = Volume(waves()[:, :, :16], AFFINE)
    whole, full = finish(result_and_full_steps(volume, settings, 2))
    assert (len(full.mesh.faces), full.surface is not None) == (whole.full_faces, True)
    limit = memory_needed(whole.full_faces, None) - 1
    monkeypatch.setattr(reduce_pieces, "BATCH_FACES", 1000)
    held = []

    def full_steps(*given):
        made = yield from full_surface_steps(*given)
        held.append(weakref.ref(made))
        return made

    def streamed_steps(*given):
        assert [one() for one in held] == [None]
        return (yield from streaming_steps(*given))

    full_surface_steps, streaming_steps = pipeline._full_steps, pipeline._streamed_steps
    monkeypatch.setattr(pipeline, "_full_steps", full_steps)
    monkeypatch.setattr(pipeline, "_streamed_steps", streamed_steps)
    result, full = finish(result_and_full_steps(volume, settings, 2, limit))
    assert full is None
    assert STREAMED_NOTE in result.notes
    assert STREAMED_NOTE not in whole.notes
    assert len(result.mesh.faces) == len(whole.mesh.faces)
    fetched_too = finish(reconstruct_steps(SlabVolume.of(volume), settings, 2, limit))
    assert result.mesh.vertices.tobytes() == fetched_too.mesh.vertices.tobytes()
    with pytest.raises(MemoryLimitError, match="triangles needs about"):
        finish(result_and_full_steps(volume, ReconstructionSettings(threshold=120.0), 2, 1000))


@pytest.mark.once
@pytest.mark.parametrize("stride", [(1, 1, 1), (2, 1, 3)])
def test_a_surface_simplified_while_it_is_extracted_is_the_same_without_normals(fetched, monkeypatch, stride):
    fetched(5 * 2 * 21 * 70)
    monkeypatch.setattr(reduce_pieces, "BATCH_FACES", 1500)
    settings = ReconstructionSettings(threshold=120.0, stride=stride, reduction=0.9, close_border=True)
    volume = SlabVolume.of(Volume(waves(), AFFINE))
    full, bare = (finish(reconstruct_steps(volume, settings, 2, normals=normals)).mesh for normals in (True, False))
    assert full.normals is not None
    assert bare.normals is None
    assert full.vertices.tobytes() == bare.vertices.tobytes()
    assert full.faces.tobytes() == bare.faces.tobytes()
