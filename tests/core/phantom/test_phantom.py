# SPDX-License-Identifier: GPL-3.0-or-later
import hashlib

import numpy as np
import pytest

from ctmc_addon.core.errors import MemoryLimitError, SettingsError
from ctmc_addon.core.phantom.phantom import LIVER, MUSCLE, RIB, TUMOR, Background, centered, phantom


def grid_axes(slices, size, spacing):
    return [(np.arange(n) - (n - 1) / 2) * gap for n, gap in zip((size, size, slices), spacing, strict=True)]


@pytest.mark.parametrize(
    ("slices", "size", "spacing"),
    [
        (3, 64, None),
        (4, 64, None),
        (5, 48, None),
        (11, 64, None),
        pytest.param(29, 64, None, marks=pytest.mark.once),
        (3, 16, (1.0, 1.0, 80.0)),
        (4, 16, (24.0, 24.0, 80.0)),
        (7, 40, (3.0, 7.0, 40.0)),
        (5, 64, (6.0, 6.0, 0.1)),
    ],
)
def test_every_tumor_is_in_two_neighboring_slices_and_off_the_border(slices, size, spacing):
    for seed in range(8):
        made = phantom(slices, size, spacing, seed)
        tumor = made.labels.values == TUMOR
        assert len(made.tumour_volumes_mm3) >= 1
        heights = made.labels.affine[2]
        for _, _, z in made.tumour_centres_ras_mm:
            k = int((z - heights[3]) / heights[2])
            near = tumor[max(k - 1, 0) : k + 3].any(axis=(1, 2))
            assert (near[:-1] & near[1:]).any()
        assert not tumor[:, [0, -1]].any()
        assert not tumor[:, :, [0, -1]].any()
        if slices > 3:
            assert not tumor[[0, -1]].any()


def test_counted_voxels_come_near_the_true_volumes():
    made = phantom(slices=100, size=256, seed=3)
    assert made.counted_mm3() == pytest.approx(sum(made.tumour_volumes_mm3), rel=2e-3)
    assert made.counted_mm3(LIVER) + made.counted_mm3() == pytest.approx(made.liver_volume_mm3, rel=2e-3)


def test_the_liver_counts_only_as_far_as_the_stack_reaches():
    made = phantom(slices=6, size=256, seed=1)
    assert made.counted_mm3(LIVER) + made.counted_mm3() == pytest.approx(made.liver_volume_mm3, rel=1e-2)


def test_the_truth_does_not_depend_on_the_pixels():
    coarse, fine = phantom(size=128, seed=2), phantom(size=256, seed=2)
    assert coarse.tumour_volumes_mm3 == pytest.approx(fine.tumour_volumes_mm3, rel=1e-9)
    assert list(coarse.tumour_volumes_mm3) == sorted(coarse.tumour_volumes_mm3, reverse=True)


def test_tissues_have_their_hounsfield_units_and_the_noise_is_about_14():
    made = phantom(slices=9, size=256, spacing=(1.48, 1.48, 2.0))  # thin, so that few voxels are cut
    values, labels = made.volume.values, made.labels.values
    assert values.dtype == np.int16
    assert labels.dtype == np.uint8
    assert made.volume.kind == "HU"
    assert np.median(values[:, :20, :20]) == pytest.approx(-1000, abs=2)
    liver = values[labels == LIVER]
    assert np.median(liver) == pytest.approx(115, abs=1)
    assert 10 < np.percentile(liver, 84) - np.median(liver) < 18
    assert 55 <= np.median(values[labels == TUMOR]) < 70  # the liver shines in at their edges
    assert 400 < values.max() < 1000


@pytest.mark.parametrize(("z", "share"), [(0.0, 1.0), (5.6, 0.5), (6.6, 0.3), (8.1, 0.0), (22.4, 0.5), (28.0, 1.0)])
def test_the_edge_of_a_rib_gives_a_slice_the_part_that_it_covers(z, share):
    # Level with the middle a rib reaches from -5.6 to 5.6 mm, and the next begins at 22.4 mm; slices of 5 mm.
    background = Background(np.array([-138.0, 0.0]), np.array([0.0]), 1.0)
    assert background.in_slice(z, 5.0)[0, 0] == pytest.approx(MUSCLE + share * (RIB - MUSCLE), abs=1e-9)


@pytest.mark.parametrize("z", [-21.0, 0.0, 3.0, 9.5, 37.0])
def test_a_slice_is_the_mean_of_its_halves(z):
    background = Background(centered(96, 4.0), centered(96, 4.0), 1.0)
    whole, below, above = (background.in_slice(z + at, mm) for at, mm in ((0, 10.0), (-2.5, 5.0), (2.5, 5.0)))
    assert whole == pytest.approx((below + above) / 2, abs=1e-9)
    assert (below != above).any()


def test_a_thick_slice_is_the_mean_of_the_thin_ones_in_it_but_for_noise():
    thick, thin = (phantom(slices, 64, (5.92, 5.92, gap)) for slices, gap in ((7, 15.0), (105, 1.0)))
    rest = thick.volume.values - thin.volume.values.reshape(7, 15, 64, 64).mean(axis=1)
    # The noise of a slice, whose deviation is 13.96 HU, and that of a mean of 15; of slices at a height it was 18.7.
    assert rest.std() == pytest.approx(13.96 * np.sqrt(16 / 15), abs=0.3)
    liver = [made.labels.values > 0 for made in (thick, thin)]
    assert (liver[0] == liver[1][7::15]).all()  # a label is that of the voxel's center


def test_the_axes_run_to_the_left_the_back_and_the_head_about_the_origin():
    made = phantom(slices=4, size=32, spacing=(2.0, 3.0, 4.0))
    assert made.volume.orientation == "LPS"
    assert made.volume.spacing == (2.0, 3.0, 4.0)
    middle = made.volume.affine @ [15.5, 15.5, 1.5, 1.0]
    assert middle.tolist() == [0, 0, 0, 1]
    # The liver is on the patient's right, which is RAS +x.
    assert all(x > -60 for x, _, _ in made.tumour_centres_ras_mm)
    _, _, columns = np.nonzero(made.labels.values == LIVER)
    assert columns.mean() < 15.5


def test_a_seed_always_gives_the_same_bytes():
    made = phantom(slices=5, size=64, seed=7)
    digest = hashlib.sha256(
        made.volume.values.astype("<i2").tobytes()
        + made.labels.values.tobytes()
        + repr(made.tumour_volumes_mm3).encode()
    )
    assert digest.hexdigest()[:16] == "9921bf2e0774e641"
    assert (phantom(slices=5, size=64, seed=8).labels.values != made.labels.values).any()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"slices": 2}, "3 slices or more, not 2"),
        ({"size": 8}, "16 rows and columns or more, not 8"),
        ({"seed": -1}, "0 or more, not -1"),
        ({"spacing": (1.0, 0.0, 1.0)}, "from 1e-06 to 10000 mm"),
    ],
)
def test_an_impossible_grid_is_refused_with_its_limit(wrong, words):
    with pytest.raises(SettingsError, match=words):
        phantom(**wrong)


def test_a_phantom_that_would_not_fit_is_refused_before_it_is_made():
    with pytest.raises(MemoryLimitError, match="make it smaller"):
        phantom(slices=10**9)
