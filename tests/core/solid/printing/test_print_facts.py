# SPDX-License-Identifier: GPL-3.0-or-later
"""Facts for a print lab against closed forms: size, material, walls, pieces, cavities, overhangs, bed."""

import json
from dataclasses import replace

import numpy as np
import pytest
from meshes import as_mesh, icosphere, joined

from ctmc_addon.core import Budget, MeshError, ReconstructionSettings, TriangleMesh, Volume, finish, reconstruct
from ctmc_addon.core.solid import (
    MOST_CUTS,
    Cut,
    Pegs,
    PrintFacts,
    SolidRequest,
    cuts_to_fit,
    print_facts_steps,
    printed_steps,
    walls_steps,
)

pytestmark = pytest.mark.once

ONE_CUT = Cut((0, 0, 0), (0, 0, 1))


def facts_of(mesh, spacing=None, **request):
    return finish(print_facts_steps(mesh, SolidRequest(**request), spacing=spacing))


def box(low, high):
    """Twelve triangles."""
    corners = np.array([[(low, high)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)])
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return as_mesh(corners, [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads])


def inside_out(mesh):
    return as_mesh(mesh.vertices, mesh.faces[:, ::-1])


def prism(apex_degrees, height, length):
    """A wedge along y whose edge at the top has this angle."""
    half = height * np.tan(np.radians(apex_degrees / 2))
    ends = [[(-half, y, 0), (half, y, 0), (0, y, height)] for y in (0, length)]
    faces = [(0, 1, 2), (3, 5, 4)]
    faces += [face for a, b in ((0, 1), (1, 2), (2, 0)) for face in ((b, a, a + 3), (b, a + 3, b + 3))]
    mesh = as_mesh(np.concatenate(ends), faces)
    assert mesh.volume == pytest.approx(half * height * length)
    return mesh


def drained_shell(outer=12.0, inner=9.0, hole=2.5, spacing=0.75):
    """A hollow ball with a round hole through its top, off the samples."""
    count = int(outer / spacing) + 3
    z, y, x = np.meshgrid(*[(np.arange(-count, count + 1) + 0.3) * spacing] * 3, indexing="ij")
    radius = np.sqrt(x * x + y * y + z * z)
    wall = np.minimum(outer - radius, radius - inner)
    outside_hole = np.where(z > 0, np.sqrt(x * x + y * y) - hole, np.inf)
    return Volume(np.minimum(wall, outside_hole).astype(np.float32), np.diag([spacing] * 3 + [1.0]))


def test_a_plate_has_the_size_material_area_and_wall_of_the_closed_form():
    facts = facts_of(box((5, -7, 100), (45, 23, 106)), least_wall=6.0)
    assert facts.size_mm == (40.0, 30.0, 6.0)
    assert facts.material_ml == pytest.approx(7.2)
    assert facts.area_cm2 == pytest.approx(32.4)
    assert facts.thinnest_wall_mm == pytest.approx(6.0, rel=1e-5)
    assert facts.below_least_wall == 0.0
    assert (facts.pieces, facts.closed_cavities) == (1, 0)
    assert (facts.largest_overhang_deg, facts.overhang_share) == (0.0, 0.0)
    assert (facts.bed_mm, facts.fits_bed, facts.cuts, facts.notes) == (None, None, (), ())


def test_a_ball_overhangs_as_its_closed_form():
    # Of a sphere's area the share h / 2R lies below height h. Faces up to 0.1 mm rest on the bed; a thousandth more
    # reaches to 0.12 mm, where the angle from the vertical has the sine 1 - h / R.
    facts = facts_of(icosphere(5, 10.0, (3, 4, 5)), spacing=1.0)
    assert facts.largest_overhang_deg == pytest.approx(np.degrees(np.arcsin(0.988)), abs=1.0)
    assert facts.overhang_share == pytest.approx((1 - np.sqrt(0.5)) / 2 - 0.005, abs=0.003)
    assert facts.material_ml == pytest.approx(4 / 3 * np.pi, rel=0.002)
    assert facts.thinnest_wall_mm == pytest.approx(20.0, rel=0.002)


def test_a_ceiling_overhangs_by_90_degrees_and_what_rests_on_the_bed_does_not():
    standing = box((0, 0, 0), (10, 10, 10))
    ceiling = box((0, 0, 20), (40, 40, 22))
    facts = facts_of(joined(standing, ceiling))
    assert facts.largest_overhang_deg == 90.0
    assert facts.overhang_share == pytest.approx(1600 / (600 + 3200 + 320))
    assert facts_of(standing).overhang_share == 0.0


