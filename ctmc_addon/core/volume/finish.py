# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose how the surface of a structure looks, bone, vessel or organ, by its anatomical name."""

from __future__ import annotations

from functools import cache

from .labels.anatomy import anatomy_of

# One name of every row of the table of anatomy.
_BONES = (
    "skull", "mandible", "tooth", "bone", "vertebra", "sacrum", "rib", "sternum", "clavicle", "scapula", "humerus",
    "ulna", "patella", "phalanx", "hip", "femur", "vertebrae L1", "vertebrae L2", "stone",
)  # fmt: skip
_VESSELS = (
    "aorta", "artery", "brachiocephalic trunk", "subclavian artery", "carotid artery", "coronary artery", "vein",
    "vena cava", "superior vena cava", "portal vein", "iliac vein", "pulmonary artery", "pulmonary vein", "bile duct",
    "gallbladder",
)  # fmt: skip


def finish_of(label: int | None, name: str = "") -> str:
    """Return the appearance of a structure.

    Parameters
    ----------
    label : int or None
        Its number; None for a surface by threshold, which is of bone.
    name : str
        Name of the structure.

    Returns
    -------
    {"bone", "vessel", "organ"}
        The last for names that are not known.

    Examples
    --------
    >>> [finish_of(1, name) for name in ("rib_left_7", "Pfortader", "liver", "structure 3")], finish_of(None)
    (['bone', 'vessel', 'organ', 'organ'], 'bone')
    """
    anatomy = anatomy_of(name)
    if label is None:
        return "bone"
    return _finishes().get(anatomy.rgb, "organ") if anatomy is not None else "organ"


@cache
def _finishes() -> dict[tuple[int, int, int], str]:
    """Finishes of the table's bones and vessels, by their colors."""
    return {
        anatomy.rgb: finish
        for finish, names in (("bone", _BONES), ("vessel", _VESSELS))
        for anatomy in map(anatomy_of, names)
        if anatomy is not None
    }
