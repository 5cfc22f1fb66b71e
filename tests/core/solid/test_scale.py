# SPDX-License-Identifier: GPL-3.0-or-later
"""A solid of microns is made as one of meters is: the same triangles at another scale, and the same notes."""

import functools
import re

import numpy as np
import pytest

from ctmc_addon.core import ReconstructionSettings, SettingsError, Volume
from ctmc_addon.core.solid import Bar, Cut, Drain, Pegs, SolidRequest, solid_parts

pytestmark = pytest.mark.once

SIZE = 24
NUMBER = re.compile(r"-?\d+(\.\d+)?(e-?\d+)?")
POINT = (11.3, 12.1, 11.7)


def volume(scale):
    """Two balls with a neck, and a thin fin, in samples of `scale` mm."""
    at = np.indices((SIZE,) * 3)[::-1].reshape(3, -1).astype(float)
    balls = np.maximum(
        7.3 - np.linalg.norm(at - [[9.2], [11.3], [9.4]], axis=0),
        5.1 - np.linalg.norm(at - [[16.1], [13.2], [16.7]], axis=0),
    )
    depth = np.maximum(balls, Bar((3.1, 5.2, 15.3), (9.3, 11.4, 15.6), 1.4).at(at))
    return Volume((scale * depth).astype(np.float32).reshape((SIZE,) * 3), np.diag([scale] * 3 + [1.0]), name="part")


def request(kind, scale):
    cut = Cut(tuple(scale * np.array(POINT)), (1, 2, 3))
    level = Cut(tuple(scale * np.array(POINT)), (0, 0.2, 1))
    return {
        "thicken": lambda: SolidRequest(thicken=1.3 * scale),
        "drains": lambda: SolidRequest(hollow=1.7 * scale, drains=(Drain(2.2 * scale),)),
        "drain": lambda: SolidRequest(hollow=1.7 * scale, drains=(Drain(2.2 * scale, (9.3 * scale,) * 3),)),
        "pegs": lambda: SolidRequest(cuts=(cut,), pegs=Pegs(3, 2.2 * scale, 2.4 * scale, 0.2 * scale)),
        "base": lambda: SolidRequest(cuts=(level,), base=1.6 * scale),
        "wall": lambda: SolidRequest(least_wall=3.1 * scale),
        "too thick": lambda: SolidRequest(hollow=8.0 * scale, drains=(Drain(2.2 * scale),)),
        "outside": lambda: SolidRequest(hollow=1.7 * scale, drains=(Drain(2.2 * scale, (2.3 * scale,) * 3),)),
        "large pegs": lambda: SolidRequest(cuts=(cut,), pegs=Pegs(2, 14.0 * scale, 9.0 * scale, 0.2 * scale)),
        "missed": lambda: SolidRequest(cuts=(Cut((0.0, 0.0, 40.0 * scale), (0.1, 0, 1)),)),
    }[kind]()


@functools.cache
def plain(kind):
    return made(kind, 1.0)


def made(kind, scale):
    return solid_parts(volume(scale), ReconstructionSettings(threshold=0.0), request(kind, scale))


def turned(faces):
    """Triangles in any order, each with its lowest corner first: what is cut may begin elsewhere."""
    first = faces.argmin(axis=1)[:, None]
    return set(map(tuple, np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1).tolist()))


@pytest.mark.parametrize("scale", [0.01, 10.0])
@pytest.mark.parametrize("kind", ["thicken", "drains", "drain", "pegs", "base", "wall"])
def test_a_scaled_form_gives_the_same_parts_scaled(kind, scale):
    unscaled, scaled = plain(kind), made(kind, scale)
    assert [part.label_name for part in unscaled] == [part.label_name for part in scaled]
    for one, other in zip(unscaled, scaled, strict=True):
        assert [NUMBER.sub("#", note) for note in one.notes] == [NUMBER.sub("#", note) for note in other.notes]
        assert turned(one.mesh.faces) == turned(other.mesh.faces)
        np.testing.assert_allclose(other.mesh.vertices / scale, one.mesh.vertices, atol=2e-3)


@pytest.mark.parametrize("scale", [0.01, 10.0])
@pytest.mark.parametrize("kind", ["too thick", "outside", "large pegs", "missed"])
def test_a_scaled_form_is_refused_with_the_same_numbers_scaled(kind, scale):
    texts = []
    for each in (1.0, scale):
        with pytest.raises(SettingsError) as refused:
            made(kind, each)
        texts.append(str(refused.value))
    assert NUMBER.sub("#", texts[0]) == NUMBER.sub("#", texts[1])
    numbers = ([float(found[0]) for found in NUMBER.finditer(text)] for text in texts)
    for one, other in zip(*numbers, strict=True):  # Directions and counts stay.
        assert other == pytest.approx(one * scale, rel=0.02, abs=0.06 * scale) or other == one
