# SPDX-License-Identifier: GPL-3.0-or-later
"""A page of structures in a real browser: what it shows, where, and in which color. Skipped without Chromium."""

from __future__ import annotations

import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from ctmc_addon.core import Structure, write_structures

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


@pytest.mark.once
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")
def test_a_browser_shows_what_the_page_holds(tmp_path):
    front = box("vorn", (-50, 20, -20), (50, 40, 20), (220, 30, 30), 8e4)
    back = box("hinten", (-30, -40, -15), (30, 0, 15), (30, 30, 220), None)
    path = tmp_path / "page.html"
    write_structures(path, [front, back])
    path.write_text(path.read_text("utf-8").replace("</body>", LOOK), "utf-8")
    command = [CHROMIUM, *FLAGS, f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", path.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    found = re.search(r'data-seen="([^"]*)"', done.stdout)
    assert found is not None, done.stderr[-2000:]
    seen = json.loads(found[1].replace("&quot;", '"'))
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
