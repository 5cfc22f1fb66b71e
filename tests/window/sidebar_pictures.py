# SPDX-License-Identifier: GPL-3.0-or-later
"""`make sidebar-pictures CT=PATH`: the pictures of docs/sidebar.md, taken in a windowed Blender 5.2.

They are of the phantom unless a CT is given, such as LIDC-IDRI-0314 of The Cancer Imaging Archive (CC BY 3.0), of
which the committed ones are. One Blender goes the newcomer's way, another through the page's steps in their order. The
whole screens are kept in out/sidebar, their parts that the page shows in docs/pictures/sidebar. `ARGS=--seconds` goes
the newcomer's way alone and prints its seconds; those pictures are in out/sidebar alone. `ARGS="--draw tumor"` makes a
structure of structure_pictures.py alone, for docs/segmenting.md.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from PIL import Image
from window import newcomer, structure_pictures
from window.desk import Desk
from window.provision import NoWindowError, provide, require_means, used

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "out" / "sidebar"
SHOWN = ROOT / "docs" / "pictures" / "sidebar"
SUITE = "sid"
SCAN = 10  # pixels between two looks at what is under the mouse
SIZE = (1300, 1400)  # a window so high that every page is seen whole, with its folds open
COLORS = 192  # of a picture, to keep the file small
BELOW, FOLDS = 36, 256  # pixels below the last button of a page; numbers of a map and closed folds follow it
VIEW = 560  # pixels of the viewport beside the sidebar
DISTANCE = 9.0  # of the eye
TUMOR = (40.5, 14.8, 2.8)  # of the phantom, mm
STEPS_WITHOUT_PICTURE = (7, 8)  # of the newcomer's way: color and slice are in the picture of the cut
MOST_BYTES = 400_000  # a render is the largest: its noise does not compress
LIMIT = 900.0  # seconds of a render, or of 45 pictures of a patient's bone, without a graphics card
IDLE = "ours('ui.jobs').running() is None"
COUNTED = "ours('ui.state.session').of(bpy.context.scene).cost is not None"
QUIET = "ours('ui.viewport.surface.live').live.changed is None"
SCENE = """
bpy.data.batch_remove([*bpy.data.objects, *bpy.data.meshes, *bpy.data.materials])
open_fold("maps", "rotation", "figure")
space = viewport().space
space.show_region_ui, space.overlay.show_floor, space.overlay.show_cursor = True, False, False
space.overlay.show_axis_x = space.overlay.show_axis_y = space.show_gizmo = space.show_region_toolbar = False
space.overlay.show_text = space.overlay.show_outline_selected = space.overlay.show_object_origins = False
"""
# From the patient's front, right and head; the middle of the CT stands at (x, y) of the screen.
LOOK_AT = """
from mathutils import Euler, Vector
about = viewport().space.region_3d
about.view_perspective, about.view_distance = "ORTHO", {distance}
about.view_rotation = Euler(({tilt}, 0, 2.75)).to_quaternion()
about.view_location = (0.0, 0.0, 0.0)
about.update()
right, up = (about.view_rotation @ Vector(axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
middle = sum(ours("core.volume").volume_box(ours("ui.state.ct.volumes").current(bpy.context.scene))) / 8 * 0.01
(x, y), (u, _) = on_screen(middle), on_screen(middle + right)
about.view_location = right * ((x - {x}) / (u - x)) + up * (({y} - y) / (u - x))
"""
BEGIN = """
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.{operator}("INVOKE_DEFAULT"{options})
"""
# A job that waits for its picture once it is so far.
HOLD = """
job = ours("ui.jobs").running()
go_on = job.advance
job.advance = lambda: None if job.step.fraction > 0.6 else go_on()
"""
# The CT with its slice at a height in mm, and no surface.
ALONE = """
scene = bpy.context.scene
bpy.data.batch_remove(list(bpy.data.meshes))
heights = ours("core.volume").volume_box(ours("ui.state.ct.volumes").current(scene))[:, 2]
scene.ctmc_view.show_slice, scene.ctmc_view.plane = True, "axial"
scene.ctmc_view.position = ({height} - heights.min()) / (heights.max() - heights.min())
"""
PROGRESS = "(lambda job: None if job is None else job.step.fraction)(ours('ui.jobs').running())"
TABLE = "ours('ui.state.session').of(bpy.context.scene).rotation"


def main() -> int:
    """Take every picture; 0 if all went well, or if this machine has no means for a window."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ct", type=Path, help="file or folder of a CT in HU; the phantom without it")
    parser.add_argument("--threshold", type=float, default=200.0, help="HU (%(default)g)")
    parser.add_argument(
        "--click", type=float, nargs=3, default=TUMOR, metavar=("R", "A", "S"), help="mm, where to draw"
    )
    parser.add_argument("--seconds", action="store_true", help="time the newcomer's way, and keep no picture of it")
    parser.add_argument(
        "--draw",
        nargs="+",
        choices=[*structure_pictures.RECIPES],
        default=[],
        help="make these structures alone, of the CT that docs/segmenting.md names",
    )
    asked = parser.parse_args()
    try:
        require_means()
        provide(SUITE)
        with used(SUITE) as root:
            package, phantom = make()
            ct = asked.ct or phantom
            if asked.draw:
                draw_structures(root, package, ct, asked.draw)
                return 0
            go_the_newcomers_way(root, package, ct, shown=not asked.seconds)
            if asked.seconds:
                return 0
            desk = Desk(root, OUT, SIZE, LIMIT)
            try:
                prepare(desk, package, ct)
                take(desk, asked.threshold)
                take_drawing(desk, asked.click)
            finally:
                desk.close()
    except NoWindowError as reason:
        print(f"The pictures of the sidebar are left out: {reason}")
    return 0


def make() -> tuple[Path, Path]:
    """The extension's zip and the phantom's CT."""
    for command in (
        ["tools/build_extension.py", "--platform=linux-x64", f"--output={OUT}"],
        ["-m", "ctmc_addon", "phantom", str(OUT / "ct"), "--format", "nifti"],
    ):
        subprocess.run([sys.executable, *command], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    (package,) = OUT.glob("*.zip")
    return package, OUT / "ct" / "volume-0.nii.gz"


def draw_structures(root: Path, package: Path, ct: Path, names: Sequence[str]) -> None:
    """Make structures of a CT in the sidebar, one after the other."""
    desk = Desk(root, OUT, structure_pictures.SIZE, LIMIT)
    try:
        desk.install(package)
        path = desk.bring(ct)
        desk.open()
        for name in names:
            structure_pictures.make_structure(desk, path, name, write)
    finally:
        desk.close()


def go_the_newcomers_way(root: Path, package: Path, ct: Path, *, shown: bool) -> None:
    """Install the zip and go all the way to a render, a picture for every step."""
    desk = Desk(root, OUT / "newcomer", newcomer.SIZE, LIMIT)
    try:
        seconds = newcomer.install(desk, package)
        path = desk.bring(ct)
        if ct.is_dir():
            path = f"{path}/{min(ct.iterdir()).name}"  # any slice will do
        desk.open()
        desk.ask("open_fold('cuts')")
        person = newcomer.go(desk, path, seconds, keep_step if shown else lambda *_: None)
        if shown:
            newcomer.go_on(person)
    finally:
        desk.close()


def keep_step(number: int, picture: Image.Image) -> None:
    """Keep a picture of the newcomer's way for the page, where it shows that step."""
    if number not in STEPS_WITHOUT_PICTURE:
        write(f"newcomer-{number}", picture)


def prepare(desk: Desk, package: Path, ct: Path) -> None:
    """A Blender with the extension, its sidebar open, and the CT loaded without its table."""
    desk.install(package)
    volume = desk.bring(ct)
    desk.open()
    desk.ask(SCENE)
    desk.wait("bring_tab('CTMC')")
    desk.ask(f"bpy.context.scene.ctmc.preview = False; bpy.ops.ctmc.load(filepath='{volume}', remove_table=True)")


def take(desk: Desk, threshold: float) -> None:
    """A picture for every page of the tab."""
    desk.ask(f"s = bpy.context.scene.ctmc; s.threshold = {threshold}; s.stride = (2, 2, 1)")
    desk.wait(COUNTED)
    keep_page(desk, "load", "CT", view=False)
    desk.ask("bpy.context.scene.ctmc.preview = True")
    desk.wait(f"{QUIET} and {COUNTED}")
    keep_page(desk, "surface", "SURFACE")
    desk.ask("s = bpy.context.scene.ctmc; s.preview = False; s.goal = 'reduction'; s.ratio = 0.1")
    desk.ask(BEGIN.format(operator="reconstruct", options="") + HOLD)
    desk.wait(f"{PROGRESS} > 0.6")
    keep_page(desk, "reconstruct", "SURFACE", view=False)
    desk.ask("del ours('ui.jobs').running().advance")
    desk.wait(IDLE)
    desk.ask("bpy.context.scene.ctmc_view.show_slice = False")
    desk.ask(BEGIN.format(operator="map_add", options=", quantity='deviation'"))
    desk.wait(f"{IDLE} and viewport().space.shading.color_type == 'VERTEX'")
    keep_page(desk, "results", "RESULTS", below=FOLDS)
    desk.ask("bpy.context.scene.ctmc.rotation_step = 120")  # software draws slowly
    desk.ask(BEGIN.format(operator="rotation_test", options=""))
    desk.wait(f"{TABLE} is not None and {IDLE}")
    desk.show("RENDER")
    rows = rows_of(desk)
    top, bottom = rows["bpy.ops.ctmc.rotation_test()"] - 6, rows["bpy.ops.ctmc.rotation_save()"] + 28
    keep(desk, "rotation", top, bottom, view=False)
    desk.ask("bpy.ops.ctmc.map_show()")
    keep(desk, "figure", rows["bpy.ops.ctmc.render()"] - 120, rows["bpy.ops.ctmc.figure()"] + 28)


def take_drawing(desk: Desk, click: Sequence[float]) -> None:
    """The page Draw, with a structure that grew from a click, in mm."""
    desk.ask(ALONE.format(height=click[2]))
    desk.ask(f"bpy.ops.ctmc.draw_tool(tool='ctmc.grow'); bpy.ops.ctmc.draw_grow(point_mm={tuple(click)})")
    desk.wait(f"{IDLE} and {QUIET}")
    keep_page(desk, "draw", "DRAW", tilt=0.6)


def keep_page(desk: Desk, name: str, page: str, *, view: bool = True, tilt: float = 1.15, below: int = BELOW) -> None:
    """Keep a page from its row of buttons to so many pixels below its last button."""
    desk.show(page)
    heights = [y for button, y in rows_of(desk).items() if button]
    keep(desk, name, min(heights) - 20, max(heights) + below, view=view, tilt=tilt)


def rows_of(desk: Desk) -> dict[str, int]:
    """Where on the screen the fields and buttons of the page are."""
    left, top, width, height = box(desk)
    x = left + round(0.65 * width)
    found: dict[str, int] = {}
    for y in range(top + SCAN, top + height, SCAN):
        found.setdefault(desk.under(x, y), y)
    desk.move(left // 2, top + 10)
    return found


def box(desk: Desk) -> list[int]:
    """Left, top, width and height of the sidebar on the screen."""
    answer: list[int] = desk.ask("""
view = viewport()
bar = view.sidebar
answer = [bar.x, view.window.height - bar.y - bar.height, bar.width, bar.height]
""")
    return answer


def keep(desk: Desk, name: str, top: int, bottom: int, *, view: bool = True, tilt: float = 1.15) -> None:
    """Keep a strip of the sidebar between two rows, with the viewport beside it unless told, as a small PNG."""
    left, _, width, _ = box(desk)
    desk.ask(LOOK_AT.format(distance=DISTANCE, tilt=tilt, x=left - VIEW // 2, y=(top + bottom) // 2))
    write(name, desk.look(name).crop((left - (VIEW if view else 0), top, left + width, bottom)))


def write(name: str, part: Image.Image) -> None:
    """Keep a picture of the page, which must be small."""
    target = SHOWN / f"{name}.png"
    target.parent.mkdir(parents=True, exist_ok=True)
    part.quantize(COLORS, dither=Image.Dither.NONE).save(target, "PNG", optimize=True)
    size = target.stat().st_size
    assert size <= MOST_BYTES, f"{target.name} has {size} bytes"
    print(f"{target.relative_to(ROOT)}: {part.width} x {part.height}, {size} bytes", flush=True)


if __name__ == "__main__":
    sys.exit(main())
