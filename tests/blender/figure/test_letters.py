# SPDX-License-Identifier: GPL-3.0-or-later
"""The letters of figures: told apart, whole, of their size, and inside the file."""

from __future__ import annotations

import itertools
import subprocess
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.figure.letters import CAP, CHARACTERS, FILE, text_curve

ROOT = Path(__file__).resolve().parents[3]


def triangles(scene, body, size=1.0):
    """What a text fills, (n, 3, 2), in units of its size."""
    obj = bpy.data.objects.new("text", text_curve(body, size))
    scene.collection.objects.link(obj)
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    mesh.calc_loop_triangles()
    corners = np.array([vertex.co[:2] for vertex in mesh.vertices])
    faces = np.array([triangle.vertices[:] for triangle in mesh.loop_triangles]).reshape(-1, 3)
    evaluated.to_mesh_clear()
    bpy.data.batch_remove([obj, obj.data])
    return corners[faces]


def bitmap(filled, pixels=48):
    """(pixels, pixels) bool: where the middle of a pixel of the unit square from (0, -0.25) lies in a triangle."""
    middles = (np.arange(pixels) + 0.5) / pixels
    points = np.stack(np.meshgrid(middles, middles - 0.25), axis=-1)[:, :, None]  # (y, x, 1, 2)
    a, b, c = (filled[None, None, :, corner] for corner in range(3))

    def side(p, q):
        return (q[..., 0] - p[..., 0]) * (points[..., 1] - p[..., 1]) - (q[..., 1] - p[..., 1]) * (
            points[..., 0] - p[..., 0]
        )

    sides = np.stack([side(a, b), side(b, c), side(c, a)])
    return ((sides >= 0).all(axis=0) | (sides <= 0).all(axis=0)).any(axis=-1)


def regions(mask):
    """How many pieces of more than a few pixels a mask has, its pixels joined by their sides."""
    left, count = mask.copy(), 0
    while left.any():
        piece = np.zeros_like(left)
        piece[tuple(np.argwhere(left)[0])] = True
        while True:
            grown = piece.copy()
            grown[1:] |= piece[:-1]
            grown[:-1] |= piece[1:]
            grown[:, 1:] |= piece[:, :-1]
            grown[:, :-1] |= piece[:, 1:]
            grown &= left
            if (grown == piece).all():
                break
            piece = grown
        left &= ~piece
        count += bool(piece.sum() > 4)
    return count


def test_digits_and_letters_that_other_fonts_draw_alike_differ(scene):
    shown = {letter: bitmap(triangles(scene, letter)) for letter in "1Il|0Oo"}
    for first, second in itertools.combinations(shown, 2):
        assert (shown[first] ^ shown[second]).sum() > 0.1 * shown[first].sum(), f"{first} looks like {second}"


@pytest.mark.parametrize(("letters", "holes"), [("RPADOabdegopq0469Å", 1), ("B8%Ø", 2), ("kKXZNtfy57SI1lµ±×≥", 0)])
def test_every_letter_has_the_holes_it_should(scene, letters, holes):
    for letter in letters:
        shown = np.pad(bitmap(triangles(scene, letter)), 1)
        assert regions(~shown) - 1 == holes, letter


def test_letters_are_of_the_size_in_every_blender(scene):
    capital = triangles(scene, "H", 2.0)
    assert np.ptp(capital[..., 1]) == pytest.approx(2.0 * CAP, rel=2e-3)
    assert capital[..., 1].min() == pytest.approx(0.0, abs=1e-4)
    assert np.ptp(triangles(scene, "m" * 10)[..., 0]) == pytest.approx(8.000, rel=2e-3)


def test_the_font_is_in_the_file_once_and_names_no_folder(scene):
    first, second = text_curve("a", 1.0), text_curve("b", 1.0)
    assert first.font == second.font
    assert first.font.packed_file.size == FILE.stat().st_size < 30_000
    assert first.font.filepath == f"//{FILE.name}"


def test_every_character_of_the_font_is_in_it_and_others_come_from_blender(scene):
    missing = triangles(scene, "\ue000")
    shapes = {letter: triangles(scene, letter) for letter in sorted(CHARACTERS) if letter.isalnum()}
    assert all(shape.shape != missing.shape or not np.allclose(shape, missing) for shape in shapes.values())
    liver = triangles(scene, "肝")
    assert liver.shape != missing.shape  # not an empty box
    looks = text_curve("a肝b", 1.0).body_format
    assert [part.use_bold for part in looks] == [False, True, False]


def test_the_license_lies_beside_the_font_and_both_are_packed():
    text = FILE.with_name("COPYING.txt").read_text("utf-8")
    assert "GNU Freefont contributors" in text
    assert "either version 3 of the License, or (at your option) any later version" in text
    listed = subprocess.run(
        ["git", "ls-files", str(FILE.parent)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listed.returncode == 0 and listed.stdout:
        assert {"COPYING.txt", FILE.name} <= {Path(line).name for line in listed.stdout.split()}
    assert '"ctmc_addon.blender.figure.letters" = ["*.woff2", "COPYING.txt"]' in (ROOT / "pyproject.toml").read_text(
        "utf-8"
    )
