# SPDX-License-Identifier: GPL-3.0-or-later
"""Components of a label at two times: balls of known volume on grids of any orientation, and an oracle of loops."""

import math
from itertools import product

import numpy as np
import pytest

from ctmc_addon.core import (
    AbsentLabelError,
    Budget,
    ChangeLimits,
    LabelError,
    ReconstructionSettings,
    SettingsError,
    Volume,
    VolumeError,
    change_csv,
    compare_labels,
    finish,
    reconstruct,
)
from ctmc_addon.core.change.components import measured_label_steps
from ctmc_addon.core.change.matching import matches_steps
from ctmc_addon.core.volume import to_index, transform_points

DAYS = 90
STRAIGHT = np.diag([1.0, 1.0, 1.0, 1.0])
MIRRORED = np.array([[-0.8, 0, 0, 79], [0, 0.8, 0, 0], [0, 0, 1.2, 0], [0, 0, 0, 1.0]])
TURNED = np.array([[0, 0, 1.25, 0], [0.9, 0, 0, 0], [0, -0.7, 0, 59], [0, 0, 0, 1.0]])
TILTED = np.array([[0.9, -0.1, 0, -2], [0.1, 0.9, 0.1, -8], [0, -0.1, 1.1, 2], [0, 0, 0, 1.0]])
GRIDS = {
    "straight": (STRAIGHT, (60, 60, 80)),
    "mirrored": (MIRRORED, (50, 75, 100)),
    "turned": (TURNED, (64, 85, 67)),
    "tilted": (TILTED, (60, 80, 100)),
}
# Centers and radii, mm. Between samples, a ball has nearly the volume of its samples.
GROWN, GONE, STABLE = ((15.31, 15.17, 15.43), 6), ((40.31, 15.17, 15.43), 6), ((65.31, 15.17, 15.43), 7)
LEFT, RIGHT, BRIDGE = ((15.31, 45.17, 15.43), 5), ((26.31, 45.17, 15.43), 5), ((20.81, 45.17, 15.43), 4)
LARGE, NEW = ((60.31, 45.17, 35.43), 8), ((30.31, 30.17, 45.43), 6)
SPLIT, PIECES = ((55.31, 15.17, 45.43), 8), (((49.31, 15.17, 45.43), 3), ((61.31, 15.17, 45.43), 4))
BEFORE = (GROWN, GONE, STABLE, LEFT, RIGHT, LARGE, SPLIT)
AFTER = ((GROWN[0], 9), STABLE, LEFT, RIGHT, BRIDGE, (LARGE[0], 5), NEW, *PIECES)


def balls(these, affine=STRAIGHT, shape=(60, 60, 80), label=1, **about):
    """A label volume in which balls are labeled; centers and radii in mm."""
    z, y, x = np.indices(shape)
    points = transform_points(affine, np.stack([x, y, z], -1).reshape(-1, 3))
    values = np.zeros(len(points), np.uint8)
    for center, radius in these:
        values[((points - center) ** 2).sum(axis=1) < radius**2] = label
    return Volume(values.reshape(shape), affine, kind="label", **about)


def ball_mm3(*radii):
    return sum(4 / 3 * math.pi * radius**3 for radius in radii)


def near(rows, center):
    """The row of the component at a position."""
    return min(rows, key=lambda row: sum((a - b) ** 2 for a, b in zip(row.center_mm, center, strict=True)))


def statuses(changes):
    return sorted(str(row.status) for row in changes.rows)


def numbers(changes):
    return change_csv(changes.rows)


PAIRS = [pytest.param(pair, marks=() if pair[0] == pair[1] else pytest.mark.once) for pair in product(GRIDS, GRIDS)]


@pytest.fixture(scope="module", params=PAIRS, ids="-".join)
def changes(request):
    """Seven components on a grid before, and what became of them on another one."""
    first, last = (GRIDS[name] for name in request.param)
    return compare_labels(balls(BEFORE, *first), balls(AFTER, *last), days=DAYS)


