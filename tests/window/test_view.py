# SPDX-License-Identifier: GPL-3.0-or-later
"""The CT is in view: after a load, by View CT and its letters, by Blender's own Home and View Selected."""

from __future__ import annotations

import pytest
from window.scenes import SEEN, begin, is_framed, load

pytestmark = pytest.mark.window

CT = "/volume-0.nii.gz"
FAR = 700.0  # mm
ASIDE = """
from mathutils import Vector
about = viewport().space.region_3d
about.view_location, about.view_distance = Vector((40, 0, 0)), 3
"""
DIRECTION = "answer = [round(v, 3) for v in viewport().space.region_3d.view_rotation.to_matrix().col[2]]"


@pytest.fixture(scope="module")
def far(desk):
    """The phantom 700 mm above the scene's origin, as patient coordinates often have it; its path in the folder."""
    desk.ask(f"""
import gzip, struct
data = bytearray(gzip.decompress(open("{desk.inside}{CT}", "rb").read()))
code, = struct.unpack_from("<h", data, 254)
assert code > 0, "the affine is in the sform"
z, = struct.unpack_from("<f", data, 324)
struct.pack_into("<f", data, 324, z + {FAR})
open("{desk.inside}/far.nii", "wb").write(data)
""")
    return f"{desk.inside}/far.nii"


def test_a_ct_far_from_the_origin_is_in_view_after_a_load(desk, far):
    begin(desk, empty=False)
    load(desk, far)
    desk.look("view-01-loaded")
    assert is_framed(desk)


def test_its_box_stands_in_a_collection_of_its_folder_and_takes_the_surface(desk):
    box = desk.ask("""
box = bpy.data.objects["far"]
answer = [box.type, [c.name for c in box.users_collection], box.select_get(), list(box.location), list(box.scale)]
""")
    assert box[:3] == ["EMPTY", [desk.folder.name], True]
    assert box[3][2] == pytest.approx(FAR * 0.01, abs=0.5)
    desk.ask("s = bpy.context.scene.ctmc; s.threshold = 200; s.stride = (4, 4, 1)")
    desk.press("bpy.ops.ctmc.reconstruct()", "reconstruct")
    desk.wait("ours('ui.jobs').running() is None and 'Bone 200 HU' in bpy.data.objects")
    assert desk.ask("answer = [c.name for c in bpy.data.objects['Bone 200 HU'].users_collection]") == [desk.folder.name]


@pytest.mark.parametrize(
    ("side", "at", "eye"),
    [
        ("A", 0.42, (0, 1, 0)),
        pytest.param("P", 0.505, (0, -1, 0), marks=pytest.mark.once),
        ("L", 0.59, (-1, 0, 0)),
        pytest.param("R", 0.676, (1, 0, 0), marks=pytest.mark.once),
        ("S", 0.76, (0, 0, 1)),
        pytest.param("I", 0.847, (0, 0, -1), marks=pytest.mark.once),
    ],
)
def test_a_letter_looks_from_its_side_and_frames(desk, side, at, eye):
    desk.ask(ASIDE)
    desk.press(f"bpy.ops.ctmc.view(side='{side}')", "view", at)
    desk.look(f"view-02-{side}")
    assert desk.ask(DIRECTION) == pytest.approx(eye, abs=1e-3)
    assert is_framed(desk)


@pytest.mark.parametrize("key", ["Home", "KP_Decimal"])
def test_home_and_view_selected_find_it(desk, key):
    desk.ask("for o in bpy.data.objects: o.select_set(o.type == 'EMPTY'); o.hide_set(o.type != 'EMPTY')")
    desk.ask(ASIDE + "bpy.context.preferences.view.smooth_view = 0")
    desk.move(*desk.ask("view = viewport().region; answer = [view.x + view.width // 3, view.y + view.height // 3]"))
    desk.key(key)
    desk.look(f"view-03-{key}")
    low_x, high_x, low_y, high_y, left, _, top, bottom = desk.ask(SEEN)
    assert left < (low_x + high_x) / 2
    assert top <= low_y
    assert high_y <= bottom


def test_a_camera_view_stays_where_it_is(desk, far):
    begin(desk, empty=False)
    desk.ask("viewport().space.region_3d.view_perspective = 'CAMERA'; viewport().space.lock_camera = True")
    before = desk.ask("answer = [list(v) for v in bpy.context.scene.camera.matrix_world]")
    load(desk, far)
    assert desk.ask("answer = viewport().space.region_3d.view_perspective") == "CAMERA"
    assert desk.ask("answer = [list(v) for v in bpy.context.scene.camera.matrix_world]") == before
