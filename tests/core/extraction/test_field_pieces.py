# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface has the same bytes wherever its values come from, and however they are cut into slabs."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from volumes import AFFINE, FACTS, FileReader, bytes_of, concatenated, in_file, items_of, outcome, waves

from ctmc_addon.core import (
    Budget,
    CtmcError,
    MemoryLimitError,
    ReconstructionSettings,
    Volume,
    finish,
    marching_cubes,
    plan_steps,
    reconstruct,
)
from ctmc_addon.core.extraction import field_pieces, grid, scan
from ctmc_addon.core.extraction.field_pieces import FieldSlabs, surface_pieces_steps
from ctmc_addon.core.mesh.triangle_mesh import blend
from ctmc_addon.core.phantom import foam
from ctmc_addon.core.smoothing.prepare import field_steps
from ctmc_addon.readers import read_volume

SHARED = Path(__file__).resolve().parents[4] / "shared" / "data"
LAYER = 21 * 70  # samples
SLICE = 2 * LAYER  # bytes
REGION = (3, 2, 4, 60, 18, 20)
ONE = np.pad(np.ones((1, 1, 1), np.uint8), ((3, 5), (3, 4), (3, 3)))
HOLES = np.where(np.indices((9, 8, 7))[0] == 3, np.nan, np.indices((9, 8, 7))[1])


@pytest.fixture(autouse=True)
def many_slabs(monkeypatch):
    """Units of two layers, and slabs of few voxels, even in small volumes."""
    monkeypatch.setattr(grid, "UNIT_SAMPLES", 2 * LAYER)
    monkeypatch.setattr(scan, "SLAB_MIXED", 24)


def assert_same(values, settings, budget, kind="HU", affine=AFFINE):
    """Return the outcome, which is that of the same values in memory with one thread."""
    volume = Volume(values, affine, kind=kind)
    in_memory = outcome(volume, settings, Budget(threads=1))
    assert outcome(in_file(volume), settings, budget) == in_memory
    return in_memory


def pieces_of(volume, settings, budget, normals=True):
    """The pieces of a surface, and how many samples of a label are on the wrong side."""
    field = finish(field_steps(volume, settings, budget))
    return items_of(surface_pieces_steps(field, budget, normals))


SETTINGS = {
    "default": {},
    "midpoints": {"alpha": 0.0},
    "half": {"alpha": 0.5},
    "upper": {"upper": 260.0},
    "stride": {"stride": (2, 3, 1)},
    "stride along z": {"stride": (1, 1, 4)},
    "stride without normals": {"stride": (3, 2, 4), "normals": "mesh"},
    "stride and closed": {"stride": (3, 2, 5), "close_border": True},
    "closed": {"close_border": True},
    "trilinear": {"topology": "trilinear"},
    "trilinear closed": {"topology": "trilinear", "close_border": True, "stride": (1, 2, 2)},
    "largest": {"keep_parts": 2},
    "minimum": {"min_part_mm3": 20.0, "close_border": True},
    "gaussian": {"smoothing": "gaussian", "smoothing_mm": 1.1},
    "gaussian stride": {"smoothing": "gaussian", "smoothing_mm": 0.9, "stride": (1, 1, 3), "normals": "mesh"},
    "gaussian closed": {"smoothing": "gaussian", "smoothing_mm": 2.0, "close_border": True},
    "region": {"region": REGION},
    "region in mm": {"region": (-35, -5, 35, 0, 8, 60), "region_unit": "mm", "close_border": True},
    "region and gaussian": {"region": REGION, "smoothing": "gaussian", "smoothing_mm": 1.0},
    "otsu": {"threshold": None},
    "otsu of a region": {"threshold": None, "region": REGION},
    "simplified": {"reduction": 0.5},
    "mesh normals": {"normals": "mesh"},
}


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize(("slab_bytes", "threads"), [(1, 1), (5 * SLICE, 2), (1 << 30, 2)])
def test_every_setting_gives_the_bytes_of_the_values_in_memory(name, slab_bytes, threads):
    settings = ReconstructionSettings(**({"threshold": 120.0} | SETTINGS[name]))
    assert len(assert_same(waves(), settings, Budget(threads=threads, slab_bytes=slab_bytes))) > 2


