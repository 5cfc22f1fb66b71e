# SPDX-License-Identifier: GPL-3.0-or-later
"""Load, Reconstruct Surface and Export as a script calls them, and what register leaves behind."""

from __future__ import annotations

import json
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from shapes import distance_mm

bpy = pytest.importorskip("bpy")

from ui.drawing import drawn, meshes_in

import ctmc_addon
from ctmc_addon.blender.colors import color_of
from ctmc_addon.blender.surface import evaluated_triangles
from ctmc_addon.core import Budget, reconstruct
from ctmc_addon.core.volume import linear
from ctmc_addon.readers import read_volume
from ctmc_addon.ui.panels import main as panels
from ctmc_addon.ui.state.ct import volumes

ROOT = Path(__file__).resolve().parents[4]


def load(path):
    return bpy.ops.ctmc.load(filepath=str(path), spacing=(1, 1, 2))


def test_the_panels_surface_is_cores(scene, ball_file):
    assert load(ball_file) == {"FINISHED"}
    scene.ctmc.threshold, scene.ctmc.alpha = 100.0, 0.3
    assert bpy.ops.ctmc.reconstruct() == {"FINISHED"}
    thing = bpy.context.view_layer.objects.active
    expected = reconstruct(read_volume(ball_file, spacing=(1, 1, 2)), scene.ctmc.to_settings()).mesh
    seen = evaluated_triangles(thing)
    assert thing.name == "Surface 100"
    assert thing.select_get()
    assert (seen.faces == expected.faces).all()
    assert np.abs(seen.vertices - expected.vertices.astype(np.float64)).max() <= 1e-4
    assert seen.volume == pytest.approx(4 / 3 * np.pi * 6**3, rel=0.05)


def test_one_reading_serves_several_surfaces(scene, ball_file):
    load(ball_file)
    ball_file.unlink()
    for threshold in (90.0, 110.0):
        scene.ctmc.threshold = threshold
        assert bpy.ops.ctmc.reconstruct(new=True) == {"FINISHED"}
    assert len(meshes_in(scene)) == 2


def test_a_folder_can_be_loaded(scene, tmp_path):
    from PIL import Image

    for number in range(3):
        Image.fromarray(np.full((8, 8), 40 * number, np.uint8)).save(tmp_path / f"slice_{number}.png")
    assert bpy.ops.ctmc.load(directory=str(tmp_path), spacing=(1, 1, 1)) == {"FINISHED"}
    assert volumes.current(scene).size == (8, 8, 3)


def test_a_volume_of_another_file_is_let_go(scene, ball_file):
    load(ball_file)
    bpy.ops.wm.read_homefile(use_empty=True)
    assert not volumes._loaded


def test_several_slices_dropped_together_are_one_stack(scene, tmp_path):
    from PIL import Image

    names = [f"slice_{number}.png" for number in range(4)]
    for name in names:
        Image.fromarray(np.full((8, 8), 40, np.uint8)).save(tmp_path / name)
    dropped = [{"name": name} for name in names[:2]]
    bpy.ops.ctmc.load(filepath=str(tmp_path / names[0]), directory=str(tmp_path), files=dropped, spacing=(1, 1, 1))
    assert volumes.current(scene).size == (8, 8, 4)
    note = "the whole folder was read, 4 slices, not only the 2 chosen files"
    assert note in volumes.current(scene).notes


def test_mistakes_are_one_sentence_and_change_nothing(scene, ball_file, tmp_path):
    with pytest.raises(RuntimeError, match="Load a CT first"):
        bpy.ops.ctmc.reconstruct()
    with pytest.raises(RuntimeError, match="nowhere"):
        load(tmp_path / "nowhere")
    assert volumes.current(scene) is None
    load(ball_file)
    scene.ctmc.threshold = 5000.0
    with pytest.raises(RuntimeError, match="5000"):
        bpy.ops.ctmc.reconstruct()
    scene.ctmc.simplifier, scene.ctmc.max_error_mm = "decimate", 0.5
    with pytest.raises(RuntimeError, match="max_error_mm is not possible with simplifier decimate"):
        bpy.ops.ctmc.reconstruct()
    with pytest.raises(RuntimeError, match="Choose a surface first"):
        bpy.ops.ctmc.export(filepath=str(tmp_path / "a.stl"))
    assert not meshes_in(scene)


