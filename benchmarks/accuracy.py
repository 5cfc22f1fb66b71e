# SPDX-License-Identifier: GPL-3.0-or-later
"""Print how near the surface comes to the truth; with --write-docs also into docs/development/accuracy.md.

Area, volume and normals of bodies in closed form over resolutions, the phantom's tumors over stride and alpha,
the thickness of walls, and solids. The same numbers come on every machine. tests/core/test_accuracy.py holds them.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core import ReconstructionSettings, reconstruct
from ctmc_addon.core.maps.thickness import Thickness
from ctmc_addon.core.phantom.phantom import phantom
from ctmc_addon.core.volume.affine import transform_normals

from .documents import replaced, table
from .shapes import EVEN, SHAPES, UNEVEN, Shape, angles, errors, extracted, order
from .solid_accuracy import solids_table
from .walls import WALLS, Wall, mapped, sampled, surface_of, truth, values_of

PAGE = Path(__file__).resolve().parents[1] / "docs" / "development" / "accuracy.md"
STEPS = (2.0, 1.0, 0.5, 0.25)  # Millimeters; along z times 1 or 2.5.
FINE = STEPS[1:]  # Orders use these: at 2 mm the torus' tube is three voxels wide.
THICKNESS_STEPS, THICKNESS_DEGREES = (1.0, 0.5), 25.0
ALPHAS = (0.0, 0.5, 1.0)
SMOOTHINGS: dict[str, dict[str, Any]] = {
    "no": {"smoothing": "none"},
    "Gaussian, 0.75 mm": {"smoothing_mm": 0.75},
    "Gaussian, 1.5 mm": {"smoothing_mm": 1.5},
    "constrained": {"smoothing": "constrained"},
}


def main() -> int:
    """Print all tables."""
    sections = {
        "geometry": geometry_table(),
        "alpha": alpha_table(),
        "normals": normals_table(),
        "tumors": tumors_table(),
        "thickness": thickness_table(),
        "solids": solids_table(),
    }
    for text in sections.values():
        print(text, end="\n\n")
    if "--write-docs" in sys.argv[1:]:
        page = PAGE.read_text(encoding="utf-8")
        for name, text in sections.items():
            page = replaced(page, name, text)
        PAGE.write_text(page, encoding="utf-8")
        print(f"written: {PAGE.name}")
    return 0


def geometry_table() -> str:
    """Print area and volume errors at alpha 1."""
    rows = []
    for shape in SHAPES.values():
        for spacings in (EVEN, UNEVEN):
            error_pairs = [errors(shape, at(step, spacings)) for step in STEPS]
            for number, what in enumerate(("area", "volume")):
                values = [pair[number] for pair in error_pairs]
                power = order(list(FINE), values[-len(FINE) :])
                rows.append([f"{shape.name}, {what}", voxel(spacings), *map(percent, values), f"{power:.2f}"])
    return table(["body", "voxel", *(f"{step:g} mm" for step in STEPS), "order"], rows)


def alpha_table() -> str:
    """Print area and volume errors of the sphere at smaller alphas."""
    rows = []
    for spacings in (EVEN, UNEVEN):
        for alpha in ALPHAS:
            error_pairs = [errors(SHAPES["sphere"], at(step, spacings), alpha) for step in STEPS]
            for number, what in enumerate(("area", "volume")):
                values = [percent(pair[number]) for pair in error_pairs]
                rows.append([f"{what}, alpha {alpha:g}", voxel(spacings), *values])
    return table(["sphere", "voxel", *(f"{step:g} mm" for step in STEPS)], rows)


def normals_table() -> str:
    """Print the mean and the greatest angle between normals of surface and body."""
    rows = []
    for shape in SHAPES.values():
        if shape.gradient is None:
            continue
        for spacings in (EVEN, UNEVEN):
            off = [normal_angles(shape, at(step, spacings)) for step in FINE]
            powers = [order(list(FINE), [pair[number] for pair in off]) for number in range(2)]
            cells = [f"{mean:.3f}° / {greatest:.2f}°" for mean, greatest in off]
            rows.append([shape.name, voxel(spacings), *cells, f"{powers[0]:.2f} / {powers[1]:.2f}"])
    return table(["body", "voxel", *(f"{step:g} mm" for step in FINE), "order"], rows)


def normal_angles(shape: Shape, spacing: tuple[float, float, float]) -> tuple[float, float]:
    """Return the mean and the greatest angle, degrees."""
    mesh = extracted(shape, spacing, normals=True)
    assert shape.gradient is not None
    normals = transform_normals(np.diag([*spacing, 1.0]), mesh.normals)
    off = angles(normals, shape.gradient(mesh.vertices.astype(np.float64)))
    return float(off.mean()), float(off.max())


def tumors_table() -> str:
    """Print the volume of the phantom's tumors against their true volume."""
    rows = []
    for slices in (29, 250):
        phantom_of_slices = phantom(slices)
        true = sum(phantom_of_slices.tumour_volumes_mm3)
        x, y, z = phantom_of_slices.labels.spacing
        for word, smoothing in SMOOTHINGS.items():
            for side in (1, 2, 3):
                cells = []
                for alpha in ALPHAS:
                    settings = ReconstructionSettings(
                        label=2, stride=(side, side, 1), alpha=alpha, normals="mesh", **smoothing
                    )
                    cells.append(percent(reconstruct(phantom_of_slices.labels, settings).mesh.volume / true - 1))
                size = f"{slices} slices, {x:.2f} x {y:.2f} x {z:.2f} mm"
                rows.append([size, word, f"{side} x {side}", *cells])
    return table(["phantom", "smoothed", "stride", *(f"alpha {alpha:g}" for alpha in ALPHAS)], rows)


def thickness_table() -> str:
    """Print the errors of thickness at the vertices of bodies of known thickness: median, 95 %, and median signed."""
    rows = []
    for wall in WALLS.values():
        for label in (False, True):
            cells = []
            for spacing in THICKNESS_STEPS:
                off = thickness_errors(wall, spacing, THICKNESS_DEGREES, label)
                middle, most = np.percentile(np.abs(off), (50, 95))
                cells.append(f"{100 * middle:.2f} % / {100 * most:.2f} % / {100 * np.median(off) + 0.0:+.2f} %")
            rows.append([wall.name, "label" if label else "field", *cells])
    return table(["body", "volume", *(f"{spacing:g} mm" for spacing in THICKNESS_STEPS)], rows)


def thickness_errors(wall: Wall, spacing: float, degrees: float, label: bool) -> NDArray[np.float64]:
    """Return the relative errors of thickness where it has a closed form."""
    volume = sampled(wall, spacing, degrees, label)
    mesh = surface_of(volume, label)
    off = values_of(Thickness(), mapped(mesh, volume, label=label)) / truth(wall, mesh, degrees) - 1
    return off[np.isfinite(truth(wall, mesh, degrees))]


def at(step: float, spacings: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the spacing along x, y, z, mm."""
    return (step * spacings[0], step * spacings[1], step * spacings[2])


def voxel(spacings: tuple[float, float, float]) -> str:
    """Return proportions as text, such as `1 : 1 : 2.5`."""
    return " : ".join(f"{side:g}" for side in spacings)


def percent(share: float) -> str:
    """Return a signed percentage with its significant digits."""
    return f"{100 * share:+.2f} %" if abs(share) >= 1e-3 else f"{100 * share:+.3f} %"


if __name__ == "__main__":
    sys.exit(main())