def test_every_status_is_found_on_any_two_grids(changes):
    assert statuses(changes) == ["gone", "grown", "merged", "new", "shrunk", "split", "stable"]
    rows = {str(row.status): row for row in changes.rows}
    for status, (center, _) in (("grown", GROWN), ("gone", GONE), ("stable", STABLE), ("new", NEW), ("shrunk", LARGE)):
        assert rows[status].center_mm == pytest.approx(center, abs=0.15)
    assert [len(rows["merged"].before), len(rows["merged"].after)] == [2, 1]
    assert [len(rows["split"].before), len(rows["split"].after)] == [1, 2]


def test_volumes_percents_diameters_and_doubling_times_are_those_of_balls(changes):
    rows = {str(row.status): row for row in changes.rows}
    for status, before, after in (
        ("grown", [6], [9]),
        ("gone", [6], []),
        ("stable", [7], [7]),
        ("new", [], [6]),
        ("shrunk", [8], [5]),
        ("split", [8], [3, 4]),
    ):
        row = rows[status]
        # Of a ball of 5 mm the voxels are 2 % more or less.
        assert row.volume_before_mm3 == pytest.approx(ball_mm3(*before), rel=0.025)
        assert row.volume_after_mm3 == pytest.approx(ball_mm3(*after), rel=0.025)
        assert row.diameter_before_mm == pytest.approx(2 * max(before, default=0), abs=0.6)
        assert row.diameter_after_mm == pytest.approx(2 * max(after, default=0), abs=0.6)
    grown = rows["grown"]
    assert grown.percent == pytest.approx((1.5**3 - 1) * 100, rel=0.02)
    assert grown.doubling_time_days == pytest.approx(DAYS * math.log(2) / math.log(1.5**3), rel=0.02)
    assert rows["shrunk"].percent == pytest.approx(((5 / 8) ** 3 - 1) * 100, rel=0.02)
    assert (rows["gone"].percent, rows["new"].percent) == (-100, None)
    assert [rows[each].doubling_time_days for each in ("gone", "new", "shrunk", "split")] == [None] * 4


def test_the_rows_are_all_of_both_surfaces(changes):
    [label] = changes.labels
    assert sum(row.volume_before_mm3 for row in changes.rows) == pytest.approx(label.before.mesh.volume, rel=1e-6)
    assert sum(row.volume_after_mm3 for row in changes.rows) == pytest.approx(label.after.mesh.volume, rel=1e-6)
    numbers_after = sorted(each.number for row in changes.rows for each in row.after)
    assert numbers_after == list(range(1, 8))


def test_backwards_what_merged_is_split_and_what_is_new_is_gone():
    before, after = balls(BEFORE), balls(AFTER, MIRRORED, (50, 75, 100))
    back = compare_labels(after, before, days=DAYS)
    other = {"gone": "new", "new": "gone", "grown": "shrunk", "shrunk": "grown", "merged": "split", "split": "merged"}
    forth = compare_labels(before, after, days=DAYS)
    for row in forth.rows:
        assert near(back.rows, row.center_mm).status == other.get(row.status, row.status) or row.status == "stable"
    assert statuses(back) == statuses(forth)


def test_the_same_volume_twice_is_stable_and_has_no_doubling_time():
    volume = balls(BEFORE)
    changes = compare_labels(volume, volume, days=DAYS)
    assert statuses(changes) == ["stable"] * 7
    assert {row.percent for row in changes.rows} == {0.0}
    assert {row.doubling_time_days for row in changes.rows} == {None}


def test_threads_change_no_byte():
    volumes = balls(BEFORE), balls(AFTER, TILTED, (60, 80, 100))
    assert len({numbers(compare_labels(*volumes, budget=Budget(threads=count))) for count in (1, 3)}) == 1


def test_limits_decide_what_has_grown():
    volumes = balls([((15, 15, 15), 6)], shape=(30, 30, 30)), balls([((15, 15, 15), 6.6)], shape=(30, 30, 30))
    [row] = compare_labels(*volumes).rows
    assert row.status == "grown"
    change = row.percent
    assert 25 < change < 40
    for limits, status in (
        (ChangeLimits(percent=change + 0.01), "stable"),
        (ChangeLimits(percent=change - 0.01), "grown"),
        (ChangeLimits(voxels=400), "stable"),
    ):
        changed = compare_labels(*volumes, limits=limits)
        assert changed.rows[0].status == status
        assert changed.notes[0] == limits.sentence