@pytest.mark.parametrize("dtype", [bool, np.uint8, np.int8, np.uint16, np.int32, np.float32, np.float64, ">i2"])
@pytest.mark.parametrize("threshold", [30.0, None])
def test_every_type_of_values_gives_the_bytes_of_the_values_in_memory(dtype, threshold):
    values = (waves(dtype=float) / 8).clip(0, 120).astype(dtype)
    settings = ReconstructionSettings(threshold=0.5 if dtype is bool and threshold else threshold)
    assert len(assert_same(values, settings, Budget(threads=2, slab_bytes=3 * LAYER))) > 2


@pytest.mark.once
@pytest.mark.parametrize("extra", [{}, {"stride": (1, 1, 2)}, {"close_border": True}, {"region": REGION}])
@pytest.mark.parametrize("smoothing", ["none", "gaussian", "constrained"])
def test_a_label_gives_the_bytes_of_the_values_in_memory(smoothing, extra):
    values = np.digitize(waves(), [120, 300]).astype(np.uint8)
    settings = ReconstructionSettings(label=1, smoothing=smoothing, **extra)
    found = assert_same(values, settings, Budget(threads=2, slab_bytes=2 * LAYER), "label")
    assert len(found) > 2
    wrong_side = found[FACTS.index("wrong_side") - len(FACTS)]
    assert (wrong_side > 0) == (smoothing == "gaussian")


@pytest.mark.parametrize("seed", range(40))
def test_random_volumes_and_settings_give_the_bytes_of_the_values_in_memory(seed, monkeypatch):
    random = np.random.default_rng(seed)
    monkeypatch.setattr(scan, "SLAB_MIXED", int(random.integers(1, 60)))
    shape = tuple(int(side) for side in random.integers(2, (14, 20, 140)))
    monkeypatch.setattr(grid, "UNIT_SAMPLES", int(random.integers(1, 6)) * shape[1] * shape[2])
    values = random.integers(0, random.choice([2, 5, 250]), shape).astype(random.choice([np.uint8, np.float32]))
    settings = ReconstructionSettings(
        threshold=float(random.choice([0.5, 1.0, 100.5])),
        upper=random.choice([None, None, 100.5, 180.0]),
        stride=tuple(int(random.integers(1, min(4, side))) for side in shape[::-1]),
        close_border=bool(random.integers(2)),
        normals=str(random.choice(["gradient", "mesh"])),
        topology=str(random.choice(["classic", "trilinear"])),
        alpha=float(random.choice([0.0, 0.3, 1.0])),
    )
    budget = Budget(threads=int(random.integers(1, 4)), slab_bytes=int(random.integers(1, 4 * values[0].nbytes)))
    assert_same(values, settings, budget, affine=np.diag([1.0, 1.0, -2.0, 1.0]))


@pytest.mark.parametrize(
    ("values", "settings"),
    [
        (np.zeros((9, 8, 7), np.uint8), {"threshold": 9}),
        (np.ones((9, 8, 7), np.uint8), {"threshold": 1, "close_border": True}),
        (np.zeros((9, 8, 7), np.uint8), {}),
        (np.full((9, 8, 7), np.nan, np.float32), {"threshold": 1}),
        (HOLES, {"threshold": 2}),
        (HOLES, {"threshold": 2, "stride": (1, 1, 4)}),
        (ONE, {"threshold": 1, "stride": (2, 2, 2)}),
        (ONE, {"threshold": 1, "smoothing": "gaussian"}),
        (np.zeros((9, 8, 7), np.uint8), {"label": 3}),
        (np.full((9, 8, 7), 3, np.uint8), {"label": 3, "smoothing": "none"}),
        (np.full((9, 8, 7), 3, np.uint8), {"label": 3, "smoothing": "gaussian"}),
        (np.full((9, 8, 7), 3, np.uint8), {"label": 3, "smoothing": "none", "close_border": True}),
        (waves(), {"smoothing": "constrained"}),
        (waves(), {"threshold": 100, "upper": 9000.0}),
        (waves(), {"threshold": 120, "min_part_mm3": 1e9}),
    ],
)
@pytest.mark.parametrize("slab_bytes", [1, 1 << 30])
def test_what_gives_no_surface_is_refused_in_the_same_words(values, settings, slab_bytes):
    kind = "label" if "label" in settings else "gray value"
    assert_same(values, ReconstructionSettings(**settings), Budget(slab_bytes=slab_bytes), kind)


