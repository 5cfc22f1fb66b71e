# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps are made on finished surfaces, by quantities that know nothing of one another."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest

from ctmc_addon.core import (
    PAUSE,
    SIMPLIFICATION,
    Place,
    ReconstructionSettings,
    SettingsError,
    SurfaceRequest,
    Volume,
    finish,
    make_surfaces_steps,
    maps_of,
    measures_in,
    reconstruct,
    reconstruct_labels,
)
from ctmc_addon.core.maps.quantity import MapValues, Quantity
from ctmc_addon.core.maps.request import TAKEN, MapRequest
from ctmc_addon.core.maps.surface_map import Limits, range_of, statistics_of, vertex_areas


@dataclass(frozen=True)
class Height(Quantity):
    """Height of a vertex above z = 0, NaN below `from_mm`."""

    flag, text, label = "height", "height of the vertex", "Height"
    from_mm: float = -np.inf

    @property
    def name(self):
        return "height_mm"

    def values_steps(self, surface):
        yield PAUSE
        heights = surface.mesh.vertices[:, 2].copy()
        heights[heights < self.from_mm] = np.nan
        return MapValues(heights, notes=("measured upward",))


@dataclass(frozen=True)
class Named(Height):
    """A height under another name."""

    called: str = ""

    def __init__(self, called):
        object.__setattr__(self, "called", called)

    @property
    def name(self):
        return self.called


@dataclass(frozen=True)
class Infinite(Height):
    """Infinite everywhere."""

    def values_steps(self, surface):
        yield PAUSE
        return MapValues(np.full(len(surface.mesh.vertices), -np.inf, np.float32))


@dataclass(frozen=True)
class OfFull(Quantity):
    """Vertices of the full surface, and of that of another label."""

    flag, text, label, needs_full = "of-full", "vertices of the full surface", "Of Full", True
    other: int = 0

    @property
    def name(self):
        return "of_full"

    @property
    def unit(self):
        return ""

    def values_steps(self, surface):
        settings = surface.settings.without(SIMPLIFICATION)
        settings = replace(settings, label=self.other) if self.other else settings
        mesh = yield from surface.surface_steps(settings)
        return MapValues(np.full(len(surface.mesh.vertices), len(mesh.vertices), np.float32))


@pytest.fixture(scope="module")
def ball():
    """A ball of radius 9 mm in voxels of 1 mm."""
    distance = np.sqrt(((np.indices((24, 24, 24)) - 11.5) ** 2).sum(axis=0))
    return Volume((9 - distance).astype(np.float32), np.eye(4))


@pytest.fixture(scope="module")
def labels():
    """Two boxes that touch, in voxels of 1 mm."""
    values = np.zeros((10, 12, 20), np.uint8)
    values[2:8, 2:10, 2:10], values[2:8, 2:10, 10:18] = 1, 2
    return Volume(values, np.eye(4), kind="label", label_names={1: "left", 2: "right"})


def test_a_map_is_of_the_final_surface(ball):
    full = reconstruct(ball, ReconstructionSettings(threshold=0.0), maps=[Height()])
    less = reconstruct(ball, ReconstructionSettings(threshold=0.0, reduction=0.9), maps=[Height()])
    assert len(less.mesh.vertices) < 0.2 * len(full.mesh.vertices)
    for result in (full, less):
        [height] = result.maps
        assert height.values.dtype == np.float32
        np.testing.assert_array_equal(height.values, result.mesh.vertices[:, 2])
        assert (height.name, height.unit, height.ramp, height.range) == ("height_mm", "mm", "viridis", (0.0, 25.0))
        assert "height_mm: measured upward" in result.notes
        assert [stage.name for stage in result.stages][-1] == "Making maps"


def test_a_surface_with_maps_has_the_same_bytes_as_without(ball):
    settings = ReconstructionSettings(threshold=0.0, reduction=0.5)
    bare, mapped = (reconstruct(ball, settings, maps=maps).mesh for maps in ([], [Height(), OfFull()]))
    assert bare.vertices.tobytes() == mapped.vertices.tobytes()
    assert bare.faces.tobytes() == mapped.faces.tobytes()


def test_statistics_are_those_of_the_vertices_and_of_the_area(ball):
    limits = {"height_mm": Limits(5.5, 15.5)}
    request = MapRequest((Height(from_mm=4.5),), limits)
    result = reconstruct(ball, ReconstructionSettings(threshold=0.0), maps=request)
    [height] = result.maps
    z, areas = result.mesh.vertices[:, 2], vertex_areas(result.mesh)
    assert areas.sum() == pytest.approx(result.mesh.area, rel=1e-6)
    there = z >= 4.5
    numbers = height.statistics
    assert (numbers.minimum, numbers.maximum) == (z[there].min(), z.max())
    assert numbers.median == pytest.approx(np.median(z[there]), rel=1e-6)
    assert numbers.percentile_5 == pytest.approx(np.percentile(z[there].astype(float), 5))
    # On a ball the area between two heights is their difference (Archimedes): from 2.5 to 4.5, and so on.
    assert numbers.share_without == pytest.approx(2 / 18, abs=0.012)
    assert numbers.share_below == pytest.approx(1 / 16, abs=0.012)
    assert numbers.share_above == pytest.approx(5 / 16, abs=0.012)
    assert numbers.mean == pytest.approx((4.5 + 20.5) / 2, abs=0.05)


