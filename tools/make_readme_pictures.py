# SPDX-License-Identifier: GPL-3.0-or-later
"""Render the pictures of README from the CT of a chest: `make readme-pictures CT=FOLDER`, a quarter of an hour.

Blender renders them with Cycles on the processor. The CT has to have skin all around and both lungs, such as
LIDC-IDRI-0314 of The Cancer Imaging Archive (CC BY 3.0), of which the committed pictures are.
`ARGS="--only hero --quick"` makes one of them, small and coarse.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray
from PIL import Image

from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.core import CtmcError, ReconstructionSettings, Volume, finish, reconstruct
from ctmc_addon.core.segmentation import connected_steps, islands_steps, margin_steps
from ctmc_addon.readers import read_volume

PICTURES = Path(__file__).resolve().parents[1] / "docs" / "pictures" / "readme"
BACKGROUND = (0.012, 0.014, 0.02, 1.0)
# Watts, meters on a side, color, and where it stands from what is looked at, in Blender units
LIGHTS = (
    (900.0, 4.0, (1.0, 0.96, 0.9), (-5.0, 7.0, 6.0)),
    (280.0, 5.0, (0.8, 0.88, 1.0), (7.0, 5.0, 1.0)),
    (700.0, 3.0, (1.0, 1.0, 1.0), (0.0, -6.0, 5.0)),
)
SCALE = 0.01  # Blender units of 1 mm
SKIN, BONE, LUNG, VESSEL = (0.80, 0.52, 0.40), (0.86, 0.78, 0.62), (0.85, 0.42, 0.38), (0.45, 0.02, 0.02)
AIR, SOFT, BONE_HU = -1000, -300, 180  # HU
Mask = NDArray[np.bool_]


class Chest(NamedTuple):
    """A CT of a chest without the table, with its lungs.

    Parameters
    ----------
    volume : Volume
        HU; outside of the body air.
    lungs, filled : (slices, rows, columns) bool
        Air in the lungs, and the lungs with their vessels.
    middle : (3,) float
        Middle of the body in Blender units.
    """

    volume: Volume
    lungs: Mask
    filled: Mask
    middle: Vector


def main() -> int:
    """Render the pictures; 0 if all went well."""
    parser = argparse.ArgumentParser(description="Render the pictures of README from the CT of a chest.")
    parser.add_argument("ct", type=Path, help="the CT's folder")
    parser.add_argument("--only", choices=("hero", "alpha", "threshold"))
    parser.add_argument("--quick", action="store_true", help="a quarter of the size, few samples, coarse voxels")
    args = parser.parse_args()
    try:
        chest = chest_of(read_volume(args.ct), 3 if args.quick else 1)
    except CtmcError as error:
        print(f"readme-pictures: {error}", file=sys.stderr)
        return 1
    PICTURES.mkdir(parents=True, exist_ok=True)
    if args.only in (None, "hero"):
        render_hero(chest, args.quick)
    if args.only in (None, "alpha"):
        save_gif(alpha_frames(chest), PICTURES / "alpha.gif", 90)
    if args.only in (None, "threshold"):
        frames = list(threshold_frames(chest.volume, chest.middle))
        save_gif([*frames, *frames[::-1]], PICTURES / "threshold.gif", 110)
    return 0


def chest_of(volume: Volume, stride: int) -> Chest:
    """Find body and lungs, and take away what lies around: table, clothes, cables."""
    affine = volume.affine @ np.diag([stride, stride, stride, 1.0])
    values = np.ascontiguousarray(volume.values[::stride, ::stride, ::stride])
    spacing = tuple(np.linalg.norm(affine[:3, :3], axis=0).tolist())
    voxel_mm3 = float(np.prod(spacing))
    body = finish(islands_steps(values > SOFT, voxel_mm3, largest=1))
    last = np.array(values.shape) - 1
    corners = [(z, y, x) for z in (0, int(last[0])) for y in (0, int(last[1])) for x in (0, int(last[2]))]
    air = ~body
    inside = air & ~finish(connected_steps(air, [corner for corner in corners if air[corner]], spacing))
    lungs = finish(islands_steps(inside & (values < -500), voxel_mm3, largest=2))
    wide = finish(margin_steps(lungs, spacing, 6.0))
    filled = finish(margin_steps(wide, spacing, -8.0))
    outside = air & ~inside
    values = np.where(outside, AIR, values).astype(np.int16)
    rows = np.argwhere(body.any(axis=0))  # (row, column)
    middle = np.array([*(rows.min(axis=0) + rows.max(axis=0))[::-1] / 2, last[0] / 2, 1.0])
    return Chest(Volume(values, affine, name=volume.name), lungs, filled, Vector((affine @ middle)[:3] * SCALE))


def render_hero(chest: Chest, quick: bool) -> None:
    """Render half of the skin, bones, lungs and their vessels, above the lowest slice."""
    scene = new_scene((480, 270) if quick else (1920, 1080), samples=12 if quick else 32)
    volume = chest.volume
    slices, rows, columns = volume.values.shape
    back_half = (0.0, rows * 0.55, 0.0, columns - 1.0, rows - 1.0, slices - 1.0)
    solid = volume_of(volume, np.where(chest.lungs, 0, volume.values))
    add(scene, solid, SKIN, threshold=SOFT, smoothing="gaussian", smoothing_mm=1.5, keep_parts=1, region=back_half)
    add(scene, volume, BONE, threshold=BONE_HU, smoothing="gaussian", smoothing_mm=0.8, min_part_mm3=1500)
    vessels = volume_of(volume, np.where(chest.filled, volume.values, AIR))
    add(scene, vessels, VESSEL, threshold=-450, smoothing="gaussian", smoothing_mm=0.6, min_part_mm3=150)
    lungs = Volume(chest.lungs.astype(np.uint8), volume.affine, kind="label", name="lungs")
    shader_of(add(scene, lungs, LUNG, label=1)).inputs["Alpha"].default_value = 0.16
    add_slice(scene, volume, 0)
    look(scene, chest.middle, azimuth=-24, elevation=20, distance=16.3, lens=95)
    picture = render(scene)
    picture.save(PICTURES / "hero.jpg", quality=86, optimize=True)


def volume_of(like: Volume, values: NDArray[Any]) -> Volume:
    """Return a volume with other values."""
    return Volume(values.astype(np.int16), like.affine, name=like.name)


def alpha_frames(chest: Chest) -> list[Image.Image]:
    """Render the spine at large voxels, from edge midpoints to linear interpolation and back, by its shape key."""
    scene = new_scene((440, 330), samples=10)
    settings = {
        "smoothing": "gaussian",
        "smoothing_mm": 1,
        "stride": (5, 5, 4),
        "min_part_mm3": 3000,
        "normals": "mesh",
    }
    obj = add(scene, chest.volume, BONE, threshold=BONE_HU, **settings)
    obj.data.polygons.foreach_set("use_smooth", np.zeros(len(obj.data.polygons), bool))
    look(scene, chest.middle + Vector((0.3, -0.7, 0.2)), azimuth=205, elevation=15, distance=8, lens=105)
    frames = []
    for step in range(11):
        share = step / 10
        obj.data.shape_keys.key_blocks["alpha"].value = share * share * (3 - 2 * share)
        frames.append(render(scene))
    return [*frames, *frames[::-1]]


def threshold_frames(volume: Volume, middle: Vector) -> Iterator[Image.Image]:
    """Render a surface for each threshold, from muscle to bone; the patient's face is not shown."""
    scene = new_scene((440, 330), samples=10)
    look(scene, middle, azimuth=-24, elevation=18, distance=14, lens=105)
    for threshold in (0, 20, 40, 60, 80, 100, 120, 140, 170, 200, 250, 300, 350):
        share = (threshold + 400) / 750
        color = tuple(low + (high - low) * share for low, high in zip(SKIN, BONE, strict=True))
        settings = {"smoothing": "gaussian", "smoothing_mm": 2.5, "stride": (3, 3, 2), "min_part_mm3": 3000}
        obj = add(scene, volume, color, threshold=threshold, **settings)
        yield render(scene)
        bpy.data.objects.remove(obj)