def test_a_few_voxels_are_no_change():
    first, last = np.zeros((8, 8, 8), np.uint8), np.zeros((8, 8, 8), np.uint8)
    first[3:5, 3:5, 3:5] = last[3:5, 3:5, 3:7] = 1
    volumes = [Volume(values, STRAIGHT, kind="label") for values in (first, last)]
    [row] = compare_labels(*volumes).rows
    assert row.percent == pytest.approx(100, abs=3)
    assert row.status == "stable"
    assert compare_labels(*volumes, limits=ChangeLimits(voxels=7)).rows[0].status == "grown"


def boxes(*corners, shape=(12, 12, 40), affine=STRAIGHT, label=1):
    values = np.zeros(shape, np.uint8)
    for low, high in corners:
        values[low[2] : high[2], low[1] : high[1], low[0] : high[0]] = label
    return Volume(values, affine, kind="label")


def test_a_small_overlap_by_chance_links_nothing():
    before = boxes(((2, 2, 2), (10, 10, 10)), ((20, 2, 2), (28, 10, 10)))
    after = boxes(
        ((2, 2, 2), (10, 10, 10)), ((10, 4, 4), (18, 5, 5)), ((18, 4, 4), (21, 5, 5)), ((21, 2, 2), (28, 10, 10))
    )
    apart = boxes(((2, 2, 2), (9, 10, 10)), ((8, 2, 2), (21, 4, 4)), ((24, 2, 2), (30, 10, 10)))
    assert statuses(compare_labels(before, after)) == ["merged"]
    assert statuses(compare_labels(before, apart)) == ["stable", "stable"]  # 4 of 448 voxels of the right one
    assert statuses(compare_labels(before, apart, limits=ChangeLimits(overlap_percent=0))) == ["merged"]


def test_a_component_between_the_samples_of_a_coarse_grid_is_found():
    coarse = np.array([[8.0, 0, 0, 4], [0, 8, 0, 4], [0, 0, 8, 4], [0, 0, 0, 1]])
    values = np.zeros((4, 4, 4), np.uint8)
    values[1, 1, 1] = 1
    before, after = balls([((9.5, 9.5, 9.5), 1.4)], shape=(32, 32, 32)), Volume(values, coarse, kind="label")
    for volumes in ((before, after), (after, before)):
        [row] = compare_labels(*volumes).rows
        assert row.before
        assert row.after


def test_components_too_small_for_a_surface_have_the_volume_of_their_voxels():
    volume = boxes(((2, 2, 2), (10, 10, 10)), ((21, 5, 5), (22, 6, 6)))
    changes = compare_labels(volume, volume, ReconstructionSettings(stride=2, smoothing="none"))
    small = changes.rows[1]
    assert (small.volume_before_mm3, small.diameter_before_mm, small.status) == (1.0, None, "stable")
    assert any("Component 2 of label 1 before: too small for a surface" in note for note in changes.notes)


def test_a_component_at_the_border_has_the_volume_of_its_voxels_until_it_is_closed():
    volume = boxes(((0, 2, 2), (10, 10, 10)))
    opened = compare_labels(volume, volume)
    assert opened.rows[0].volume_after_mm3 == 640
    assert any("open at the border" in note and "close_border" in note for note in opened.notes)
    closed = compare_labels(volume, volume, ReconstructionSettings(close_border=True))
    assert closed.rows[0].volume_after_mm3 == pytest.approx(640, rel=1e-3)
    assert not any("open" in note for note in closed.notes)


def test_a_cavity_is_not_part_of_the_volume():
    values = balls([((15, 15, 15), 9)], shape=(30, 30, 30)).values.copy()
    values[12:19, 12:19, 12:19] = 0
    volume = Volume(values, STRAIGHT, kind="label")
    [row] = compare_labels(volume, volume).rows
    assert row.volume_after_mm3 == pytest.approx(values.sum(), rel=2e-3)
    assert row.diameter_after_mm == pytest.approx(18, abs=0.4)


def test_what_a_gaussian_joins_is_one_component():
    volume = boxes(((4, 2, 2), (12, 10, 10)), ((13, 2, 2), (21, 10, 10)))
    assert len(compare_labels(volume, volume).rows) == 2
    settings = ReconstructionSettings(smoothing="gaussian", smoothing_mm=1.5)
    [row] = compare_labels(volume, volume, settings).rows
    assert row.volume_after_mm3 == pytest.approx(reconstruct(volume, settings_of(settings)).mesh.volume, rel=1e-6)


