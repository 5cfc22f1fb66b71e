# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces without small components are the mesh in memory without them, byte for byte."""

import re
from dataclasses import replace

import numpy as np
import pytest
from core.streaming.test_pieces import concatenated, pieces_of
from core.streaming.test_surface import AFFINE, SHARED, fetched, waves

from ctmc_addon.core import CtmcError, ReconstructionSettings, Volume, reconstruct
from ctmc_addon.core.progress import Step
from ctmc_addon.core.simplification.streaming import reduce_pieces
from ctmc_addon.core.streaming import choice, kept_pieces, surface_pieces_steps
from ctmc_addon.core.volume import SlabVolume
from ctmc_addon.readers import read_volume

__all__ = ["fetched"]
LAYERS = (1, 3, 10**9)  # of values in a slab


def assert_same(volume, settings):
    """The number of faces that are left, after a comparison with the path in memory; 0 where both refuse alike."""
    error = None
    try:
        mesh = reconstruct(volume, settings, threads=2).mesh
    except CtmcError as refused:
        error = refused
    if error is not None:
        with pytest.raises(type(error), match=f"^{re.escape(str(error))}$"):
            pieces_of(SlabVolume.of(volume), settings)
        return 0
    pieces, _ = pieces_of(SlabVolume.of(volume), settings)
    vertices, faces, normals = concatenated(pieces)
    assert vertices.tobytes() == mesh.vertices.tobytes()
    assert faces.astype(np.int32).tobytes() == mesh.faces.tobytes()
    if settings.normals == "gradient":
        assert normals.tobytes() == mesh.normals.tobytes()
    return len(faces)


def nested(shape=(40, 44, 48)):
    """Shells within shells, one with a solid inside its cavity, touching nothing; a shell cut by the border; specks."""
    z, y, x = np.indices(shape)
    values = np.zeros(shape, np.int16)
    for middle, radii in (((20, 15, 15), (13, 11, 8, 5, 2)), ((20, 34, 36), (8, 6)), ((38, 10, 38), (8, 5))):
        distance = np.sqrt(sum((axis - at) ** 2 for axis, at in zip((z, y, x), middle, strict=True)))
        for number, radius in enumerate(radii):
            values[distance < radius] = 0 if number % 2 else 100
    for at in ((2, 2, 2), (2, 2, 40), (35, 40, 5), (2, 40, 2)):
        values[at] = 100
    return values


def late(shape=(60, 12, 40)):
    """A U whose arms meet in the last slices, one between them that stays alone, and one that begins later."""
    values = np.zeros(shape, np.uint8)
    values[2:56, 3:6, 3:7] = values[5:56, 3:6, 20:24] = 1
    values[52:56, 3:6, 3:24] = 1
    values[3:48, 3:8, 11:16] = 1
    values[30:58, 3:10, 30:36] = 1
    return values


@pytest.mark.parametrize("layers", LAYERS)
@pytest.mark.parametrize("limits", [(1, 0.0), (5, 0.0), (0, 3.0), (3, 8.0), (10**6, 0.0), (0, 1e9)])
def test_noise(fetched, layers, limits):
    values = waves((16, 21, 70))
    fetched(layers * values[0].nbytes)
    keep, smallest = limits
    settings = ReconstructionSettings(threshold=150.0, keep_parts=keep, min_part_mm3=smallest)
    faces = assert_same(Volume(values, AFFINE), settings)
    assert (faces == 0) == (smallest == 1e9)


@pytest.mark.parametrize("seed", range(30))
def test_random_volumes_and_settings(fetched, monkeypatch, seed):
    monkeypatch.setattr(kept_pieces, "MOST_PAIRS", 5)
    random = np.random.default_rng(seed)
    shape = tuple(int(side) for side in random.integers(2, (24, 20, 90)))
    values = (random.random(shape) < random.choice([0.05, 0.3, 0.7, 0.95])) * random.integers(90, 200, shape)
    fetched(int(random.integers(1, 4 * values[0].nbytes)))
    settings = ReconstructionSettings(
        threshold=float(random.choice([50.0, 120.0])),
        stride=tuple(int(random.integers(1, min(3, side))) for side in shape[::-1]),
        close_border=bool(random.integers(2)),
        normals=str(random.choice(["gradient", "mesh"])),
        topology=str(random.choice(["classic", "trilinear"])),
        alpha=float(random.choice([0.0, 0.3, 1.0])),
        keep_parts=int(random.choice([0, 1, 2, 5, 40])),
        min_part_mm3=float(random.choice([0.0, 0.2, 0.5, 3.0])),
    )
    turned = AFFINE if random.integers(2) else np.diag([1.0, 1.0, 1.0, 1.0])[[1, 2, 0, 3]]
    assert_same(Volume(values.astype(np.int16), turned), settings)