def test_the_active_surface_is_exported(scene, ball_file, tmp_path):
    load(ball_file)
    scene.ctmc.threshold = 100.0
    bpy.ops.ctmc.reconstruct()
    assert bpy.ops.ctmc.export(filepath=str(tmp_path / "a.stl")) == {"FINISHED"}
    faces = len(bpy.context.object.data.polygons)
    assert (tmp_path / "a.stl").stat().st_size == 84 + 50 * faces
    with pytest.raises(RuntimeError, match=r"a\.xyz has no known suffix"):
        bpy.ops.ctmc.export(filepath=str(tmp_path / "a.xyz"))


def registered():
    """Everything an add-on may leave behind: types, properties, operators, handlers."""
    names = set(dir(bpy.types)) | {f"ops {name}" for name in dir(bpy.ops.ctmc)}
    for owner in ("Scene", "Object", "WindowManager"):
        names |= {f"{owner}.{one.identifier}" for one in getattr(bpy.types, owner).bl_rna.properties}
    for kind in dir(bpy.app.handlers):
        found = getattr(bpy.app.handlers, kind)
        if isinstance(found, list):
            names |= {f"{kind} {handler}" for handler in found}
    return names


def test_twenty_rounds_of_register_leave_nothing_behind():
    before = registered()
    for _ in range(20):
        ctmc_addon.register()
        assert hasattr(bpy.types.Scene, "ctmc")
        ctmc_addon.unregister()
    assert registered() == before


def test_python_ends_in_peace_while_the_extension_is_registered():
    program = "import bpy, ctmc_addon; ctmc_addon.register(); bpy.context.scene.ctmc.threshold = 3"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr


def test_python_ends_in_peace_after_a_glb(tmp_path):
    program = (
        "import sys, bpy; from ctmc_addon.blender.export import export; "
        "bpy.context.view_layer.update(); export(bpy.data.objects['Cube'], sys.argv[1])"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "a.glb")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.glb").exists()


def test_the_command_of_blender_is_the_command_line(monkeypatch):
    from ctmc_addon import cli

    monkeypatch.setattr(cli, "main", lambda arguments: len(arguments))
    assert ctmc_addon.run_command(["info", "x"]) == 2


def test_dialogs_ask_before_a_file_is_replaced_and_show_the_suffix(scene, ball_file, tmp_path):
    from types import SimpleNamespace

    from ctmc_addon.ui.operators.render import rotation as rotation_test
    from ctmc_addon.ui.operators.results import export

    for kind, name, named in (
        (export.CTMC_OT_export, "bone", "bone.stl"),
        (export.CTMC_OT_export, "bone.PLY", "bone.PLY"),
        (export.CTMC_OT_export, "liver 1.5mm", "liver 1.5mm.stl"),
        (rotation_test.CTMC_OT_rotation_save, "times", "times.csv"),
    ):
        properties = getattr(bpy.ops.ctmc, kind.bl_idname.partition(".")[2]).get_rna_type().properties
        assert properties["check_existing"].default
        ending = Path(named).suffix
        dialog = SimpleNamespace(filepath=str(tmp_path / name), kind=".stl", ending=lambda ending=ending: ending)
        dialog.suffixes = kind.suffixes
        assert kind.check(dialog, None) == (name != named)
        assert dialog.filepath == str(tmp_path / named)
    load(ball_file)
    scene.ctmc.threshold = 100.0
    bpy.ops.ctmc.reconstruct()
    assert bpy.ops.ctmc.export(filepath=str(tmp_path / "bone")) == {"FINISHED"}
    assert (tmp_path / "bone.stl").exists()


def test_a_path_beside_the_blend_is_loaded_without_a_warning(scene, ball_file, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "day.blend"))
    with warnings.catch_warnings(record=True) as heard:  # Blender swallows one that is raised as an error
        warnings.simplefilter("always")
        assert bpy.ops.ctmc.load(filepath="//ball.npy", spacing=(1, 1, 2)) == {"FINISHED"}
    assert heard == []
    assert volumes.loaded(scene).path == ball_file