def settings_of(settings):
    return ReconstructionSettings(**settings.to_dict() | {"label": 1})


def test_small_components_that_the_settings_drop_have_no_row():
    volume = boxes(((2, 2, 2), (10, 10, 10)), ((20, 5, 5), (22, 6, 6)))
    changes = compare_labels(volume, volume, ReconstructionSettings(min_part_mm3=20))
    assert len(changes.rows) == 1
    assert "1 small components of label 1 after are dropped, as the settings ask." in changes.notes


def test_a_component_outside_the_other_field_of_view_is_not_gone():
    before = balls([GROWN, STABLE])
    after = before.cropped((0, 0, 0), (40, 60, 60))
    changes = compare_labels(before, after)
    outside = near(changes.rows, STABLE[0])
    assert (outside.status, outside.volume_after_mm3, outside.percent) == ("outside", None, None)
    assert "label 1: 1 outside, where the other volume has no samples." in changes.notes
    assert near(compare_labels(after, before).rows, STABLE[0]).status == "outside"


def test_volumes_that_lie_apart_are_refused_with_the_numbers():
    moved = STRAIGHT.copy()
    moved[0, 3] = 200
    with pytest.raises(VolumeError, match=r"lie 121 mm apart \(before: x 0 to 79.*after: x 200 to 279.*register"):
        compare_labels(balls([GROWN]), balls([GROWN], moved, (60, 60, 80)))


def test_labels_without_any_overlap_are_noted_with_their_distance():
    changes = compare_labels(balls([GROWN]), balls([GONE]))
    assert statuses(changes) == ["gone", "new"]
    assert any("the nearest centers are 25 mm apart" in note for note in changes.notes)


def test_a_name_is_the_same_structure_whatever_its_numbers():
    before = balls([GROWN], label=2, label_names={2: "Liver_Tumor", 1: "liver"})
    after = balls([(GROWN[0], 9)], label=5, label_names={5: "liver tumor", 2: "spleen"})
    for labels in (["liver tumor"], None):
        [row] = compare_labels(before, after, labels=labels).rows
        assert (row.name, row.label, row.status) == ("liver tumor", 5, "grown")
    assert statuses(compare_labels(before, after, labels=[2, 5])) == ["gone", "new"]


def test_a_name_in_one_volume_means_its_number_in_one_without_names():
    before, after = balls([GROWN], label=2), balls([GROWN], label=2, label_names={2: "tumor"})
    [row] = compare_labels(before, after, labels=["tumor"]).rows
    assert (row.name, row.status) == ("tumor", "stable")
    with pytest.raises(LabelError, match="have no names"):
        compare_labels(before, before, labels=["tumor"])


def test_all_labels_are_compared_one_after_the_other():
    values = balls([GROWN]).values + balls([LARGE], label=3).values
    before, after = (Volume(each, STRAIGHT, kind="label") for each in (values, balls([LARGE], label=3).values))
    changes = compare_labels(before, after)
    assert [(row.label, str(row.status)) for row in changes.rows] == [(3, "stable"), (1, "gone")]
    assert [label.after is None for label in changes.labels] == [False, True]


