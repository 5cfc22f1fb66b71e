# SPDX-License-Identifier: GPL-3.0-or-later
import hashlib

import numpy as np
import pytest

from ctmc_addon.core.errors import MemoryLimitError, SettingsError
from ctmc_addon.core.phantom.phantom import LIVER, TUMOUR, phantom


def grid_axes(slices, size, spacing):
    return [(np.arange(n) - (n - 1) / 2) * gap for n, gap in zip((size, size, slices), spacing, strict=True)]


@pytest.mark.parametrize(
    ("slices", "size", "spacing"),
    [
        (3, 64, None),
        (4, 64, None),
        (5, 48, None),
        (11, 64, None),
        (29, 64, None),
        (3, 16, (1.0, 1.0, 80.0)),
        (4, 16, (24.0, 24.0, 80.0)),
        (7, 40, (3.0, 7.0, 40.0)),
        (5, 64, (6.0, 6.0, 0.1)),
    ],
)
def test_every_tumour_is_in_two_neighboring_slices_and_off_the_border(slices, size, spacing):
    for seed in range(8):
        made = phantom(slices, size, spacing, seed)
        tumour = made.labels.values == TUMOUR
        assert len(made.tumour_volumes_mm3) >= 1
        heights = made.labels.affine[2]
        for _, _, z in made.tumour_centres_ras_mm:
            k = int((z - heights[3]) / heights[2])
            near = tumour[max(k - 1, 0) : k + 3].any(axis=(1, 2))
            assert (near[:-1] & near[1:]).any()
        assert not tumour[:, [0, -1]].any()
        assert not tumour[:, :, [0, -1]].any()
        if slices > 3:
            assert not tumour[[0, -1]].any()


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
    made = phantom(slices=9, size=256, seed=0)
    values, labels = made.volume.values, made.labels.values
    assert values.dtype == np.int16
    assert labels.dtype == np.uint8
    assert made.volume.kind == "HU"
    assert np.median(values[:, :20, :20]) == pytest.approx(-1000, abs=2)
    liver = values[labels == LIVER]
    assert np.median(liver) == pytest.approx(115, abs=1)
    assert 10 < np.percentile(liver, 84) - np.median(liver) < 18
    assert 55 <= np.median(values[labels == TUMOUR]) < 70  # the liver shines in at their edges
    assert 400 < values.max() < 1000


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
    assert digest.hexdigest()[:16] == "369e7d51a8d8d378"
    assert (phantom(slices=5, size=64, seed=8).labels.values != made.labels.values).any()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"slices": 2}, "3 slices or more, not 2"),
        ({"size": 8}, "16 rows and columns or more, not 8"),
        ({"seed": -1}, "0 or more, not -1"),
        ({"spacing": (1.0, 0.0, 1.0)}, "above 0 mm"),
    ],
)
def test_an_impossible_grid_is_refused_with_its_limit(wrong, words):
    with pytest.raises(SettingsError, match=words):
        phantom(**wrong)


def test_a_phantom_that_would_not_fit_is_refused_before_it_is_made():
    with pytest.raises(MemoryLimitError, match="make it smaller"):
        phantom(slices=10**9)