@pytest.fixture
def too_large(tmp_path, monkeypatch):
    """A ball of 8 mm radius in 48 x 48 x 24 samples of 1 x 1 x 2 mm, and a memory limit that it does not fit."""
    from ctmc_addon.ui.operators.ct import load as load_module
    from ctmc_addon.ui.properties.preferences import Machine

    values = 180 - 10 * distance_mm((24, 48, 48), spacing=(1, 1, 2))
    np.save(tmp_path / "large.npy", values.astype(np.int16))
    monkeypatch.setattr(load_module, "machine", lambda: Machine(budget=Budget(bytes=values.size * 2 - 1)))
    return tmp_path / "large.npy"


def test_a_ct_that_does_not_fit_is_shown_coarse_and_reconstructed_from_its_file(scene, too_large):
    assert load(too_large) == {"FINISHED"}
    loaded = volumes.loaded(scene)
    assert loaded.shown_stride == (2, 2, 2)
    assert loaded.volume.size == (24, 24, 12)
    assert loaded.full.size == (48, 48, 24)
    np.testing.assert_allclose(loaded.volume.spacing, (2, 2, 4))
    texts = " ".join(drawn(*panels.STEPS).texts)
    assert "Shown at every 2 x 2 x 2 voxels; surfaces are made from the file" in texts
    assert "48 x 48 x 24" in texts
    assert "Not counted: the CT does not fit in memory" in texts
    scene.ctmc.threshold = 100.0
    scene.ctmc.use_region, scene.ctmc.region = True, (2, 2, 1, 46, 44, 22)
    assert bpy.ops.ctmc.reconstruct() == {"FINISHED"}
    whole = reconstruct(read_volume(too_large, spacing=(1, 1, 2)), scene.ctmc.to_settings()).mesh
    seen = evaluated_triangles(bpy.context.view_layer.objects.active)
    assert (seen.faces == whole.faces).all()
    assert np.abs(seen.vertices - whole.vertices.astype(np.float64)).max() <= 1e-4
    coarse = loaded.for_copy(scene.ctmc.to_settings())
    assert coarse.region == (1, 1, 0.5, 23, 22, 11)
    assert reconstruct(loaded.volume, coarse).mesh.volume == pytest.approx(whole.volume, rel=0.1)
    bpy.ops.ctmc.fit_region()
    assert tuple(scene.ctmc.region) == (0, 0, 0, 47, 47, 23)


def test_the_format_of_the_dialog_and_the_suffix_follow_each_other(scene):
    from types import SimpleNamespace

    from ctmc_addon.ui.operators.results.export import CTMC_OT_export

    dialog = SimpleNamespace(filepath="/x/bone.stl", kind=".stl", suffixes=CTMC_OT_export.suffixes)
    dialog.ending = lambda: dialog.kind
    CTMC_OT_export.check(dialog, None)
    dialog.kind = ".glb"
    assert CTMC_OT_export.check(dialog, None)
    assert dialog.filepath == "/x/bone.glb"
    dialog.filepath = "/x/bone.ply"
    CTMC_OT_export.check(dialog, None)
    assert dialog.kind == ".ply"


def test_a_label_volume_goes_to_labels_by_itself(scene, tmp_path):
    values = np.zeros((8, 9, 10), np.int16)
    values[2:5, 2:5, 2:5], values[5:7, 5:8, 5:8] = 3, 7
    hounsfield = np.where(values > 0, 400, -1000).astype(np.int16)
    for name, content in (("ct", hounsfield), ("labels", values.astype(np.uint8))):
        np.save(tmp_path / f"{name}.npy", content)
    load(tmp_path / "ct.npy")
    scene.ctmc.threshold = 150.0
    bpy.ops.ctmc.load(filepath=str(tmp_path / "labels.npy"))
    assert (scene.ctmc.use_label, scene.ctmc.label, scene.ctmc.to_settings().threshold) == (True, 3, None)
    assert [item.value for item in scene.ctmc.labels if item.chosen] == [3]