def test_nan_voxels_are_replaced_as_in_memory():
    values = np.where(np.random.default_rng(0).random((9, 20, 30)) < 0.1, np.nan, waves((9, 20, 30), np.float32))
    for nan_as in (-1000.0, 1000.0):
        settings = ReconstructionSettings(threshold=100, nan_as=nan_as)
        found = assert_same(values, settings, Budget(slab_bytes=1))
        filled = np.where(np.isnan(values), np.float32(nan_as), values)
        plain = outcome(Volume(filled, AFFINE, kind="HU"), replace(settings, nan_as=None), Budget())
        assert len(found) > 2
        assert found[:-1] == plain[:-1]  # all but the settings


@pytest.mark.parametrize("normals", [True, False])
@pytest.mark.parametrize("slab_bytes", [1, 7 * SLICE])
@pytest.mark.parametrize(
    "extra",
    [
        {},
        {"alpha": 0.3, "close_border": True},
        {"stride": (2, 3, 1)},
        {"stride": (1, 1, 4)},
        {"stride": (3, 2, 4), "close_border": True},
        {"topology": "trilinear", "close_border": True},
        {"smoothing": "gaussian", "smoothing_mm": 1.1},
        {"region": REGION, "close_border": True},
        {"threshold": None},
    ],
)
def test_all_pieces_one_after_the_other_are_the_surface(slab_bytes, extra, normals):
    settings = ReconstructionSettings(**({"threshold": 120.0} | extra))
    volume = Volume(waves(), AFFINE)
    expected = reconstruct(volume, settings, Budget(threads=1)).surface
    pieces, wrong_side = pieces_of(in_file(volume), settings, Budget(threads=2, slab_bytes=slab_bytes), normals)
    held, _ = pieces_of(volume, settings, Budget(threads=2, slab_bytes=slab_bytes), normals)
    assert len(pieces) > (2 if settings.stride[2] == 1 else 1)
    assert len(held) == len(pieces)
    assert wrong_side is None
    for found in (concatenated(pieces), concatenated(held)):
        assert [*map(bytes_of, found[:3])] == [*map(bytes_of, (expected.midpoints, expected.linear, expected.faces))]
        assert bytes_of(found[3]) == (bytes_of(expected.normals) if normals else None)


def test_a_slab_is_whole_units_of_layers_and_a_held_field_whose_pieces_are_joined_is_one():
    volume, settings = Volume(waves(), AFFINE), ReconstructionSettings(threshold=120.0)
    for slab_bytes, height in ((1, 2), (5 * SLICE, 4), (6 * SLICE, 6)):
        budget = Budget(slab_bytes=slab_bytes)
        fetched = FieldSlabs(finish(field_steps(in_file(volume), settings, budget)), budget, normals=True)
        held = FieldSlabs(finish(field_steps(volume, settings, budget)), budget, normals=True, joined=True)
        assert fetched.height == height
        assert fetched.ranges()[0] == (0, height)
        assert fetched.ranges()[-1][1] == 23
        assert held.ranges() == [(0, 23)]


@pytest.mark.parametrize("more", [{}, {"stride": (2, 3, 1)}, {"close_border": True}, {"topology": "trilinear"}])
@pytest.mark.parametrize("slab_bytes", [1, 5 * SLICE, 1 << 30])
def test_triangles_are_counted_exactly_slab_by_slab(slab_bytes, more):
    settings = ReconstructionSettings(threshold=120.0, **more)
    volume, budget = Volume(waves(), AFFINE), Budget(slab_bytes=slab_bytes)
    result = reconstruct(volume, settings)
    for each in (volume, in_file(volume)):
        counts = finish(plan_steps(each, settings, budget)).counts
        assert (counts.vertices, counts.faces) == (len(result.mesh.vertices), len(result.mesh.faces))
        assert counts.voxels == result.voxels_visited
    assert counts == finish(plan_steps(volume, settings, Budget())).counts


