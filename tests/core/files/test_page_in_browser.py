# SPDX-License-Identifier: GPL-3.0-or-later
"""A page of structures in a real browser: what it shows, where, and in which color. Skipped without Chromium."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from ctmc_addon.core import Structure, write_structures
from ctmc_addon.core.maps.surface_map import SurfaceMap, statistics_of

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars",
    "--window-size=900,700", "--virtual-time-budget=8000", "--lang=de",
)  # fmt: skip
# Draws from the front; then cuts the front half away; then hides the first structure. Tells what is on the canvas.
LOOK = """
<script>
const seen = (() => {
  const { structures, apply, draw, lookFrom, cut } = window.CTMC, out = [];
  const look = () => {
    apply();
    draw();
    const canvas = document.getElementById("view"), gl = canvas.getContext("webgl2");
    const { width, height } = canvas, pixels = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    let left = width, right = 0, red = 0, blue = 0;
    for (let i = 0; i < width * height; i++) {
      const [r, , b, a] = pixels.subarray(4 * i, 4 * i + 4);
      if (a < 128) continue;
      left = Math.min(left, i % width);
      right = Math.max(right, i % width);
      if (r > b) red++; else blue++;
    }
    const bar = document.querySelector("#scale div").getBoundingClientRect().width / innerWidth * width;
    const letters = [...document.querySelectorAll("#sides span")].map((span) => span.textContent);
    const scale = document.querySelector("#scale span").textContent;
    out.push({ width: right - left + 1, red, blue, bar, letters, scale });
  };
  lookFrom([0, 1, 0]);
  look();
  cut.axis = "y";
  look();
  structures[0].shown = false;
  look();
  return out;
})();
document.body.dataset.seen = JSON.stringify({ looks: seen, rows: [...document.querySelectorAll(".row")].map((row) =>
  [row.querySelector("label").textContent, row.querySelector("output").textContent]) });
</script></body>"""


def box(name, low, high, rgb, volume_mm3):
    """A box in mm."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    quads = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
    faces = np.array([triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))], np.int32)
    vertices = (np.array(low) + corners * (np.array(high) - low)).astype(np.float32)
    return Structure(name, vertices, faces, rgb, 1.0, None, volume_mm3)