def numbers_shown(obj):
    """The dimensions as Blender's sidebar shows them, in mm."""
    return np.array(obj.dimensions) * bpy.context.scene.unit_settings.scale_length * 1000


def test_the_first_ct_of_a_new_file_lets_blender_show_its_millimeters(scene, ball_file):
    scene.ctmc.threshold = 100.0
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1.0, 1.0, 2.0))
    bpy.ops.ctmc.reconstruct()
    bpy.context.view_layer.update()
    assert numbers_shown(bpy.context.object) == pytest.approx([12.0, 12.0, 12.0], rel=0.03)
    assert bpy.utils.units.to_value("METRIC", "LENGTH", "12 mm") / scene.unit_settings.scale_length == pytest.approx(
        0.12
    )


@pytest.mark.parametrize("reason", ["chosen units", "saved file", "second CT"])
def test_units_that_somebody_has_chosen_stay(scene, ball_file, tmp_path, reason):
    if reason == "chosen units":
        scene.unit_settings.system = "IMPERIAL"
    if reason == "saved file":
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "case.blend"))
    if reason == "second CT":
        bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1.0, 1.0, 1.0))
        scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 1.0
        scene.unit_settings.length_unit = "METERS"
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1.0, 1.0, 2.0))
    assert bpy.context.scene.unit_settings.scale_length == 1.0


def test_labels_have_the_colors_of_their_file_in_list_and_material_and_names_there_and_in_exports(scene, tmp_path):
    values = np.zeros((12, 12, 12), np.uint8)
    values[2:5, 2:5, 2:5], values[7:10, 7:10, 7:10] = 1, 2
    np.save(tmp_path / "segmentation.npy", values)
    (tmp_path / "segmentation.ctbl").write_text("1 liver 255 0 55 255\n")
    bpy.ops.ctmc.load(filepath=str(tmp_path / "segmentation.npy"), spacing=(1, 1, 1))
    assert [item.name for item in scene.ctmc.labels] == ["liver", ""]
    assert tuple(scene.ctmc.labels[0].color) == pytest.approx(linear((255, 0, 55)))
    assert tuple(scene.ctmc.labels[1].color) == pytest.approx(color_of(2))
    for item in scene.ctmc.labels:
        item.chosen = True
    scene.ctmc.labels[1].name = "Spleen"
    bpy.ops.ctmc.reconstruct()
    liver, spleen = (bpy.data.objects[name] for name in ("liver", "Spleen"))
    assert tuple(liver.data.materials[0].diffuse_color)[:3] == pytest.approx(linear((255, 0, 55)))
    scene.ctmc.labels[1].name = "Kidney"
    assert [spleen.name, spleen.data.name, spleen.data.materials[0].name] == ["Kidney"] * 3
    bpy.context.view_layer.objects.active = spleen
    bpy.ops.ctmc.export(filepath=str(tmp_path / "organ.glb"), which="ACTIVE")
    glb = (tmp_path / "organ.glb").read_bytes()
    written = json.loads(glb[20 : 20 + int.from_bytes(glb[12:16], "little")])
    for kind in ("nodes", "meshes", "materials"):
        assert [block["name"] for block in written[kind]] == ["Kidney"]


def test_a_file_without_a_length_is_loaded_with_the_spacing_that_overrides_it(scene, tmp_path):
    values = np.arange(210, dtype=np.int16).reshape(7, 6, 5)
    head = "NDims = 3\nDimSize = 5 6 7\nElementType = MET_SHORT\nElementSpacing = 1 1 0\nElementDataFile = LOCAL\n"
    (tmp_path / "flat.mha").write_bytes(head.encode() + values.tobytes())
    with pytest.raises(RuntimeError, match=r"flat\.mha has a spacing of 1 x 1 x 0 mm, and it must be from 1e-06 to"):
        bpy.ops.ctmc.load(filepath=str(tmp_path / "flat.mha"))
    assert load(tmp_path / "flat.mha") == {"FINISHED"}
    assert volumes.current(scene).spacing == (1, 1, 2)
