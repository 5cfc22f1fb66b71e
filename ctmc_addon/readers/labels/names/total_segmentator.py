# SPDX-License-Identifier: GPL-3.0-or-later
"""Name the labels of TotalSegmentator's task `total`, version 2, by their numbers.

Wasserthal et al. 2023, doi:10.1148/ryai.230024; github.com/wasserth/TotalSegmentator has the numbers.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

VERTEBRAE = ["S1", *(f"L{n}" for n in range(5, 0, -1)), *(f"T{n}" for n in range(12, 0, -1))]
VERTEBRAE += [f"C{n}" for n in range(7, 0, -1)]


def _names_in_order() -> Iterator[str]:
    """Yield the names of the labels 1 to 117."""

    def pairs(first: str, second: str, *names: str) -> Iterator[str]:
        for name in names:
            yield f"{name}_{first}"
            yield f"{name}_{second}"

    yield "spleen"
    yield from pairs("right", "left", "kidney")
    yield from ("gallbladder", "liver", "stomach", "pancreas")
    yield from pairs("right", "left", "adrenal_gland")
    yield from pairs("upper_lobe_left", "lower_lobe_left", "lung")
    yield from (f"lung_{lobe}_lobe_right" for lobe in ("upper", "middle", "lower"))
    yield from ("esophagus", "trachea", "thyroid_gland", "small_bowel", "duodenum", "colon", "urinary_bladder")
    yield "prostate"
    yield from pairs("left", "right", "kidney_cyst")
    yield "sacrum"
    yield from (f"vertebrae_{vertebra}" for vertebra in VERTEBRAE)
    yield from ("heart", "aorta", "pulmonary_vein", "brachiocephalic_trunk")
    yield from pairs("right", "left", "subclavian_artery", "common_carotid_artery")
    yield from pairs("left", "right", "brachiocephalic_vein")
    yield from ("atrial_appendage_left", "superior_vena_cava", "inferior_vena_cava", "portal_vein_and_splenic_vein")
    yield from pairs("left", "right", "iliac_artery", "iliac_vena", "humerus", "scapula", "clavicula", "femur", "hip")
    yield "spinal_cord"
    yield from pairs("left", "right", "gluteus_maximus", "gluteus_medius", "gluteus_minimus", "autochthon", "iliopsoas")
    yield from ("brain", "skull")
    yield from (f"rib_{side}_{number}" for side in ("left", "right") for number in range(1, 13))
    yield from ("sternum", "costal_cartilages")


NAMES = dict(enumerate(_names_in_order(), 1))


def is_total_segmentator(name: str) -> bool:
    """Return whether a file's stem says that TotalSegmentator made it.

    Examples
    --------
    >>> is_total_segmentator("case-7_TotalSegmentator"), is_total_segmentator("total_seg"), is_total_segmentator("seg")
    (True, True, False)
    """
    return "totalseg" in re.sub(r"[^a-z]", "", name.lower())