@pytest.mark.parametrize(("degrees", "steep"), [(30.0, False), (44.0, False), (46.0, True), (60.0, True)])
def test_a_slanted_plate_overhangs_by_its_angle(degrees, steep):
    upright = box((0, 0, 0), (40, 4, 40))
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turned = as_mesh(upright.vertices @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]).T, upright.faces)
    facts = facts_of(turned)
    # The narrow side at the foot looks down by 90 - degrees, the wide one by degrees: the steeper one counts.
    assert facts.largest_overhang_deg == pytest.approx(max(degrees, 90 - degrees), abs=0.01)
    assert facts.overhang_share == pytest.approx((1600 if steep else 160) / (3200 + 4 * 160))


def test_a_hollow_ball_has_a_cavity_without_a_drain_and_its_wall():
    facts = facts_of(joined(icosphere(5, 10.0), inside_out(icosphere(5, 8.0))), least_wall=3.0)
    assert facts.material_ml == pytest.approx(4 / 3 * np.pi * (1 - 0.512), rel=0.003)
    assert facts.thinnest_wall_mm == pytest.approx(2.0, rel=0.005)
    assert facts.below_least_wall == pytest.approx(1.0, abs=0.01)
    assert (facts.pieces, facts.closed_cavities) == (1, 1)
    assert facts.notes == ("The part encloses 1 cavity without a drain; --drain X Y Z MM opens one",)


def test_a_hole_opens_the_cavity_and_its_sharp_edges_are_no_thin_walls():
    volume = drained_shell()
    result = reconstruct(volume, ReconstructionSettings(threshold=0.0))
    [part] = finish(printed_steps([result], SolidRequest(least_wall=2.5)))
    facts = part.printing
    assert (facts.pieces, facts.closed_cavities) == (1, 0)
    assert facts.thinnest_wall_mm == pytest.approx(3.0, rel=0.02)
    assert facts.below_least_wall < 0.002
    rim, inner_rim = np.sqrt(12**2 - 2.5**2), np.sqrt(9**2 - 2.5**2)
    assert facts.size_mm == pytest.approx((24.0, 24.0, 12 + rim), abs=0.1)
    whole, hole = 4 / 3 * np.pi * (12**3 - 9**3), 2 / 3 * np.pi * (12**3 - rim**3 - 9**3 + inner_rim**3)
    assert facts.material_ml == pytest.approx((whole - hole) / 1000, rel=0.003)


def test_two_balls_are_two_pieces_and_the_smaller_one_is_the_thinnest_wall():
    facts = facts_of(joined(icosphere(4, 10.0), icosphere(4, 5.0, (30, 0, 0))), 1.0, least_wall=12.0)
    assert facts.pieces == 2
    assert facts.thinnest_wall_mm == pytest.approx(10.0, rel=0.01)
    assert facts.below_least_wall == pytest.approx(0.2, abs=0.005)
    assert facts.size_mm == pytest.approx((45, 20, 20), abs=0.05)


def test_the_share_below_the_least_wall_is_that_of_the_thin_plate_less_its_rim():
    mesh = joined(box((0, 0, 0), (40, 40, 40)), box((50, 0, 0), (51, 40, 40)))
    whole = 6 * 1600 + 2 * 1600 + 160
    facts = facts_of(mesh, least_wall=1.2)
    assert facts.thinnest_wall_mm == pytest.approx(1.0, rel=1e-4)
    # Balls within half a millimeter of the rim meet it instead of the other side.
    assert facts.below_least_wall == pytest.approx(2 * 39 * 39 / whole, abs=0.006)
    assert facts_of(mesh, least_wall=1.0).below_least_wall == 0.0


def test_a_cube_has_no_two_sides_that_face_each_other_within_a_ball_so_its_largest_ball_counts():
    assert facts_of(box((0, 0, 0), (10, 10, 10))).thinnest_wall_mm == pytest.approx(10.0, rel=0.02)


def test_an_edge_of_60_degrees_is_no_wall_and_a_blade_of_20_is():
    # The ball inside an equilateral triangle has the diameter side / sqrt(3).
    height = 12 * np.sqrt(0.75)
    assert facts_of(prism(60, height, 40)).thinnest_wall_mm == pytest.approx(12 / np.sqrt(3), rel=0.05)
    assert facts_of(prism(20, 30, 40)).thinnest_wall_mm < 0.3


def test_an_open_surface_has_no_material():
    whole = box((0, 0, 0), (10, 20, 30))
    facts = facts_of(as_mesh(whole.vertices, whole.faces[1:]))
    assert facts.material_ml is None
    assert facts.size_mm == (10.0, 20.0, 30.0)


@pytest.mark.parametrize("threads", [1, 3])
def test_threads_change_no_fact(threads):
    mesh = joined(icosphere(4, 10.0), inside_out(icosphere(4, 8.0)))
    request = SolidRequest(least_wall=2.0)
    facts = finish(print_facts_steps(mesh, request, Budget(threads=threads)))
    assert facts == finish(print_facts_steps(mesh, request, Budget(threads=2)))


