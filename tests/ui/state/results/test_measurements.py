# SPDX-License-Identifier: GPL-3.0-or-later
"""Every measure of a surface is kept with its object and shown; those that older files lack are not known."""

from __future__ import annotations

import json
from dataclasses import fields, replace

import pytest

bpy = pytest.importorskip("bpy")

from ui.drawing import drawn

from ctmc_addon.blender.stored_values import from_stored
from ctmc_addon.core import HU, PRINT_MEASURES, Place, ReconstructionSettings, measures_in
from ctmc_addon.core.mesh import LostComponents, Measures, OneWayDistance, SurfaceDistance, TriangleQuality
from ctmc_addon.core.solid import PrintFacts
from ctmc_addon.ui.operators.results.table import csv_of
from ctmc_addon.ui.panels.results.page import CTMC_PT_results, facts_of
from ctmc_addon.ui.panels.results.table import draw_measurements
from ctmc_addon.ui.state import session
from ctmc_addon.ui.state.results import measurements
from ctmc_addon.ui.state.results.measurements import PROPERTY, Measurement

MEASURES = Measures(
    *(8, 2.5, 1.5, True, 2, 30, 12, 0.002, 3, 6), quality=TriangleQuality(9.0, 0.0, 0.25, 1.5), size=(0.05, 0.02, 0.01)
)
DISTANCE = SurfaceDistance(
    OneWayDistance(0.01, 0.02, 0.3), OneWayDistance(0.02, 0.3, 4.0), LostComponents(562, 1.9, 46.6)
)
PRINTING = PrintFacts(
    *((90.0, 80.0, 40.5), 12.5, 99.0, 1.234, 0.125, 1, 0, 78.91, 0.25), least_wall_mm=1.5, bed_mm=(60.0, 220.0, 250.0),
    fits_bed=False, cuts=("--cut 45 40 20.25 1 0 0",),
)  # fmt: skip
FULL = Measurement(MEASURES, DISTANCE, 2, PRINTING)


@pytest.fixture
def surface(loaded):
    bpy.ops.ctmc.reconstruct()
    return bpy.context.view_layer.objects.active


def test_every_field_of_a_measurement_comes_back_from_the_object(surface):
    for kind, value in ((Measures, MEASURES), (PrintFacts, PRINTING), (Measurement, FULL)):
        assert None not in [getattr(value, each.name) for each in fields(kind)]
    for kept in (FULL, replace(FULL, distance=None, self_intersections=None, printing=None)):
        measurements.keep(surface, kept, measurements.mesh_state(surface))
        assert measurements.of(surface) == kept
    without = replace(
        FULL, measures=replace(MEASURES, quality=replace(MEASURES.quality, median_radius_ratio=float("inf")))
    )
    measurements.keep(surface, without, measurements.mesh_state(surface))
    assert measurements.of(surface).measures == replace(MEASURES, quality=None)


def test_a_type_that_cannot_be_kept_is_our_fault_and_said():
    with pytest.raises(NotImplementedError, match="cannot be kept"):
        from_stored(set[int], [1])
    for values in ([1.0], [1.0, "2"], {"x": 1.0}, None):
        with pytest.raises(ValueError, match="not a"):
            from_stored(tuple[float, float], values)


def test_measures_of_older_files_are_read_without_those_that_they_lack(surface):
    old = {"faces": 8, "area": 2.5, "volume": 1.5, "closed": True, "euler": 2, "components": 30, "small_components": 12}
    old |= {"borders": 0, "vertices": 6}
    quality = {"smallest_angle_deg": 9.0, "below_5": 0.0, "below_10": 0.25, "median_radius_ratio": 1.5}
    stored = {"state": measurements.mesh_state(surface), "measures": old, "distance": None, "quality": quality}
    surface[PROPERTY] = json.dumps(stored)
    found = measurements.of(surface)
    assert (found.measures.volume, found.measures.quality.below_10) == (1.5, 0.25)
    assert (found.measures.size, found.self_intersections, found.measures.small_components) == (None, None, 0)
    assert dict(facts_of(None, found))["Size"] == "-"
    texts = drawn(CTMC_PT_results).texts
    assert "Size" not in texts
    assert "30 components" in texts
    surface[PROPERTY] = json.dumps(stored | {"distance": {"mean": 0.1, "percentile_95": 0.5, "largest": 46.6}})
    assert measurements.of(surface).distance is None
    surface[PROPERTY] = json.dumps(stored | {"measures": old | {"size": 3}})
    assert measurements.of(surface) is None


def test_results_have_each_of_their_measures(surface):
    measurements.keep(surface, FULL, measurements.mesh_state(surface))
    texts = drawn(CTMC_PT_results).texts
    for each in measures_in(Place.PANEL):
        text = texts[texts.index(each.label) + 1]
        expected = each.text(each.value(FULL.finished))
        assert text == expected or (each.name == "faces" and text.startswith(f"{expected} of ")), each.name
    assert texts[texts.index("Size") + 1] == "50 x 20 x 10 um"
    plain = replace(FULL, printing=None)
    assert [name for name, _ in facts_of(None, None)] == [name for name, _ in facts_of(None, plain)]


def test_results_have_the_facts_for_print_of_a_part_alone(surface):
    measurements.keep(surface, FULL, measurements.mesh_state(surface))
    texts = drawn(CTMC_PT_results).texts
    shown = {each.label: texts[texts.index(each.label) + 1] for each in PRINT_MEASURES}
    assert shown == {
        "Thinnest Wall": "1.23 mm",
        "Below Least Wall": "12.5 %",
        "Largest Overhang": "78.9°",
        "Overhang above 45°": "25 %",
        "Fits the Bed": "no",
    }
    measurements.keep(surface, replace(FULL, printing=None), measurements.mesh_state(surface))
    assert not {each.label for each in PRINT_MEASURES} & set(drawn(CTMC_PT_results).texts)


def test_measurements_have_the_facts_for_print_of_a_part(surface):
    measurements.keep(surface, FULL, measurements.mesh_state(surface))
    bpy.ops.ctmc.table()
    texts = drawn(draw_measurements).texts
    assert texts[texts.index("Thinnest Wall") + 1] == "1.23 mm"
    assert "thinnest_wall_mm" in csv_of(bpy.context.scene).splitlines()[0].split(",")


def test_measurements_have_each_of_their_measures(surface):
    bpy.ops.ctmc.table()
    ((row,), _) = session.of(bpy.context.scene).table
    texts = drawn(draw_measurements).texts
    for each in measures_in(Place.TABLE):
        if each.unit != HU or row.surface.inside is not None:
            assert texts[texts.index(each.label) + 1].startswith(each.text(each.value(row.surface))), each.name


def test_small_components_of_a_surface_that_is_not_measured_are_measured(surface):
    from ctmc_addon.ui.operators.results.components import CTMC_OT_remove_small

    small = measurements.of(surface).measures.small
    assert small == pytest.approx(0.001 * measurements.of(surface).measures.volume, rel=0.5)
    del surface[PROPERTY]
    changes = CTMC_OT_remove_small.changes_of(None, surface)
    assert changes == {"min_part_mm3": pytest.approx(small)}
    ReconstructionSettings(**changes)