def new_scene(size: tuple[int, int], samples: int) -> bpy.types.Scene:
    """Return the scene of an empty file: dark, with a camera, rendered by Cycles on the processor."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(scene.camera)
    scene.world = bpy.data.worlds.new("world")
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = BACKGROUND
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.cycles.samples, scene.cycles.use_denoising = samples, True
    scene.cycles.max_bounces, scene.cycles.transparent_max_bounces, scene.cycles.seed = 4, 8, 0
    scene.view_settings.view_transform, scene.view_settings.look = "AgX", "AgX - Medium High Contrast"
    return scene


def add(scene: bpy.types.Scene, volume: Volume, color: Sequence[float], **settings: Any) -> bpy.types.Object:
    """Add a surface of the volume as an object."""
    result = reconstruct(volume, ReconstructionSettings(**settings))
    red, green, blue = color
    return add_reconstruction(result, scene, scale=SCALE, color=(red, green, blue))


def shader_of(obj: bpy.types.Object) -> Any:
    """Return the Principled node of an object's first material."""
    nodes = obj.data.materials[0].node_tree.nodes
    return next(node for node in nodes if node.type == "BSDF_PRINCIPLED")


def add_slice(scene: bpy.types.Scene, volume: Volume, number: int) -> None:
    """Add a slice of the CT as a picture at its position, with transparent air."""
    values = volume.values[number].astype(np.float32)
    rows, columns = values.shape
    pixels = np.ones((rows, columns, 4), np.float32)
    pixels[..., :3] = np.clip((values + 140) / 400, 0, 1)[..., None]
    pixels[..., 3] = values >= -500
    image = bpy.data.images.new("slice", columns, rows, alpha=True)
    image.pixels.foreach_set(pixels.ravel())
    corners = np.array([(-0.5, -0.5), (columns - 0.5, -0.5), (columns - 0.5, rows - 0.5), (-0.5, rows - 0.5)])
    index = np.column_stack([corners, np.full(4, float(number))])
    places = (index @ volume.affine[:3, :3].T + volume.affine[:3, 3]) * SCALE
    mesh = bpy.data.meshes.new("slice")
    mesh.from_pydata(places.tolist(), [], [(0, 1, 2, 3)])
    mesh.uv_layers.new().data.foreach_set("uv", np.array([0, 0, 1, 0, 1, 1, 0, 1], np.float32))
    material = bpy.data.materials.new("slice")
    mesh.materials.append(material)
    obj = bpy.data.objects.new("slice", mesh)
    scene.collection.objects.link(obj)
    shader, nodes, links = shader_of(obj), material.node_tree.nodes, material.node_tree.links
    texture = nodes.new("ShaderNodeTexImage")
    texture.image = image
    for name in ("Base Color", "Emission Color"):
        links.new(texture.outputs["Color"], shader.inputs[name])
    links.new(texture.outputs["Alpha"], shader.inputs["Alpha"])
    shader.inputs["Roughness"].default_value, shader.inputs["Emission Strength"].default_value = 0.8, 0.25