def test_a_part_without_triangles_is_refused():
    empty = TriangleMesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    with pytest.raises(MeshError, match="without triangles"):
        facts_of(empty)
    with pytest.raises(MeshError, match="without triangles"):
        finish(walls_steps(empty, Budget()))


def test_facts_become_plain_data_for_json_in_the_report_of_a_part():
    volume = drained_shell()
    result = reconstruct(volume, ReconstructionSettings(threshold=0.0))
    assert result.report()["print"] is None
    [part] = finish(printed_steps([result], SolidRequest(bed=(10.0, 30.0, 30.0))))
    report = json.loads(json.dumps(part.report()))
    assert report["print"]["size_mm"] == report["size_mm"]
    assert report["print"]["material_ml"] == pytest.approx(report["volume_mm3"] / 1000)
    assert report["print"]["area_cm2"] == pytest.approx(report["area_mm2"] / 100)
    assert report["print"]["fits_bed"] is False
    assert report["print"]["cuts"] == list(part.printing.cuts)
    assert report["stages"][-1]["name"] == "Measuring for print"
    assert part.notes[-1].startswith("The part does not fit the bed of 10 x 30 x 30 mm; cut it with --cut ")
    written = replace(result, measured=result.measures)
    with pytest.raises(MeshError, match="already written"):
        finish(printed_steps([written], SolidRequest()))


@pytest.mark.parametrize(
    ("sides", "bed", "cuts"),
    [
        ((220, 200, 100), (220, 220, 250), ()),
        ((220.005, 200, 100), (220, 220, 250), ()),  # rounding of positions
        ((100, 200, 100), (200, 100, 100), ()),  # turned about z
        ((100, 100, 200), (200, 100, 100), ("--cut 50 50 100 0 0 1",)),  # and never about x or y
        ((440, 200, 100), (220, 220, 250), ("--cut 220 100 50 1 0 0",)),
        ((100, 500, 300), (220, 220, 250), ("--cut 50 166.67 150 0 1 0", "--cut 50 333.33 150 0 1 0",
                                           "--cut 50 250 150 0 0 1")),
        # As it lies it takes 2 x 2 pieces, and turned 1 x 3.
        ((300, 300, 10), (200, 290, 10), ("--cut 150 150 5 1 0 0", "--cut 150 150 5 0 1 0")),
        ((250, 190, 10), (100, 200, 10), ("--cut 83.33 95 5 1 0 0", "--cut 166.67 95 5 1 0 0")),
    ],
)  # fmt: skip
def test_cuts_divide_a_box_evenly_into_pieces_that_fit(sides, bed, cuts):
    assert cuts_to_fit((0, 0, 0), sides, SolidRequest(bed=bed)) == cuts


def test_positions_of_cuts_are_in_the_patient_and_pegs_take_room():
    assert cuts_to_fit((-150, 10, -0.001), (150, 20, 0.001), SolidRequest(bed=(200, 50, 50))) == ("--cut 0 15 0 1 0 0",)
    pegs = SolidRequest(bed=(150, 50, 50), cuts=(ONE_CUT,), pegs=Pegs(2, 5.0, 5.0))
    assert len(cuts_to_fit((0, 0, 0), (300, 20, 20), pegs)) == 2
    assert len(cuts_to_fit((0, 0, 0), (290, 20, 20), pegs)) == 1


def test_cuts_beyond_those_of_one_run_are_told():
    facts = facts_of(box((0, 0, 0), (100, 10, 10)), bed=(10, 10, 10))
    assert len(facts.cuts) == 9
    assert facts.notes == (
        f"The part does not fit the bed of 10 x 10 x 10 mm; it takes 9 cuts, and at most {MOST_CUTS} are possible; "
        "give a larger bed",
    )


def test_every_proposed_cut_is_understood_and_its_pieces_fit():
    low, high, bed = np.array([-210.0, -30.0, 5.0]), np.array([333.0, 250.0, 600.0]), (220.0, 200.0, 250.0)
    cuts = cuts_to_fit(low, high, SolidRequest(bed=bed))
    numbers = np.array([[float(word) for word in cut.split()[1:]] for cut in cuts])
    longest = []
    for axis in range(3):
        along = numbers[numbers[:, 3 + axis] == 1, axis]
        longest.append(np.diff([low[axis], *along, high[axis]]).max())
    assert sorted(longest[:2]) <= sorted(bed[:2])
    assert longest[2] <= bed[2]
    assert np.isin(numbers[:, 3:].sum(axis=1), 1).all()


def test_facts_have_a_default_for_what_is_not_asked_for():
    plain = PrintFacts((1.0, 1.0, 1.0), 0.001, 0.06, 1.0, None, 1, 0, 0.0, 0.0)
    assert plain.report()["cuts"] == []
    assert plain.notes == ()