def test_numbers_of_a_map_stand_in_report_and_tables(ball):
    result = reconstruct(ball, ReconstructionSettings(threshold=0.0), maps=[Height()])
    report = json.loads(json.dumps(result.report()))
    assert report["height_mm"]["median"] == result.maps[0].statistics.median
    assert report["maps"] == [result.maps[0].about()]
    [about] = [each for each in measures_in(Place.TABLE, maps_of([result.finished]).items()) if each.unit == "mm"][-1:]
    cells = about.cells(about.value(result.finished))
    assert list(cells) == [
        *(f"height_mm_{name}" for name in ("min", "p5", "median", "mean", "p95", "max")),
        *(f"height_mm_share_{name}" for name in ("without", "below", "above")),
    ]
    assert cells["height_mm_max"] == result.maps[0].statistics.maximum
    assert cells["height_mm_share_below"] is None


def test_no_map_takes_the_place_of_what_a_report_has(ball):
    result = reconstruct(ball, ReconstructionSettings(threshold=0.0), maps=[Height()])
    assert set(result.report()) - {"height_mm"} <= TAKEN


def test_an_infinite_value_is_none(ball):
    [height] = reconstruct(ball, ReconstructionSettings(threshold=0.0), maps=[Height(np.inf)]).maps
    [low] = reconstruct(ball, ReconstructionSettings(threshold=0.0), maps=[Infinite()]).maps
    assert np.isnan(height.values).all()
    assert np.isnan(low.values).all()


def test_labels_that_share_a_wall_have_values_of_their_own_and_one_range(labels):
    settings = ReconstructionSettings(interfaces="shared")
    left, right = reconstruct_labels(labels, settings, maps=[Height(from_mm=3.0), OfFull()]).surfaces
    for result in (left, right):
        assert len(result.maps[0].values) == len(result.mesh.vertices)
        assert result.maps[1].values[0] == len(result.mesh.vertices)
    assert left.maps[0].range == right.maps[0].range


@pytest.mark.parametrize("interfaces", ["shared", "separate"])
def test_a_quantity_gets_the_full_surface(labels, interfaces):
    settings = ReconstructionSettings(interfaces=interfaces, reduction=0.5)
    fulls = reconstruct_labels(labels, ReconstructionSettings(interfaces=interfaces)).surfaces
    for result, full in zip(reconstruct_labels(labels, settings, maps=[OfFull()]).surfaces, fulls, strict=True):
        assert result.maps[0].values[0] == len(full.mesh.vertices) > len(result.mesh.vertices)


def test_a_quantity_gets_the_surface_of_another_label(labels):
    [other] = reconstruct_labels(labels, ReconstructionSettings(), [2]).surfaces
    requests = [SurfaceRequest(ReconstructionSettings(label=1))]
    [made] = finish(make_surfaces_steps(labels, requests, maps=MapRequest((OfFull(other=2),))))
    assert made.result.maps[0].values[0] == len(other.mesh.vertices)
    assert made.full is None


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"quantities": (Height(), Height())}, "two maps are called height_mm; give each a name of its own"),
        (
            {"quantities": (Named("volume_mm3"),)},
            "a map cannot be called volume_mm3, as reports have that; give it another name",
        ),
        ({"quantities": (Height(),), "shown": "depth_mm"}, "there is no map depth_mm; the maps are height_mm"),
        (
            {"quantities": (), "limits": {"a": Limits(1.0)}},
            "there is no map a; no map is asked for, such as --thickness",
        ),
        (
            {"quantities": (Height(),), "limits": {"height_mm": Limits(3.0, 1.0)}},
            "the limits of height_mm are 3 and 1; give the lower one first",
        ),
        (
            {"quantities": (Height(),), "range": (2.0, 2.0)},
            "the colors cannot run from 2 to 2; give two numbers, the lower one first",
        ),
        (
            {"quantities": (Height(),), "ramp": "rainbow"},
            "there is no color ramp rainbow; choose viridis, magma, coolwarm, light",
        ),
    ],
)
def test_a_request_that_makes_no_sense_is_refused(words, message):
    with pytest.raises(SettingsError) as error:
        MapRequest(**words)
    assert str(error.value) == message


def test_range_and_ramp_of_the_shown_map_can_be_chosen(ball):
    request = MapRequest((Height(),), range=(0.0, 5.0), ramp="magma")
    [height] = reconstruct(ball, ReconstructionSettings(threshold=0.0), maps=request).maps
    assert (height.range, height.ramp) == ((0.0, 5.0), "magma")
    assert height.colors[height.values > 5.0].tolist() == [[252, 253, 191]] * int((height.values > 5.0).sum())


def test_a_map_without_any_value_has_no_numbers():
    numbers = statistics_of(np.full(3, np.nan, np.float32), np.ones(3))
    assert (numbers.minimum, numbers.mean, numbers.share_without) == (None, None, 1.0)
    assert range_of(np.full(3, np.nan, np.float32), "viridis") == (0.0, 1.0)
