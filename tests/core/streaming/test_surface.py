# SPDX-License-Identifier: GPL-3.0-or-later
"""A volume that is fetched slab by slab gives the surface of the volume in memory, byte for byte."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ctmc_addon.core import CtmcError, MemoryLimitError, ReconstructionSettings, Volume, reconstruct
from ctmc_addon.core.extraction import scan
from ctmc_addon.core.phantom import foam
from ctmc_addon.core.streaming import choice, parts, surface_pieces_steps
from ctmc_addon.core.volume import SlabVolume
from ctmc_addon.readers import read_volume

SHARED = Path(__file__).resolve().parents[4] / "shared" / "data"
AFFINE = np.array([[-0.7, 0.1, 0, 5], [0, 0.8, 0.2, -9], [0.1, 0, 1.5, 30], [0, 0, 0, 1]], float)
REGION = (3, 2, 4, 60, 18, 20)
ONE = np.pad(np.ones((1, 1, 1), np.uint8), ((3, 5), (3, 4), (3, 3)))
HOLES = np.where(np.indices((9, 8, 7))[0] == 3, np.nan, np.indices((9, 8, 7))[1])


@pytest.fixture
def fetched(monkeypatch):
    """Settings of streaming: no values in memory, and slabs of so many bytes."""
    monkeypatch.setattr(choice, "SMALL_BYTES", 0)
    monkeypatch.setattr(choice, "SHARE", 0.0)
    monkeypatch.setattr(scan, "SLAB_MIXED", 24)  # many slabs even in small volumes
    return lambda slab_bytes: monkeypatch.setattr(parts, "SLAB_BYTES", slab_bytes)


def waves(shape=(23, 21, 70), dtype=np.int16):
    z, y, x = np.indices(shape)
    noise = np.random.default_rng(3).normal(0, 60, shape)
    return (400 * np.sin(x / 5) * np.sin(y / 4) * np.cos(z / 3) + noise).astype(dtype)


def outcome(volume, settings):
    try:
        result = reconstruct(volume, settings, threads=2)
    except CtmcError as error:
        return type(error), str(error)
    surface = result.surface
    arrays = [] if surface is None else [surface.midpoints, surface.linear]
    arrays += [result.mesh.vertices, result.mesh.faces, result.mesh.normals]
    facts = (result.threshold, result.full_faces, result.voxels_visited, result.notes, result.wrong_side)
    return *(None if array is None else (array.dtype, array.shape, array.tobytes()) for array in arrays), *facts


def assert_same(values, settings, kind="HU", affine=AFFINE):
    volume = Volume(values, affine, kind=kind)
    in_memory = outcome(volume, settings)
    assert outcome(SlabVolume.of(volume), settings) == in_memory
    return in_memory


SETTINGS = {
    "default": {},
    "midpoints": {"alpha": 0.0},
    "half": {"alpha": 0.5},
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
@pytest.mark.parametrize("slab_bytes", [1, 2 * 2 * 21 * 70, 7 * 2 * 21 * 70])
def test_every_setting_gives_the_bytes_of_the_volume_in_memory(fetched, name, slab_bytes):
    fetched(slab_bytes)
    settings = ReconstructionSettings(**({"threshold": 120.0} | SETTINGS[name]))
    assert len(assert_same(waves(), settings)) > 2


@pytest.mark.parametrize("dtype", [bool, np.uint8, np.int8, np.uint16, np.int32, np.float32, np.float64, ">i2"])
@pytest.mark.parametrize("threshold", [30.0, None])
def test_every_type_of_values_gives_the_bytes_of_the_volume_in_memory(fetched, dtype, threshold):
    fetched(3 * 21 * 70)
    values = (waves(dtype=float) / 8).clip(0, 120).astype(dtype)
    settings = ReconstructionSettings(threshold=0.5 if dtype is bool and threshold else threshold)
    assert len(assert_same(values, settings)) > 2


@pytest.mark.once
@pytest.mark.parametrize("extra", [{}, {"stride": (1, 1, 2)}, {"close_border": True}, {"region": REGION}])
@pytest.mark.parametrize("smoothing", ["none", "gaussian", "constrained"])
def test_a_label_gives_the_bytes_of_the_volume_in_memory(fetched, smoothing, extra):
    fetched(2 * 21 * 70)
    values = np.digitize(waves(), [120, 300]).astype(np.uint8)
    settings = ReconstructionSettings(label=1, smoothing=smoothing, **extra)
    assert len(assert_same(values, settings, "label")) > 2


@pytest.mark.parametrize("seed", range(30))
def test_random_volumes_and_settings_give_the_bytes_of_the_volume_in_memory(fetched, seed):
    random = np.random.default_rng(seed)
    shape = tuple(int(side) for side in random.integers(2, (14, 20, 140)))
    values = random.integers(0, random.choice([2, 5, 250]), shape).astype(random.choice([np.uint8, np.float32]))
    fetched(int(random.integers(1, 4 * values[0].nbytes)))
    settings = ReconstructionSettings(
        threshold=float(random.choice([0.5, 1.0, 100.5])),
        upper=random.choice([None, None, 100.5, 180.0]),
        stride=tuple(int(random.integers(1, min(4, side))) for side in shape[::-1]),
        close_border=bool(random.integers(2)),
        normals=str(random.choice(["gradient", "mesh"])),
        topology=str(random.choice(["classic", "trilinear"])),
        alpha=float(random.choice([0.0, 0.3, 1.0])),
    )
    assert_same(values, settings, affine=np.diag([1.0, 1.0, -2.0, 1.0]))


@pytest.mark.parametrize(
    ("values", "settings"),
    [
        (np.zeros((9, 8, 7), np.uint8), {"threshold": 9}),
        (np.ones((9, 8, 7), np.uint8), {"threshold": 1, "close_border": True}),
        (np.zeros((9, 8, 7), np.uint8), {}),
        (np.full((9, 8, 7), np.nan, np.float32), {"threshold": 1}),
        (HOLES, {"threshold": 2}),
        (
            np.where(np.indices((9, 8, 7))[0] == 3, np.nan, np.indices((9, 8, 7))[1]),
            {"threshold": 2, "stride": (1, 1, 4)},
        ),
        (ONE, {"threshold": 1, "stride": (2, 2, 2)}),
        (ONE, {"threshold": 1, "smoothing": "gaussian"}),
        (np.zeros((9, 8, 7), np.uint8), {"label": 3}),
        (np.full((9, 8, 7), 3, np.uint8), {"label": 3, "smoothing": "none"}),
        (np.full((9, 8, 7), 3, np.uint8), {"label": 3, "smoothing": "gaussian"}),
        (np.full((9, 8, 7), 3, np.uint8), {"label": 3, "smoothing": "none", "close_border": True}),
        (waves(), {"smoothing": "constrained"}),
    ],
)
def test_what_gives_no_surface_is_refused_in_the_same_words(fetched, values, settings):
    fetched(1)
    kind = "label" if "label" in settings else "grey value"
    assert_same(values, ReconstructionSettings(**settings), kind)


def test_nan_voxels_are_replaced_as_in_memory(fetched):
    fetched(1)
    values = np.where(np.random.default_rng(0).random((9, 20, 30)) < 0.1, np.nan, waves((9, 20, 30), np.float32))
    for nan_as in (-1000.0, 1000.0):
        assert len(assert_same(values, ReconstructionSettings(threshold=100, nan_as=nan_as))) > 2


def test_any_number_of_threads_gives_the_same_bytes(fetched):
    fetched(5 * 2 * 21 * 70)
    volume = SlabVolume.of(Volume(waves(), AFFINE))
    settings = ReconstructionSettings(threshold=120)
    one, four = (reconstruct(volume, settings, threads=threads).mesh for threads in (1, 4))
    assert one.vertices.tobytes() == four.vertices.tobytes()
    assert one.faces.tobytes() == four.faces.tobytes()


def test_every_slice_is_fetched_once(fetched):
    fetched(3 * 2 * 21 * 70)
    volume = SlabVolume.of(Volume(waves(), AFFINE))
    reader = Counting(volume.reader.values)
    reconstruct(replace(volume, reader=reader), ReconstructionSettings(threshold=120))
    assert reader.slices == [*range(23)]
    reader.slices.clear()
    reconstruct(replace(volume, reader=reader), ReconstructionSettings(threshold=120, stride=(1, 1, 4), normals="mesh"))
    assert reader.slices == [0, 4, 8, 12, 16, 20, 22]


@pytest.mark.once
@pytest.mark.parametrize(
    "extra", [{}, {"close_border": True, "keep_parts": 3}, {"topology": "trilinear", "stride": (2, 2, 1)}]
)
def test_bone_of_a_real_abdomen_has_the_bytes_of_the_volume_in_memory(fetched, monkeypatch, extra):
    path = SHARED / "ircadb01_abdomen"
    if not path.exists():
        pytest.skip("real CT 'ircadb01_abdomen' is not beside the checkout")
    fetched(1 << 23)
    monkeypatch.undo()
    monkeypatch.setattr(choice, "SMALL_BYTES", 0)
    monkeypatch.setattr(choice, "SHARE", 0.0)
    volume = read_volume(path)
    settings = ReconstructionSettings(threshold=200, **extra)
    assert outcome(SlabVolume.of(volume), settings) == outcome(volume, settings)


class Counting(type(SlabVolume.of(Volume(np.zeros((2, 2, 2)), np.eye(4))).reader)):
    """Notes which slices are fetched."""

    def __init__(self, values):
        super().__init__(values)
        self.slices = []

    def read(self, slices, rows, columns):
        self.slices += slices
        return super().read(slices, rows, columns)


def test_a_slab_is_refused_before_the_system_kills_the_process(monkeypatch):
    monkeypatch.setattr("ctmc_addon.core.memory.linux_available", lambda *_, **__: 20 << 20)
    monkeypatch.setattr(sys, "platform", "linux")
    volume = foam(12, 20, 8, 1)
    steps = surface_pieces_steps(volume, ReconstructionSettings(threshold=132.0), memory_limit=1 << 10)
    with pytest.raises(MemoryLimitError, match=r"extracting a slab .* 32 MiB of memory and 20 MiB are available"):
        list(steps)
