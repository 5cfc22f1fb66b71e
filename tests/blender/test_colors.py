# SPDX-License-Identifier: GPL-3.0-or-later
"""Colors of labels: the same in a rendered pixel, and told apart by color-blind eyes."""

import itertools
from dataclasses import replace

import bpy
import numpy as np
import pytest

from ctmc_addon.blender.colors import color_of
from ctmc_addon.blender.figure.styles import require_engine
from ctmc_addon.blender.materials import principled, surface_input
from ctmc_addon.blender.scene.studio import prepare_scene
from ctmc_addon.blender.surface import add_reconstruction, read_provenance
from ctmc_addon.core import CtmcError, structures_of
from ctmc_addon.core.volume import label_rgb, linear, part_rgb
from ctmc_addon.core.volume.labels.structure_colors import HUES

# Machado, Oliveira and Fernandes 2009, severity 1: linear RGB as a protanope and a deuteranope see it.
BLINDNESS = {
    "none": np.eye(3),
    "protan": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deutan": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
}
SRGB_TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def lab(rgb, kind):
    """CIE L*a*b* of a linear color, as a kind of eye sees it."""
    xyz = SRGB_TO_XYZ @ np.clip(BLINDNESS[kind] @ np.array(rgb), 0, 1) / np.array([0.9505, 1.0, 1.089])
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("kind", BLINDNESS)
def test_seven_labels_are_told_apart_by_every_eye(kind):
    seen = [lab(color_of(label), kind) for label in range(1, len(HUES) + 1)]
    least = min(float(np.linalg.norm(a - b)) for a, b in itertools.combinations(seen, 2))
    assert least > 10  # a just noticeable difference is 2.3


def test_a_label_keeps_its_color_and_twenty_one_differ():
    assert label_rgb(1) == label_rgb(22) == (213, 94, 0)
    assert len({label_rgb(label) for label in range(1, 22)}) == 21
    assert color_of(None) != color_of(1)


def test_a_label_has_the_color_of_its_name_and_its_files_own_wins():
    assert color_of(1, None, "Leber") == color_of(5, None, "liver") == linear((122, 28, 40))
    assert color_of(1, (10, 20, 30), "liver") == linear((10, 20, 30))
    assert color_of(3, None, "structure") == color_of(3)


def test_a_part_has_a_shade_of_its_structures_color_in_a_scene_and_in_a_file(ball, scene):
    shades = [part_rgb((122, 28, 40), number) for number in range(5)]
    assert shades[0] == (122, 28, 40)
    assert len(set(shades)) == 5
    for number, cut in itertools.product(range(64), range(6)):  # a part is beyond a cut by a power of 2
        assert part_rgb((226, 215, 191), number) != part_rgb((226, 215, 191), number + 2**cut)
    part = replace(with_color(ball(), (122, 28, 40)), part_number=1)
    [structure] = structures_of([part])
    obj = add_reconstruction(part, scene)
    assert structure.rgb == shades[1]
    assert tuple(obj.data.materials[0].diffuse_color[:3]) == pytest.approx(linear(shades[1]), abs=1e-6)
    assert read_provenance(obj).part_number == 1


def with_color(result, rgb):
    return replace(result, settings=replace(result.settings, threshold=None, label=3), label_color=rgb)


def middle_pixel(scene, path):
    Image = pytest.importorskip("PIL.Image")
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True, scene=scene.name)
    with Image.open(path) as image:
        return image.getpixel((image.width // 2, image.height // 2))[:3]


@pytest.mark.parametrize("rgb", [(221, 130, 101), (0, 151, 206), (255, 0, 1), (13, 5, 10), (128, 174, 128)])
@pytest.mark.parametrize("engine", ["workbench", "cycles"])
def test_the_srgb_of_a_label_is_that_of_a_rendered_pixel(ball, scene, tmp_path, rgb, engine):
    try:
        require_engine(engine)
    except CtmcError as error:
        pytest.skip(str(error))
    obj = add_reconstruction(with_color(ball(), rgb), scene)
    material = obj.data.materials[0]
    assert np.allclose(material.diffuse_color[:3], linear(rgb))
    prepare_scene(scene, [obj], (60, 60))
    if engine == "workbench":
        scene.render.engine = "BLENDER_WORKBENCH"
        scene.display.shading.light, scene.display.shading.color_type = "FLAT", "MATERIAL"
        scene.display.render_aa = "OFF"
    else:  # what the base color of the surface's shader emits
        glow = material.node_tree.nodes.new("ShaderNodeEmission")
        glow.inputs["Color"].default_value = principled(material).inputs["Base Color"].default_value
        material.node_tree.links.new(glow.outputs[0], surface_input(material))
    assert middle_pixel(scene, tmp_path / "a.png") == rgb