def test_the_order_of_a_field_is_that_of_marching_cubes():
    mesh = marching_cubes(waves(), 120.0, (2, 1, 3), close_border=True)
    settings = ReconstructionSettings(threshold=120.0, stride=(2, 1, 3), close_border=True)
    pieces, _ = pieces_of(in_file(Volume(waves(), np.eye(4))), settings, Budget(slab_bytes=1))
    midpoints, linear, faces, normals = concatenated(pieces)
    found = [*map(bytes_of, (blend(midpoints, linear, 1.0), faces))]
    assert found == [*map(bytes_of, (mesh.vertices, mesh.faces))]
    np.testing.assert_allclose(normals, mesh.normals, atol=1e-6)  # brought to length 1 again in millimeters


def test_every_slice_is_fetched_once():
    volume = Volume(waves(), AFFINE)
    settings = ReconstructionSettings(threshold=120)
    for stride, normals, expected in (
        (1, "gradient", [*range(23)]),
        (4, "mesh", [0, 4, 8, 12, 16, 20, 22]),
        (4, "gradient", [*range(23)]),
    ):
        reader = FileReader(volume.values)
        chosen = replace(settings, stride=(1, 1, stride), normals=normals)
        reconstruct(replace(volume, reader=reader), chosen, Budget(slab_bytes=3 * SLICE))
        assert reader.slices == expected


def test_a_slab_is_refused_before_the_system_kills_the_process(monkeypatch):
    monkeypatch.setattr("ctmc_addon.core.machine.memory.linux_available", lambda *_, **__: 20 << 20)
    monkeypatch.setattr(sys, "platform", "linux")
    with pytest.raises(MemoryLimitError, match=r"extracting a slab .* 32 MiB of memory and 20 MiB are available"):
        pieces_of(foam(12, 20, 8, 1), ReconstructionSettings(threshold=132.0), Budget(bytes=1 << 30))


def test_a_file_that_fails_in_the_middle_says_so():
    class Broken(FileReader):
        def fill(self, out, slices, rows, columns):
            if slices.stop > 12:
                raise OSError(5, "Input/output error")
            super().fill(out, slices, rows, columns)

    volume = Volume(Broken(waves()), AFFINE, name="ct")
    with pytest.raises(CtmcError, match=r"^ct can no longer be read \(Input/output error\); load it from where it is"):
        reconstruct(volume, ReconstructionSettings(threshold=120), Budget(slab_bytes=1))


@pytest.mark.once
@pytest.mark.parametrize(
    "extra", [{}, {"close_border": True, "keep_parts": 3}, {"topology": "trilinear", "stride": (2, 2, 1)}]
)
def test_bone_of_a_real_abdomen_has_the_bytes_of_the_values_in_memory(monkeypatch, extra):
    path = SHARED / "ircadb01_abdomen"
    if not path.exists():
        pytest.skip("real CT 'ircadb01_abdomen' is not beside the checkout")
    monkeypatch.undo()
    volume = read_volume(path, region=(0, 0, 40, 511, 511, 80))
    settings = ReconstructionSettings(threshold=200, **extra)
    assert outcome(in_file(volume), settings, Budget(slab_bytes=1 << 20)) == outcome(volume, settings, Budget())


def test_slices_are_joined_some_at_a_time(monkeypatch):
    values = np.arange(9 * 4 * 5, dtype=np.float32).reshape(9, 4, 5)
    monkeypatch.setattr(field_pieces, "COPIED_BYTES", 2 * 4 * 5 * 4)  # two slices
    steps = field_pieces._joined_steps(values[:2], values[2:])
    pauses = 0
    try:
        while True:
            next(steps)
            pauses += 1
    except StopIteration as done:
        joined = done.value
    assert pauses == 4
    assert joined.tobytes() == values.tobytes()
