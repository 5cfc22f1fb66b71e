# SPDX-License-Identifier: GPL-3.0-or-later
"""A .blend of each earlier version opens: its surfaces are known, simplified and made again.

Each holds a ball of 4 mm at alpha 0.75, `Live`, and one smoothed by a Gaussian of 1.5 mm and halved, `Simplified`.
Each version made its own in Blender 5.0 with its operators Load and Reconstruct.
"""

from __future__ import annotations

import tarfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shapes import distance_mm

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.surface import evaluated_triangles, read_provenance
from ctmc_addon.core import ReconstructionSettings

OLD = Path(__file__).parents[1] / "old_files"
LIVE = ReconstructionSettings(threshold=100.0, alpha=0.75)
SMOOTHED = {"alpha": 0.75, "threshold": 100.0, "smoothing_mm": 1.5, "reduction": 0.5}

pytestmark = pytest.mark.skipif(bpy.app.version < (5, 0, 0), reason="Blender opens no file of a later Blender")


@pytest.fixture(params=["0.1", "0.2", "0.3"])
def version(request):
    return request.param


@pytest.fixture
def opened(scene, version, tmp_path, capfd):
    """The scene of an old file with its CT beside it; opening it prints no error."""
    with tarfile.open(OLD / "blends.tar.xz") as archive:
        (tmp_path / "old.blend").write_bytes(archive.extractfile(f"{version}.blend").read())
    values = np.round(140 - 10 * distance_mm((8, 14, 14), spacing=(1, 1, 2))).astype(np.int16)
    np.save(tmp_path / "ball.npy", values)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "old.blend"))
    output = "".join(capfd.readouterr())
    assert "Traceback" not in output
    assert "Error" not in output
    return bpy.context.scene


def activate(name):
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj.name == name)
    bpy.context.view_layer.objects.active = bpy.data.objects[name]
    return bpy.data.objects[name]


def smoothed_settings(version):
    """How the smoothed surface was made; 0.1 had one way to smooth, and named it by its width."""
    return ReconstructionSettings(**SMOOTHED, smoothing="auto" if version == "0.1" else "gaussian")


def test_surfaces_of_an_old_file_know_how_they_were_made(opened, version):
    live, simplified = (read_provenance(bpy.data.objects[name]) for name in ("Live", "Simplified"))
    assert live.settings == replace(LIVE, smoothing_mm=0.0 if version == "0.1" else None)
    assert simplified.settings == smoothed_settings(version)
    assert (live.version, live.faces, live.full_faces) == (f"{version}.0", 428, 428)
    assert (simplified.faces, simplified.full_faces) == (126, 252)
    assert live.spacing_mm == (1.0, 1.0, 2.0)
    assert live.fingerprint == simplified.fingerprint != ""
    assert len(evaluated_triangles(bpy.data.objects["Live"]).faces) == 428


def test_settings_of_an_old_surface_go_to_the_panel(opened, version):
    activate("Simplified").select_set(False)
    opened.ctmc.from_settings(ReconstructionSettings())
    assert bpy.ops.ctmc.adopt_settings() == {"FINISHED"}
    assert opened.ctmc.to_settings() == smoothed_settings(version)


def test_an_old_surface_is_simplified_or_asks_for_its_ct(opened):
    live = activate("Live")
    opened.ctmc.reduction = 0.5
    assert bpy.ops.ctmc.simplify() == {"FINISHED"}
    assert len(live.data.polygons) == 214
    activate("Simplified")
    with pytest.raises(RuntimeError, match="its full surface is not in memory; load its CT again"):
        bpy.ops.ctmc.simplify()


def test_an_old_surface_is_made_again_from_its_ct(opened):
    """The same field is cut, so the triangles before simplification are as many as they were."""
    obj = activate("Simplified")
    before = read_provenance(obj)
    bpy.ops.ctmc.load(filepath=bpy.path.abspath(opened.ctmc.volume_path), spacing=(1, 1, 2))
    activate("Simplified")
    bpy.ops.ctmc.adopt_settings()
    assert bpy.ops.ctmc.reconstruct() == {"FINISHED"}
    after = read_provenance(obj)
    assert (after.full_faces, after.faces, after.fingerprint) == (before.full_faces, before.faces, before.fingerprint)
    assert after.version != before.version or before.version == "0.3.0"
    assert after.settings.smoothing_mm == before.settings.smoothing_mm