@pytest.mark.parametrize("affine", [AFFINE, np.eye(4)[[2, 0, 1, 3]]])
@pytest.mark.parametrize("limits", [(1, 0.0), (2, 0.0), (5, 0.0), (0, 2.0), (2, 300.0)])
@pytest.mark.parametrize("close", [False, True])
def test_cavities_go_and_stay_with_what_is_around_them(fetched, affine, limits, close):
    values = nested()
    fetched(2 * values[0].nbytes)
    keep, smallest = limits
    settings = ReconstructionSettings(threshold=50.0, keep_parts=keep, min_part_mm3=smallest, close_border=close)
    assert assert_same(Volume(values, affine), settings) > 0


@pytest.mark.once
def test_a_cavity_with_nothing_around_it_counts_as_a_component(fetched):
    values = 100 - nested()
    fetched(values[0].nbytes)
    for keep in (1, 3, 6):
        assert_same(Volume(values, np.eye(4)), ReconstructionSettings(threshold=50.0, keep_parts=keep))


@pytest.mark.parametrize("layers", LAYERS)
@pytest.mark.parametrize("keep", [1, 2, 3])
def test_components_that_meet_in_a_late_slice(fetched, layers, keep):
    values = late()
    fetched(layers * values[0].nbytes)
    settings = ReconstructionSettings(threshold=0.5, keep_parts=keep)
    assert assert_same(Volume(values, np.eye(4)), settings) > 0
    assert reconstruct(Volume(values, np.eye(4)), settings).mesh.components == keep


@pytest.mark.parametrize("layers", LAYERS)
@pytest.mark.parametrize("keep", [1, 2, 5])
def test_of_equal_components_the_first_stay(fetched, layers, keep):
    values = np.zeros((30, 9, 30), np.uint8)
    values[2:29:4, 4, 2:29:4] = 1
    fetched(layers * values[0].nbytes)
    volume, settings = Volume(values, np.eye(4)), ReconstructionSettings(threshold=0.5, keep_parts=keep)
    assert assert_same(volume, settings) == 8 * keep


def test_a_surface_that_is_simplified_while_it_is_extracted_has_the_same_components(fetched, monkeypatch):
    monkeypatch.setattr(reduce_pieces, "BATCH_FACES", 3000)
    values = nested()
    fetched(2 * values[0].nbytes)
    volume = Volume(values, AFFINE)
    settings = ReconstructionSettings(threshold=50.0, keep_parts=2, close_border=True)
    full = reconstruct(volume, settings).mesh
    simplified = reconstruct(SlabVolume.of(volume), replace(settings, reduction=0.5))
    assert simplified.full_faces == len(full.faces)
    assert len(simplified.mesh.faces) <= len(full.faces) // 2 + 1
    assert (simplified.mesh.closed, simplified.mesh.components) == (True, full.components)
    assert simplified.mesh.volume == pytest.approx(full.volume, rel=0.02)


@pytest.mark.once
def test_steps_go_forward_and_the_values_can_be_let_go_at_any_time(fetched):
    values = nested()
    fetched(values[0].nbytes)
    settings = ReconstructionSettings(threshold=50.0, keep_parts=2)
    items = list(surface_pieces_steps(SlabVolume.of(Volume(values, AFFINE)), settings, 2))
    fractions = [item.fraction for item in items if isinstance(item, Step) and item.fraction]
    assert fractions == sorted(fractions)
    for count in range(0, len(items), len(items) // 9):
        steps = surface_pieces_steps(SlabVolume.of(Volume(values, AFFINE)), settings, 2)
        for _ in range(count):
            next(steps)
        steps.close()


@pytest.mark.once
@pytest.mark.parametrize("limits", [(1, 0.0), (3, 10.0)])
def test_bone_of_a_patient(fetched, monkeypatch, limits):
    path = SHARED / "ircadb01_abdomen"
    if not path.exists():
        pytest.skip("real CT 'ircadb01_abdomen' is not beside the checkout")
    fetched(1 << 23)
    monkeypatch.undo()
    monkeypatch.setattr(choice, "SMALL_BYTES", 0)
    monkeypatch.setattr(choice, "SHARE", 0.0)
    keep, smallest = limits
    settings = ReconstructionSettings(threshold=200.0, keep_parts=keep, min_part_mm3=smallest)
    assert assert_same(read_volume(path), settings) > 100_000
