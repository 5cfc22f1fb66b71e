# SPDX-License-Identifier: GPL-3.0-or-later
"""What is kept of a surface is the same wherever its pieces are cut."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import cavity_owners, component_of_face
from volumes import AFFINE, bytes_of, concatenated, in_file, items_of, outcome, waves

from ctmc_addon.core import Budget, CtmcError, ReconstructionSettings, Volume, finish, reconstruct
from ctmc_addon.core.errors import MeshError
from ctmc_addon.core.extraction import grid, scan
from ctmc_addon.core.extraction.field_pieces import surface_pieces_steps
from ctmc_addon.core.mesh.component_limits import ComponentLimits
from ctmc_addon.core.mesh.measures import component_volumes_steps
from ctmc_addon.core.mesh.pieces import kept_pieces
from ctmc_addon.core.mesh.pieces.kept_pieces import KeptPieces, keep_components_steps
from ctmc_addon.core.mesh.triangle_mesh import Surface
from ctmc_addon.core.progress import Step
from ctmc_addon.core.smoothing.prepare import field_steps
from ctmc_addon.readers import read_volume

SHARED = Path(__file__).resolve().parents[5] / "shared" / "data"
LAYERS = (1, 3, 10**9)  # of values in a slab

CORNERS = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float32)
CUBE = np.array(
    [
        (0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6), (0, 1, 4), (1, 5, 4),
        (2, 6, 3), (3, 6, 7), (0, 4, 2), (2, 4, 6), (1, 3, 5), (3, 7, 5),
    ],
    np.int32,
)  # fmt: skip


def boxes(*walls):
    """Boxes (lowest corner, side); a negative side is a cavity of that size."""
    vertices = [CORNERS * abs(side) + np.float32(low) for low, side in walls]
    faces = [(CUBE if side > 0 else CUBE[:, ::-1]) + 8 * at for at, (_, side) in enumerate(walls)]
    positions = np.concatenate(vertices)
    return Surface(positions, positions, np.concatenate(faces).astype(np.int32))


def cubes(*sides):
    """Boxes beside each other, far from the origin."""
    return boxes(*((1000 + 20 * at, side) for at, side in enumerate(sides)))


def component_volumes(mesh):
    return finish(component_volumes_steps(mesh.vertices, mesh.faces, component_of_face(mesh)))


def keep_components(surface, largest=0, min_volume=0.0):
    return finish(keep_components_steps(surface, 1.0, ComponentLimits(largest, min_volume)))


def kept_volumes(surface, **limits):
    return component_volumes(keep_components(surface, **limits).at(1.0)).tolist()


def test_every_component_has_its_signed_volume_far_from_the_origin():
    assert component_volumes(cubes(1, 3, -2).at(1.0)) == pytest.approx([1, 27, -8])


def test_an_open_cube_counts_nearly_as_much_as_a_closed_one():
    surface = cubes(2)
    open_top = replace(surface, faces=surface.faces[np.arange(12) != 2])
    assert component_volumes(open_top.at(1.0))[0] == pytest.approx(8, rel=0.2)


def test_the_largest_components_are_kept_in_their_order():
    assert kept_volumes(cubes(1, 3, 2), largest=2) == pytest.approx([27, 8])
    assert kept_volumes(cubes(1, 3, 2), largest=9) == pytest.approx([1, 27, 8])


def test_of_equal_components_the_first_is_kept():
    surface = cubes(2, 2, 2)
    assert (keep_components(surface, largest=1).faces == CUBE).all()


@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4), (4, 3, 2, 1, 0), (2, 0, 4, 1, 3)])
def test_the_largest_component_keeps_its_cavities_and_nothing_else(order):
    # A hollow body with an island in its hole, itself hollow, beside a body smaller than the hole.
    walls = [((0, 0, 0), 10), ((1, 1, 1), -8), ((2, 2, 2), 5), ((3, 3, 3), -2), ((20, 0, 0), 6)]
    surface = boxes(*(walls[at] for at in order))
    assert sorted(kept_volumes(surface, largest=1)) == pytest.approx([-512, 1000])
    assert sorted(kept_volumes(surface, largest=2)) == pytest.approx([-512, 216, 1000])
    assert sorted(kept_volumes(surface, largest=3)) == pytest.approx([-512, -8, 125, 216, 1000])


def test_small_cavities_are_filled_and_large_ones_stay():
    surface = boxes(((0, 0, 0), 10), ((1, 1, 1), -2), ((5, 5, 5), -3))
    assert sorted(kept_volumes(surface, min_volume=9)) == pytest.approx([-27, 1000])
    assert sorted(kept_volumes(surface, min_volume=28, largest=1)) == pytest.approx([1000])


def test_the_cavity_of_a_component_that_goes_goes_with_it():
    surface = boxes(((0, 0, 0), 10), ((20, 0, 0), 6), ((21, 1, 1), -4))
    assert kept_volumes(surface, largest=1) == pytest.approx([1000])


def test_a_cavity_with_nothing_around_it_is_a_component_of_its_own():
    assert kept_volumes(cubes(1, -3), largest=1) == pytest.approx([-27])
    assert kept_volumes(cubes(4, -1), largest=1) == pytest.approx([64])


def test_components_below_the_smallest_volume_go_and_the_limit_itself_stays():
    assert kept_volumes(cubes(1, 3, 2), min_volume=7.999) == pytest.approx([27, 8])
    assert kept_volumes(cubes(1, 3, 2), min_volume=7.999, largest=1) == pytest.approx([27])


def test_nothing_left_is_refused_with_the_largest_volume():
    with pytest.raises(MeshError, match="largest of 2 has 27"):
        kept_volumes(cubes(1, 3), min_volume=100)


def test_without_limits_the_surface_is_returned_untouched():
    surface = cubes(1, 2)
    assert keep_components(surface) is surface


def cut(surface, ends):
    """The pieces of a surface whose vertices are cut at these numbers; triangles reach at most into the next."""
    ends = [0, *ends, len(surface.linear)]
    lowest = np.searchsorted(ends, surface.faces.min(axis=1), side="right") - 1
    assert (np.diff(lowest) >= 0).all()
    for number in range(len(ends) - 1):
        own = slice(ends[number], ends[number + 1])
        faces = surface.faces[lowest == number] - np.int32(ends[number])
        yield Surface(surface.midpoints[own], surface.linear[own], faces)


@pytest.mark.parametrize("ends", [(8,), (4, 8, 12), (9, 15, 30)])
@pytest.mark.parametrize("limits", [(1, 0.0), (2, 0.0), (0, 9.0), (1, 9.0)])
def test_boxes_that_are_cut_in_the_middle_stay_and_go_as_a_whole(ends, limits):
    surface = boxes(((0, 0, 0), 10), ((1, 1, 1), -2), ((5, 5, 5), -3), ((20, 0, 0), 6))
    surface = replace(surface, faces=surface.faces[np.argsort(surface.faces.min(axis=1), kind="stable")])

    def one_pass(_last):
        yield Step()
        yield from cut(surface, ends)
        return 7

    pieces, result = items_of(KeptPieces(one_pass, ComponentLimits(*limits)).pieces_steps(1.0))
    expected = keep_components(surface, *limits)
    assert result == 7
    found = concatenated(pieces)[:3]
    assert [*map(bytes_of, found)] == [*map(bytes_of, (expected.midpoints, expected.linear, expected.faces))]


# Of volumes, against a mesh whose components are looked for all at once.


@pytest.fixture
def many_slabs(monkeypatch):
    monkeypatch.setattr(scan, "SLAB_MIXED", 24)


def kept_at_once(surface, alpha, largest, min_volume):
    """The surface that is left, by the components, the volumes and the cavities of the whole mesh."""
    mesh = surface.at(alpha)
    component = component_of_face(mesh)
    volumes = component_volumes(mesh)
    owner = cavity_owners(mesh, component, volumes)
    if not min_volume and largest >= len(volumes):
        return surface
    faces = surface.faces[ComponentLimits(largest, min_volume).kept(volumes, owner)[component]]
    used = np.unique(faces)
    arrays = (None if each is None else each[used] for each in (surface.midpoints, surface.linear, surface.normals))
    midpoints, linear, normals = arrays
    return Surface(midpoints, linear, np.searchsorted(used, faces).astype(np.int32), normals)


def assert_same(monkeypatch, volume, settings, layers):
    """Return how many triangles are left, in pieces as of the whole; 0 where both refuse alike."""
    monkeypatch.setattr(grid, "UNIT_SAMPLES", 2 * volume.values[0].size)
    budget = Budget(threads=2, slab_bytes=layers * volume.values[0].nbytes)
    full = reconstruct(volume, replace(settings, keep_parts=0, min_part_mm3=0.0)).surface
    found = outcome(in_file(volume), settings, budget)
    assert outcome(volume, settings, budget) == found
    try:
        expected = kept_at_once(full, settings.alpha, settings.keep_parts, settings.min_part_mm3)
    except CtmcError as refused:
        expected = (type(refused), str(refused))
    if isinstance(expected, tuple):
        assert found == expected
        return 0
    arrays = (expected.midpoints, expected.linear, expected.faces, expected.normals)
    assert [*found[:4]] == [*map(bytes_of, arrays)]
    return len(expected.faces)


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
def test_noise(many_slabs, monkeypatch, layers, limits):
    keep, smallest = limits
    settings = ReconstructionSettings(threshold=150.0, keep_parts=keep, min_part_mm3=smallest)
    faces = assert_same(monkeypatch, Volume(waves((16, 21, 70)), AFFINE), settings, layers)
    assert (faces == 0) == (smallest == 1e9)


@pytest.mark.parametrize("seed", range(30))
def test_random_volumes_and_settings(many_slabs, monkeypatch, seed):
    monkeypatch.setattr(kept_pieces, "MOST_PAIRS", 5)
    random = np.random.default_rng(seed)
    shape = tuple(int(side) for side in random.integers(3, (24, 20, 90)))
    values = (random.random(shape) < random.choice([0.05, 0.3, 0.7, 0.95])) * random.integers(90, 200, shape)
    settings = ReconstructionSettings(
        threshold=float(random.choice([50.0, 120.0])),
        stride=tuple(int(random.integers(1, min(3, side))) for side in shape[::-1]),
        close_border=bool(random.integers(2)),
        normals=str(random.choice(["gradient", "mesh"])),
        topology=str(random.choice(["classic", "trilinear"])),
        alpha=float(random.choice([0.0, 0.3, 1.0])),
        keep_parts=int(random.choice([1, 2, 5, 40])),
        min_part_mm3=float(random.choice([0.0, 0.2, 0.5, 3.0])),
    )
    turned = AFFINE if random.integers(2) else np.diag([1.0, 1.0, 1.0, 1.0])[[1, 2, 0, 3]]
    assert_same(monkeypatch, Volume(values.astype(np.int16), turned), settings, int(random.integers(1, 5)))


@pytest.mark.parametrize("affine", [AFFINE, np.eye(4)[[2, 0, 1, 3]]])
@pytest.mark.parametrize("limits", [(1, 0.0), (2, 0.0), (5, 0.0), (0, 2.0), (2, 300.0)])
@pytest.mark.parametrize("close", [False, True])
def test_cavities_go_and_stay_with_what_is_around_them(many_slabs, monkeypatch, affine, limits, close):
    keep, smallest = limits
    settings = ReconstructionSettings(threshold=50.0, keep_parts=keep, min_part_mm3=smallest, close_border=close)
    assert assert_same(monkeypatch, Volume(nested(), affine), settings, 2) > 0


@pytest.mark.once
def test_a_cavity_with_nothing_around_it_counts_as_a_component_in_pieces_too(many_slabs, monkeypatch):
    for keep in (1, 3, 6):
        settings = ReconstructionSettings(threshold=50.0, keep_parts=keep)
        assert assert_same(monkeypatch, Volume(100 - nested(), np.eye(4)), settings, 1) > 0


@pytest.mark.parametrize("layers", LAYERS)
@pytest.mark.parametrize("keep", [1, 2, 3])
def test_components_that_meet_in_a_late_slice(many_slabs, monkeypatch, layers, keep):
    volume, settings = Volume(late(), np.eye(4)), ReconstructionSettings(threshold=0.5, keep_parts=keep)
    assert assert_same(monkeypatch, volume, settings, layers) > 0
    assert reconstruct(volume, settings).mesh.components == keep


@pytest.mark.parametrize("layers", LAYERS)
@pytest.mark.parametrize("keep", [1, 2, 5])
def test_of_equal_components_the_first_stay(many_slabs, monkeypatch, layers, keep):
    values = np.zeros((30, 9, 30), np.uint8)
    values[2:29:4, 4, 2:29:4] = 1
    volume, settings = Volume(values, np.eye(4)), ReconstructionSettings(threshold=0.5, keep_parts=keep)
    assert assert_same(monkeypatch, volume, settings, layers) == 8 * keep
    full, kept = reconstruct(volume, ReconstructionSettings(threshold=0.5)).mesh, reconstruct(volume, settings).mesh
    first = full.faces[component_of_face(full) < keep]
    assert np.array_equal(kept.vertices[kept.faces], full.vertices[first])


@pytest.mark.once
def test_a_surface_that_is_simplified_as_it_comes_has_the_same_components(monkeypatch):
    values = nested()
    monkeypatch.setattr(grid, "UNIT_SAMPLES", 2 * values[0].size)
    volume = Volume(values, AFFINE)
    settings = ReconstructionSettings(threshold=50.0, keep_parts=2, close_border=True)
    full = reconstruct(volume, settings).mesh
    budget = Budget(slab_bytes=2 * values[0].nbytes, whole_faces=3000)
    simplified = reconstruct(in_file(volume), replace(settings, reduction=0.5), budget)
    assert simplified.full_faces == len(full.faces) > 3 * 3000
    assert len(simplified.mesh.faces) <= len(full.faces) // 2 + 1
    assert (simplified.mesh.closed, simplified.mesh.components) == (True, full.components)
    assert simplified.mesh.volume == pytest.approx(full.volume, rel=0.02)


@pytest.mark.once
def test_steps_go_forward_and_the_values_can_be_let_go_at_any_time(monkeypatch):
    values = nested()
    monkeypatch.setattr(grid, "UNIT_SAMPLES", 2 * values[0].size)
    budget = Budget(threads=2, slab_bytes=1)
    field = finish(field_steps(in_file(Volume(values, AFFINE)), ReconstructionSettings(threshold=50.0), budget))

    def kept():
        return KeptPieces(lambda _: surface_pieces_steps(field, budget, True), ComponentLimits(2))

    items = list(kept().pieces_steps(1.0))
    fractions = [item.fraction for item in items if isinstance(item, Step) and item.fraction]
    assert fractions == sorted(fractions)
    for count in range(0, len(items), len(items) // 9):
        steps = kept().pieces_steps(1.0)
        for _ in range(count):
            next(steps)
        steps.close()


@pytest.mark.once
def test_bone_of_a_patient(monkeypatch):
    path = SHARED / "ircadb01_abdomen"
    if not path.exists():
        pytest.skip("real CT 'ircadb01_abdomen' is not beside the checkout")
    volume = read_volume(path)
    settings = ReconstructionSettings(threshold=200.0, keep_parts=3, min_part_mm3=10.0)
    assert assert_same(monkeypatch, volume, settings, 16) > 100_000


@pytest.mark.parametrize(
    ("asked", "before", "more"),
    [
        ((1, 0), (0, 0), True),
        ((1, 0), (5, 0), True),
        ((5, 0), (1, 0), False),
        ((0, 2), (0, 1), True),
        ((0, 1), (3, 2), False),
    ],
)
def test_limits_tell_whether_a_surface_may_lose_more(asked, before, more):
    assert ComponentLimits(*asked).ask_more_than(ComponentLimits(*before)) is more


def test_the_largest_component_that_a_refusal_names_is_no_cavity():
    with pytest.raises(MeshError, match="the largest of 2 has 10 mm3"):
        ComponentLimits(0, 50.0).kept(np.array([10.0, -40.0, 5.0]), np.array([0, 0, 2]))


def test_cavities_are_sought_in_more_steps_the_more_rays_there_are(monkeypatch):
    monkeypatch.setattr("ctmc_addon.core.mesh.cavities.PAIRS_PER_STEP", 1)
    surface = boxes(*(((30.0 * at, 0, 0), 20) for at in range(40)), *(((30.0 * at + 5, 5, 5), -8) for at in range(40)))
    steps = keep_components_steps(surface, 1.0, ComponentLimits(0, 600.0))
    titles = []
    kept = finish(steps, lambda step: titles.append(step.message))
    assert len(kept.faces) == 40 * 12
    assert len(titles) > 40