def test_a_label_that_a_volume_lacks_is_new_or_gone_and_one_that_both_lack_is_refused():
    empty = balls([])
    assert statuses(compare_labels(empty, balls([NEW]))) == ["new"]
    assert statuses(compare_labels(balls([NEW]), empty, labels=[1])) == ["gone"]
    for labels, sentence in (([7], "no voxel has the label 7; before, the labels are 1; after"), (["all"], "neither")):
        volume = balls([NEW], name="one") if labels == [7] else empty
        with pytest.raises(AbsentLabelError, match=sentence):
            compare_labels(volume, volume, labels=labels)


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ({"days": 0}, "days must be above 0, not 0"),
        ({"days": math.inf}, "days must be above 0"),
        ({"settings": ReconstructionSettings(threshold=1)}, "compared by their labels"),
        ({"settings": ReconstructionSettings(region=(0, 0, 0, 9, 9, 9))}, "set region_unit mm"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(more, sentence):
    with pytest.raises(SettingsError, match=sentence):
        compare_labels(balls([GROWN]), balls([GROWN], MIRRORED, (50, 75, 100)), **more)


def test_a_region_in_mm_limits_what_is_compared():
    settings = ReconstructionSettings(region=(0, 0, 0, 30, 30, 30), region_unit="mm", close_border=True)
    changes = compare_labels(balls(BEFORE), balls(AFTER, MIRRORED, (50, 75, 100)), settings)
    assert statuses(changes) == ["grown"]


def test_the_later_surface_carries_its_distance_to_the_earlier_one():
    changes = compare_labels(balls([GROWN]), balls([(GROWN[0], 9), NEW], MIRRORED, (50, 75, 100)))
    [label] = changes.labels
    [values] = label.after.maps
    assert values.name == "distance_earlier_mm"
    assert len(values.values) == len(label.after.mesh.vertices)
    grown, new = changes.rows
    assert grown.distance_mm == pytest.approx((3, 3), abs=0.8)
    apart = math.dist(GROWN[0], NEW[0])
    assert new.distance_mm == pytest.approx((apart - 12, apart), abs=0.8)
    backwards = compare_labels(balls([(GROWN[0], 6)]), balls([(GROWN[0], 4)])).rows[0]
    assert backwards.distance_mm == pytest.approx((-2, -2), abs=0.8)


def groups_by_loops(before, after):
    """Groups of components, as sets of samples: each sample looked up in the other volume, both ways."""
    sides = [flooded(volume.values) for volume in (before, after)]
    links = set()
    for at, (own, other) in enumerate(((before, after), (after, before))):
        for sample, number in sides[at].items():
            position = transform_points(own.affine, np.array([sample[::-1]]))
            x, y, z = np.floor(to_index(other.affine, position)[0] + 0.5).astype(int).tolist()
            if (z, y, x) in sides[1 - at]:
                pair = (number, sides[1 - at][z, y, x])
                links.add(pair if at == 0 else pair[::-1])
    groups = {frozenset([(side, number)]) for side in (0, 1) for number in set(sides[side].values())}
    for first, last in links:
        joined = [group for group in groups if (0, first) in group or (1, last) in group]
        groups = {group for group in groups if group not in joined} | {frozenset().union(*joined)}
    samples = [
        {number: frozenset(at for at, own in side.items() if own == number) for number in side.values()}
        for side in sides
    ]
    return {frozenset((side, samples[side][number]) for side, number in group) for group in groups}


def flooded(values):
    """Number of the component of every sample that is set, by its first sample."""
    numbers = {}
    for start in zip(*np.nonzero(values), strict=True):
        waiting = [tuple(map(int, start))]
        while waiting:
            z, y, x = at = waiting.pop()
            if at in numbers or not all(0 <= a < n for a, n in zip(at, values.shape, strict=True)) or not values[at]:
                continue
            numbers[at] = tuple(map(int, start))
            waiting += [(z - 1, y, x), (z + 1, y, x), (z, y - 1, x), (z, y + 1, x), (z, y, x - 1), (z, y, x + 1)]
    return numbers


@pytest.mark.parametrize("seed", range(8))
def test_groups_equal_those_of_loops(seed):
    rng = np.random.default_rng(seed)
    affines = [
        STRAIGHT,
        np.diag([-1.3, 0.9, 1.7, 1.0]) + rng.uniform(-0.1, 0.1, (4, 4)) * np.array([[1], [1], [1], [0]]),
    ]
    affines[1][0, 3] += 8
    volumes = [Volume((rng.random((6, 7, 9)) < 0.2).astype(np.uint8), affine, kind="label") for affine in affines]
    box = ((0, 9), (0, 7), (0, 6))
    measured = [finish(measured_label_steps(volume, 1, box, None)) for volume in volumes]
    matches = finish(matches_steps(*measured, 0.0))
    samples = []
    for label in measured:
        z, y, x, number = label.runs.samples(np.ones(len(label.components), bool))
        samples.append(
            [
                frozenset(
                    zip(z[number == at].tolist(), y[number == at].tolist(), x[number == at].tolist(), strict=True)
                )
                for at in range(len(label.components))
            ]
        )
    found = {
        frozenset([(0, samples[0][at]) for at in first] + [(1, samples[1][at]) for at in last])
        for first, last in matches.groups
    }
    assert found == groups_by_loops(*volumes)