def look(
    scene: bpy.types.Scene, middle: Vector, azimuth: float, elevation: float, distance: float, lens: float
) -> None:
    """Point the camera at `middle` from these angles (degrees, 0 is the patient's front), and light it."""
    turn, rise = math.radians(azimuth), math.radians(elevation)
    direction = Vector((math.sin(turn) * math.cos(rise), math.cos(turn) * math.cos(rise), math.sin(rise)))
    aim(scene.camera, middle, direction * distance)
    scene.camera.data.lens = lens
    for watts, side, color, offset in LIGHTS:
        light = bpy.data.lights.new("light", "AREA")
        light.energy, light.size, light.color = watts, side, color
        obj = bpy.data.objects.new("light", light)
        aim(obj, middle, Vector(offset))
        scene.collection.objects.link(obj)


def aim(obj: bpy.types.Object, middle: Vector, offset: Vector) -> None:
    """Put an object beside `middle`, looking at it."""
    obj.location = middle + offset
    obj.rotation_euler = offset.to_track_quat("Z", "Y").to_euler()


def render(scene: bpy.types.Scene) -> Image.Image:
    """Return the picture that the scene's camera sees."""
    path = PICTURES / "frame.png"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    with Image.open(path) as picture:
        pixels = picture.convert("RGB")
    path.unlink()
    return pixels


def save_gif(frames: Sequence[Image.Image], path: Path, milliseconds: int) -> None:
    """Write an endless animation of 64 colors a frame."""
    palette = [frame.quantize(64, dither=Image.Dither.NONE) for frame in frames]
    palette[0].save(path, save_all=True, append_images=palette[1:], duration=milliseconds, loop=0, optimize=True)
    print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    sys.exit(main())
