# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces made from labels against the true bodies, ours and the peers' in one run: `make accuracy`.

    benchmarks/environment.py benchmarks.labels blobs tubes     # some: blobs, torus, tubes, vessels, turned,
                                                                      # slices, time; --write-docs into accuracy.md

`slices` leaves out two of three slices of the label volumes named in LABELS, a list of paths parted by colons.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core import Budget, ReconstructionSettings, Volume, finish, marching_cubes, reconstruct
from ctmc_addon.core.smoothing.constrained import constrained_steps

from . import documents
from .label_bodies import BLOBS, Labelled, labelled, torus, tube, vessels
from .label_peers import PEERS, Mesh, compared, spacing_of

PAGE = Path(__file__).resolve().parents[1] / "docs" / "development" / "accuracy.md"
SPACINGS = {"5": (0.75, 0.75, 5.0), "2.5": (0.9, 0.9, 2.5), "1.6": (0.75, 0.75, 1.6)}
HEAD = f"{'':34s}{'mean':>8s}{'95 %':>8s}{'volume %':>10s}{'normals':>9s}{'s':>8s}"
COLUMNS = ["body", "spacing, mm", "mean, mm", "best peer", "ratio", "95 %, mm", "best peer", "ratio", "volume",
           "normals", "best peer"]  # fmt: skip


def ours(mask: NDArray[np.bool_], affine: NDArray[np.float64]) -> Mesh:
    volume = Volume(mask.astype(np.uint8), affine, kind="label")
    result = reconstruct(volume, ReconstructionSettings(label=1, smoothing="constrained"))
    assert result.wrong_side == 0
    assert result.mesh.closed
    return result.mesh.vertices.astype(np.float64), result.mesh.faces


def compare(name: str, cases: list[Labelled]) -> list[str]:
    """Print every method's figures, means over the cases; return the row of the page."""
    rows: dict[str, list[list[float]]] = {}
    for case in cases:
        for method, make in {**PEERS, "constrained": ours}.items():
            start = time.perf_counter()
            mesh = make(case.mask, case.affine)
            seconds = time.perf_counter() - start
            rows.setdefault(method, []).append([*compared(mesh, case).values(), seconds])
    spacing = " x ".join(f"{side:g}" for side in spacing_of(cases[0].affine))
    print(f"\n{name}, {spacing} mm\n{HEAD}")
    means = {}
    for method, figures in rows.items():
        numbers = np.array(figures)
        means[method] = mean = numbers.mean(axis=0)
        largest = numbers[np.abs(numbers[:, 2]).argmax(), 2]
        print(f"{method:34s}{mean[0]:8.3f}{mean[1]:8.3f}{largest:10.2f}{mean[3]:9.2f}{mean[4]:8.2f}", flush=True)
    mine = means.pop("constrained")
    cells = []
    for number in (0, 1):
        best = min(means, key=lambda method: means[method][number])
        least = means[best][number]
        cells += [f"{mine[number]:.3f}", f"{least:.3f}, {best}", f"{mine[number] / least:.2f}"]
    true = [mean[3] for method, mean in means.items() if max(abs(row[2]) for row in rows[method]) < 2]
    volume = max((row[2] for row in rows["constrained"]), key=abs)
    normals = [f"{mine[3]:.1f}°", f"{min(true):.1f}°" if true else "none within 2 %"]
    return [name, spacing, *cells, f"{volume:+.2f} %", *normals]