def seen_on(path, script):
    """What a script that is put at the end of a page writes to `data-seen`."""
    path.write_text(path.read_text("utf-8").replace("</body>", script), "utf-8")
    command = [CHROMIUM, *FLAGS, f"--user-data-dir={path.parent / 'profile'}", "--dump-dom", path.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    found = re.search(r'data-seen="([^"]*)"', done.stdout)
    assert found is not None, done.stderr[-2000:]
    return json.loads(found[1].replace("&quot;", '"'))


@pytest.mark.once
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")
def test_a_browser_shows_what_the_page_holds(tmp_path):
    front = box("vorn", (-50, 20, -20), (50, 40, 20), (220, 30, 30), 8e4)
    back = box("hinten", (-30, -40, -15), (30, 0, 15), (30, 30, 220), None)
    path = tmp_path / "page.html"
    write_structures(path, [front, back])
    seen = seen_on(path, LOOK)
    assert [name for name, _ in seen["rows"]] == ["vorn", "hinten"]
    assert re.fullmatch(r"80(?:[.,]0)? ml", seen["rows"][0][1])
    whole, cut, hidden = seen["looks"]
    # The bar says how many mm a pixel is; the box in front is 100 mm wide and hides the other.
    length, unit = whole["scale"].split()
    mm = float(length) * (10 if unit == "cm" else 1) / whole["bar"]
    assert whole["width"] * mm == pytest.approx(100, abs=1.5)
    assert whole["blue"] == 0
    assert whole["letters"] == ["L", "R", whole["letters"][2], "F"]
    # Half way from back to front the box in front is cut away whole.
    assert cut["width"] * mm == pytest.approx(60, abs=1.5)
    assert cut["red"] == 0
    assert cut["blue"] * mm * mm == pytest.approx(60 * 30, rel=0.05)
    assert hidden == cut


# Looks from the front at what the page starts with, then with the slider at its end, there with a cut, and at 0.
MOVE = """
<script>
const seen = (() => {
  const { structures, apply, draw, lookFrom, cut, exploded, camera, valueAt } = window.CTMC, out = [];
  const slider = document.getElementById("explode"), canvas = document.getElementById("view");
  const gl = canvas.getContext("webgl2");
  const look = () => {
    lookFrom([0, 1, 0]);
    apply();
    draw();
    const { width, height } = canvas, pixels = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    const mm = (camera.right - camera.left) / camera.zoom / width, rows = new Set();
    for (let i = 0; i < width * height; i++) if (pixels[4 * i + 3] > 127) rows.add(Math.floor(i / width));
    const filled = [...rows].sort((a, b) => a - b);
    const gap = Math.max(...filled.slice(1).map((row, at) => row - filled[at] - 1));
    const tops = structures.map(({ mesh }) => mesh.position.toArray());
    const point = camera.position.clone().set(0, 0, tops[1][2] + 10).project(camera);
    const value = valueAt((point.x + 1) / 2 * innerWidth, (1 - point.y) / 2 * innerHeight);
    const text = slider.nextSibling.textContent;
    out.push({ high: filled.length * mm, gap: gap * mm, tops, value, text, mm: exploded.mm });
  };
  const move = (mm) => { slider.value = mm; slider.oninput(); look(); };
  look();
  move(slider.max);
  cut.axis = "z";
  look();
  cut.axis = "";
  move(0);
  return out;
})();
document.body.dataset.seen = JSON.stringify(seen);
</script></body>"""


@pytest.mark.once
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")
def test_a_browser_moves_structures_apart(tmp_path):
    below = box("unten", (-20, -5, -20), (20, 5, 0), (220, 30, 30), None)
    above = box("oben", (-20, -5, 0), (20, 5, 20), (30, 30, 220), None)
    values = above.vertices[:, 2].copy()
    height = SurfaceMap("height", "mm", values, (0.0, 20.0), "magma", statistics_of(values, np.ones(len(values))))
    path = tmp_path / "page.html"
    write_structures(path, [below, replace(above, maps=(height,), shown="height")], explode=25.0)
    start, end, cut, whole = seen_on(path, MOVE)
    assert start["tops"] == end["tops"] == [[0, 0, -25], [0, 0, 25]]  # 10 mm would be twice the distances.
    assert (start["text"], start["mm"], end["text"]) == ("25 mm", 25, "25 mm")
    assert start["gap"] == pytest.approx(50, abs=1.5)
    assert start["high"] == pytest.approx(40, abs=1.5)
    assert start["value"] == pytest.approx(10, abs=0.3), "a value is read where the surface is seen"
    # A cut half way removes what is above, which lies beyond it as a whole.
    assert cut["high"] == pytest.approx(20, abs=1.5)
    assert cut["value"] is None
    assert whole["tops"] == [[0, 0, 0], [0, 0, 0]]
    assert (whole["text"], whole["gap"]) == ("0 mm", 0)
    assert whole["high"] == pytest.approx(40, abs=1.5)
    assert whole["value"] == pytest.approx(10, abs=0.3)


# Looks from the front. Tells the legend, and the color and the value at points given in mm of x and z; then with a cut,
# another map and none.
ASK = """
<script>
const seen = (() => {
  const { camera, cut, apply, draw, lookFrom, showMap, valueAt, structures } = window.CTMC, out = {};
  const canvas = document.getElementById("view"), gl = canvas.getContext("webgl2");
  const at = (x, z) => {
    const point = camera.position.clone().set(x, 0, z).project(camera);
    return [(point.x + 1) / 2 * innerWidth, (1 - point.y) / 2 * innerHeight];
  };
  const ask = (points) => points.map(([x, z]) => {
    const [left, top] = at(x, z), pixel = new Uint8Array(4), value = valueAt(left, top);
    gl.readPixels(left / innerWidth * canvas.width, (1 - top / innerHeight) * canvas.height, 1, 1, gl.RGBA,
      gl.UNSIGNED_BYTE, pixel);
    return { value: Number.isNaN(value) ? "none" : value, color: [...pixel] };
  });
  const look = () => { apply(); draw(); };
  lookFrom([0, 1, 0]);
  out.choices = [...document.querySelectorAll("#map option")].map((option) => option.textContent);
  out.chosen = document.getElementById("map").value;
  out.legend = [...document.querySelectorAll("#legend b, #legend li, #legend span")].map((part) => part.textContent);
  look();
  out.whole = ask(POINTS);
  cut.axis = "y";
  look();
  out.cut = ask(POINTS);
  cut.axis = "";
  structures[0].opacity = 0.5;
  look();
  out.glass = ask(POINTS);
  structures[0].opacity = 1;
  showMap("dose");
  look();
  out.dose = ask(POINTS);
  showMap("");
  look();
  out.plain = ask(POINTS);
  out.hidden = document.getElementById("legend").hidden;
  return out;
})();
document.body.dataset.seen = JSON.stringify(seen);
</script></body>"""


def with_map(structure, *maps, shown=""):
    """The structure with maps of (name, unit, values, range, ramp)."""
    made = [
        SurfaceMap(name, unit, values.astype(np.float32), range_, ramp, statistics_of(values, np.ones(len(values))))
        for name, unit, values, range_, ramp in maps
    ]
    return replace(structure, maps=tuple(made), shown=shown)


@pytest.mark.once
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")
def test_a_browser_shows_maps_their_legend_and_the_value_under_the_mouse(tmp_path):
    front = box("vorn", (-50, 20, -20), (50, 40, 20), (220, 30, 30), 8e4)
    back = box("hinten", (-80, -40, -15), (30, 0, 15), (30, 30, 220), None)
    x, z = front.vertices[:, 0].astype(float), front.vertices[:, 2].astype(float)
    dose = np.where(x > 0, np.nan, z)  # the right half has no value
    front = with_map(front, ("height_mm", "mm", z, (-20.0, 10.0), "viridis"), ("dose", "Gy", dose, (0.0, 2.0), "magma"),
                     shown="height_mm")  # fmt: skip
    back = with_map(back, ("height_mm", "mm", np.full(8, 7.25), (0.0, 20.0), "viridis"))
    # In the middle, higher, on the box behind alone, and beside both.
    points = [[0.2, 0.1], [20, 10], [-70, 5], [70, 0]]
    path = tmp_path / "page.html"
    write_structures(path, [front, back])
    seen = seen_on(path, ASK.replace("POINTS", json.dumps(points)))
    # The system, too, chooses the language.
    assert [seen["choices"][0], seen["legend"].pop()] in (["Einfarbig", "kein Wert"], ["Plain color", "no value"])
    assert seen["choices"][1:] == ["height (mm)", "dose (Gy)"]
    assert seen["chosen"] == "=height_mm"
    # Both structures have one range, around those of both.
    assert seen["legend"] == ["height (mm)", "-20", "-10", "0", "10", "20"]
    values = {kind: [each["value"] for each in seen[kind]] for kind in ("whole", "cut", "glass", "dose", "plain")}
    # The page keeps corners to 1/256 of an edge.
    assert values["whole"] == [pytest.approx(0.1, abs=0.1), pytest.approx(10, abs=0.1), 7.25, None]
    assert values["cut"] == [7.25, 7.25, 7.25, None]  # the front half is cut away
    assert values["glass"] == values["whole"]  # glass with the map has values, too
    # Less than half of the way from a corner without a value there is none.
    assert values["dose"][1:] == ["none", None, None]
    assert values["plain"] == [None] * 4
    colors = {kind: [each["color"] for each in seen[kind]] for kind in values}
    assert all(color[3] == 0 for color in (kind[3] for kind in colors.values()))
    # Half of viridis is a blue green, three quarters a green; without a map the boxes are red and blue.
    (red, green, blue, _), (red_2, green_2, blue_2, _) = colors["whole"][:2]
    assert green > 2 * red
    assert abs(green - blue) < 40
    assert green_2 > 1.3 * max(red_2, blue_2)
    red, green, blue, _ = colors["dose"][1]
    assert max(red, green, blue) - min(red, green, blue) < 12
    red, green, blue, _ = colors["plain"][0]
    assert red > 2 * max(green, blue)
    assert colors["dose"][2][2] > 2 * max(colors["dose"][2][:2])
    assert seen["hidden"]
