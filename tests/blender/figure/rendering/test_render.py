# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's figure: red triangles with yellow borders, framed, and nothing about the machine in the file."""

from __future__ import annotations

import struct

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
Image = pytest.importorskip("PIL.Image")

from ctmc_addon.blender.figure.rendering.render import render_figure_steps
from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.core import finish
from ctmc_addon.core.errors import OutputError

SIZE = (160, 120)


@pytest.fixture
def thing(scene, torus):
    return add_reconstruction(torus(rings=16, sides=8), scene)


def pixels(path):
    """(rows, columns, 3) float, 0 to 1."""
    with Image.open(path) as image:
        assert image.mode == "RGB"
        return np.asarray(image, np.float64) / 255


def chunks(path):
    """Names of a PNG's chunks, each once."""
    raw, at, names = path.read_bytes(), 8, []
    while at < len(raw):
        length, name = struct.unpack_from(">I4s", raw, at)
        names.append(name)
        at += 12 + length
    assert at == len(raw)
    return set(names)


def test_faces_are_red_edges_yellow_and_the_ground_white(thing, tmp_path):
    finish(render_figure_steps([thing], None, tmp_path / "a.png", SIZE, "paper"))
    red, green, blue = np.moveaxis(pixels(tmp_path / "a.png"), 2, 0)
    surface = (red > 0.3) & (green < 0.35) & (blue < 0.35)
    edges = (red > 0.8) & (green > 0.6) & (blue < 0.4)
    ground = (red > 0.98) & (green > 0.98) & (blue > 0.98)
    assert 0.15 < surface.mean() < 0.6
    assert 0.01 < edges.mean() < 0.3
    assert 0.3 < ground.mean() < 0.8
    # A pixel is a face, an edge, the ground, or the border between two of them.
    assert (surface | edges | ground).mean() > 0.75


@pytest.mark.parametrize("azimuth", [30.0, 210.0])
@pytest.mark.parametrize("size", [(160, 120), (90, 150)])
def test_the_surface_fills_the_picture_and_is_not_cut(thing, tmp_path, azimuth, size):
    finish(render_figure_steps([thing], None, tmp_path / "a.png", size, "paper", azimuth=azimuth))
    shown = (pixels(tmp_path / "a.png") < 0.9).any(axis=2)
    assert shown.shape == size[::-1]
    rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
    assert rows[0] > 0
    assert columns[0] > 0
    assert rows[-1] < size[1] - 1
    assert columns[-1] < size[0] - 1
    assert max(np.ptp(rows) / size[1], np.ptp(columns) / size[0]) > 0.82


def test_the_same_surface_gives_the_same_bytes_and_no_texts(thing, tmp_path):
    for name in ("a.png", "b.png"):
        finish(render_figure_steps([thing], None, tmp_path / name, SIZE))
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert not chunks(tmp_path / "a.png") & {b"tEXt", b"zTXt", b"iTXt", b"tIME", b"eXIf"}
    assert str(tmp_path).encode() not in (tmp_path / "a.png").read_bytes()


def test_a_figure_leaves_the_scene_as_it_was(thing, scene, tmp_path):
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.filepath = "//mine"
    names = ("scenes", "objects", "meshes", "materials", "worlds", "cameras", "lights")
    before = [sorted(block.name for block in getattr(bpy.data, name)) for name in names]
    finish(render_figure_steps([thing], scene, tmp_path / "a.png", SIZE))
    assert [sorted(block.name for block in getattr(bpy.data, name)) for name in names] == before
    assert (scene.render.engine, scene.render.filepath, scene.camera) == ("BLENDER_WORKBENCH", "//mine", None)
    assert thing.data.materials[0].name == "torus"


def test_a_figure_that_cannot_be_written_leaves_nothing(thing, tmp_path):
    with pytest.raises(OutputError, match=r"a\.jpg is not a \.png"):
        finish(render_figure_steps([thing], None, tmp_path / "a.jpg", SIZE))
    with pytest.raises(OutputError, match="does not exist"):
        finish(render_figure_steps([thing], None, tmp_path / "nowhere" / "a.png", SIZE))
    resource = pytest.importorskip("resource", reason="only Unix limits the size of files")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(OutputError, match=r"a\.png"):
            finish(render_figure_steps([thing], None, tmp_path / "a.png", SIZE))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not list(tmp_path.iterdir())
    assert len(bpy.data.scenes) == 1