def dice(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    return 2 * int((a & b).sum()) / max(1, int(a.sum() + b.sum()))


def slices_left_out(mask: NDArray[np.bool_], spacing: tuple[float, float, float], keep: int = 3) -> dict[str, float]:
    """Print the Dice of slices between every third one: by linear interpolation, by signed distances, and ours."""
    from scipy.ndimage import distance_transform_edt

    mask = mask[: (len(mask) - 1) // keep * keep + 1]
    kept = mask[::keep]
    wide = (spacing[0], spacing[1], spacing[2] * keep)
    inside = [distance_transform_edt(layer, sampling=spacing[1::-1]) for layer in kept]
    outside = [distance_transform_edt(~layer, sampling=spacing[1::-1]) for layer in kept]
    signed = np.stack(
        [np.where(m, a - 0.5 * spacing[0], 0.5 * spacing[0] - b) if m.any() else np.full(m.shape, -20.0)
         for m, a, b in zip(kept, inside, outside, strict=True)]
    )  # fmt: skip
    field = finish(constrained_steps(kept, wide, slice_steps=keep)).values
    layers_of = {"linear": [], "signed distances": [], "constrained": []}
    truth = []
    for slice_ in range(len(mask)):
        below, step = divmod(slice_, keep)
        if step:
            share = step / keep
            truth.append(mask[slice_])
            layers_of["linear"].append(kept[below] * (1 - share) + kept[below + 1] * share >= 0.5)
            layers_of["signed distances"].append(signed[below] * (1 - share) + signed[below + 1] * share >= 0)
            layers_of["constrained"].append(field[slice_] >= 0)
    return {name: dice(np.array(layers), np.array(truth)) for name, layers in layers_of.items()}


def label_files() -> Iterator[tuple[str, NDArray[np.bool_], tuple[float, float, float]]]:
    """Yield organs of at least 3000 samples, cropped, from the label volumes in LABELS."""
    for path in filter(None, os.environ.get("LABELS", "").split(":")):
        if path.endswith(".nrrd"):
            import nrrd

            values, header = nrrd.read(path)
            spacing = tuple(float(s) for s in np.linalg.norm(header["space directions"][-3:], axis=1))
        else:
            import nibabel

            image = nibabel.load(path)
            values, spacing = np.asarray(image.dataobj), tuple(float(s) for s in image.header.get_zooms())
        for label in np.unique(values)[1:]:
            mask = np.ascontiguousarray((values == label).T)
            if mask.sum() >= 3000:
                ends = [np.flatnonzero(mask.any(axis=tuple({0, 1, 2} - {axis}))) for axis in range(3)]
                box = tuple(slice(max(0, int(at[0]) - 3), int(at[-1]) + 4) for at in ends)
                if len(ends[0]) >= 8:
                    yield f"{Path(path).name[:22]} {label}", mask[box], spacing  # type: ignore[misc]


def groups(chosen: list[str]) -> Iterator[tuple[str, list[Labelled]]]:
    """Return the bodies of every row."""
    if "blobs" in chosen:
        reach = {"drops": 42.0, "bean": 42.0}
        for spacing in SPACINGS.values():
            yield "five blobs", [labelled(body, spacing, reach.get(key, 37.0), 0.6) for key, body in BLOBS.items()]
    if "turned" in chosen:
        for spacing in SPACINGS.values():
            cases = [labelled(BLOBS[key], spacing, 37.0, 0.6, turn=25.0) for key in ("waves 2", "box")]
            yield "two blobs, axes turned by 25°", cases
    if "torus" in chosen:
        for spacing in SPACINGS.values():
            yield "torus", [labelled(torus, spacing, 34.0)]
    if "tubes" in chosen:
        for spacing in ((0.8, 0.8, 0.8), (0.75, 0.75, 1.6)):
            for wide in (2, 3, 4, 6):
                yield f"tube of {wide} pixels", [labelled(tube(wide * spacing[0]), spacing, 34.0, 0.25)]
    if "vessels" in chosen:
        for spacing in ((0.75, 0.75, 0.8), (0.75, 0.75, 1.6)):
            yield "branching vessels", [labelled(vessels(), spacing, 40.0, 0.3)]


def main(words: list[str]) -> int:
    """Print all that is asked for."""
    chosen = [word for word in words if not word.startswith("-")]
    rows = [compare(*group) for group in groups(chosen or ["blobs", "turned", "torus", "tubes", "vessels"])]
    if rows:
        text = documents.table(COLUMNS, rows)
        print(f"\n{text}")
        if "--write-docs" in words:
            page = documents.replaced(PAGE.read_text(encoding="utf-8"), "labels", text)
            PAGE.write_text(page, encoding="utf-8")
    if "slices" in chosen or (not chosen and os.environ.get("LABELS")):
        print(f"\nDice of slices left out, two of three\n{'':34s}{'linear':>8s}{'signed':>8s}{'ours':>8s}")
        everything = []
        for name, mask, spacing in label_files():
            values = [*slices_left_out(mask, spacing).values()]
            everything.append(values)
            print(f"{name:34s}" + "".join(f"{value:8.3f}" for value in values))
        if everything:
            print(f"{'mean':34s}" + "".join(f"{value:8.3f}" for value in np.mean(everything, axis=0)))
    if "time" in chosen or not chosen:
        times()
    return 0


def times() -> None:
    """Print seconds against surface size: one blob at finer and finer spacings."""
    from .label_bodies import harmonics

    print(f"\n{'samples':>12s}{'inside':>12s}{'triangles':>12s}{'s, 1 thread':>12s}{'s, 2':>8s}{'us a triangle':>15s}")
    for side in (2.0, 1.4, 1.0, 0.7, 0.5):
        case = labelled(harmonics(5, 45.0), (side, side, side * 1.25), 62.0, 8.0)
        seconds = []
        for threads in (1, 2):
            runs = []
            for _ in range(3):
                start = time.perf_counter()
                field = finish(constrained_steps(case.mask, spacing_of(case.affine), budget=Budget(threads)))
                runs.append(time.perf_counter() - start)
            seconds.append(min(runs))
        faces = len(marching_cubes(field.values, 0.0, normals=False).faces)
        print(
            f"{case.mask.size:12d}{case.mask.sum():12d}{faces:12d}{seconds[0]:12.2f}{seconds[1]:8.2f}"
            f"{1e6 * min(seconds) / faces:15.2f}"
        )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
