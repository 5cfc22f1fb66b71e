# SPDX-License-Identifier: GPL-3.0-or-later
"""The wall that two labels share: how near the true one it is, beside the peers', and what simplification costs.

make interfaces                                          # balls cut by four walls drawn from a seed
WALLS=12 make interfaces                                 # by twelve
LABELS=organs.nii.gz:kidney.nii.gz make interfaces       # and these label volumes
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
import vtk
from numpy.typing import NDArray
from vtk.util.numpy_support import vtk_to_numpy

from ctmc_addon.core import Budget, ReconstructionSettings, Volume, finish, reconstruct_labels, simplify
from ctmc_addon.core.mesh.distance.surface_distance import surface_distance
from ctmc_addon.core.mesh.labels.label_complex import ComplexMesh
from ctmc_addon.core.simplification.complexes.simplify import simplify_complex_steps
from ctmc_addon.core.surfaces.interfaces import LabelComplex, complex_steps
from ctmc_addon.core.volume import chosen_labels_steps
from ctmc_addon.readers import read_volume

from .label_peers import Mesh, image_of, mesh_of

Floats = NDArray[np.float64]

RADIUS, PIXEL, WALLS = 30.0, 0.8, int(os.environ.get("WALLS", "4"))
SLICES = (5.0, 2.5, 1.6)
RATES = (0.5, 0.9, 0.98)


class Wall:
    """A wavy wall through a ball, along the slices or across them: its height over two coordinates, in mm."""

    def __init__(self, seed: int, across: bool) -> None:
        rng = np.random.default_rng(seed)
        self.axes = (1, 2, 0) if across else (0, 1, 2)
        self.amplitude = rng.uniform(3.0, 5.0)
        self.lengths, self.phases = rng.uniform(8.0, 12.0, 2), rng.uniform(0.0, 6.0, 2)
        self.tilt, self.offset = rng.uniform(-0.2, 0.2, 2), rng.uniform(0.0, 1.0, 3)

    def height(self, u: Floats, v: Floats) -> Floats:
        (p, q), (s, t) = self.lengths, self.phases
        return self.amplitude * np.sin(u / p + s) * np.cos(v / q + t) + self.tilt[0] * u + self.tilt[1] * v

    def slopes(self, u: Floats, v: Floats) -> tuple[Floats, Floats]:
        (p, q), (s, t) = self.lengths, self.phases
        along = self.amplitude / p * np.cos(u / p + s) * np.cos(v / q + t) + self.tilt[0]
        return along, -self.amplitude / q * np.sin(u / p + s) * np.sin(v / q + t) + self.tilt[1]

    def labels(self, gap: float) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
        """Return a ball of label 1, with label 2 beyond the wall, and the affine."""
        spacing = np.array([PIXEL, PIXEL, gap])
        counts = (2 * (RADIUS + 2 * spacing) / spacing).astype(int)
        axes = [(np.arange(n) - n / 2 + o) * s for n, o, s in zip(counts, self.offset, spacing, strict=True)]
        z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
        u, v, w = ((x, y, z)[axis] for axis in self.axes)
        values = np.where(x**2 + y**2 + z**2 < RADIUS**2, np.where(w > self.height(u, v), 2, 1), 0)
        affine = np.diag([*spacing, 1.0])
        affine[:3, 3] = [axis[0] for axis in axes]
        return values.astype(np.uint8), affine

    def distances(self, mesh: Mesh) -> tuple[float, float]:
        """Return mean and 95 % distance of triangles to the wall, by area, each at four points."""
        corners = np.asarray(mesh[0], np.float64)[mesh[1]]  # (f, 3, 3)
        middle = corners.mean(axis=1)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        points = np.concatenate([middle, *((corners[:, corner] + middle) / 2 for corner in range(3))])
        u, v, w = (points[:, axis] for axis in self.axes)
        a, b = u.copy(), v.copy()
        for _ in range(60):  # down to the nearest point of the wall
            away, (along, aside) = self.height(a, b) - w, self.slopes(a, b)
            a, b = a - 0.6 * (a - u + away * along), b - 0.6 * (b - v + away * aside)
        distance = np.sqrt((a - u) ** 2 + (b - v) ** 2 + (self.height(a, b) - w) ** 2)
        order, weight = np.argsort(distance), np.tile(area, 4)
        share = np.cumsum(weight[order]) / weight.sum()
        return float((distance * weight).sum() / weight.sum()), float(distance[order][np.searchsorted(share, 0.95)])


def complex_of(volume: Volume) -> LabelComplex:
    labels = finish(chosen_labels_steps(volume, ["all"]))
    return finish(complex_steps(volume, ReconstructionSettings(close_border=True), labels, all_needed=False))


def ours(values: NDArray[np.uint8], affine: NDArray[np.float64]) -> Mesh:
    mesh = complex_of(Volume(values, affine, kind="label")).surface.at(1.0)
    return mesh.vertices, mesh.faces[(mesh.sides == (2, 1)).all(axis=1)]


def surface_nets(values: NDArray[np.uint8], affine: NDArray[np.float64]) -> Mesh:
    nets = vtk.vtkSurfaceNets3D()
    nets.SetInputData(image(values, affine))
    nets.SetLabel(0, 1)
    nets.SetLabel(1, 2)
    nets.SetOutputMeshTypeToTriangles()
    nets.Update()
    sides = vtk_to_numpy(nets.GetOutput().GetCellData().GetArray("BoundaryLabels"))
    vertices, faces = mesh_of(nets.GetOutput())
    return vertices + affine[:3, 3], faces[(np.sort(sides, axis=1) == (1, 2)).all(axis=1)]


def joint_sinc(values: NDArray[np.uint8], affine: NDArray[np.float64], factor: float) -> Mesh:
    """Smooth jointly as 3D Slicer does: flying edges of all labels at once, one windowed sinc filter."""
    edges = vtk.vtkDiscreteFlyingEdges3D()
    edges.SetInputData(image(values, affine))
    edges.SetValue(0, 1)
    edges.SetValue(1, 2)
    clean = vtk.vtkCleanPolyData()
    clean.SetInputConnection(edges.GetOutputPort())
    clean.Update()
    before, faces = mesh_of(clean.GetOutput())
    sinc = vtk.vtkWindowedSincPolyDataFilter()
    sinc.SetInputConnection(clean.GetOutputPort())
    sinc.SetNumberOfIterations(int(20 + factor * 40))
    sinc.BoundarySmoothingOff()
    sinc.FeatureEdgeSmoothingOff()
    sinc.SetPassBand(10 ** (-4 * factor))
    sinc.NonManifoldSmoothingOn()
    sinc.NormalizeCoordinatesOn()
    sinc.Update()
    # A point stands halfway between two samples: of the wall are those between 1 and 2.
    index = before / np.diag(affine)[:3] + 1
    padded = np.pad(values, 1)
    low, high = np.floor(index + 1e-3).astype(int), np.ceil(index - 1e-3).astype(int)
    between = np.sort([padded[at[:, 2], at[:, 1], at[:, 0]] for at in (low, high)], axis=0)
    return mesh_of(sinc.GetOutput())[0] + affine[:3, 3], faces[(between.T == (1, 2)).all(axis=1)[faces].all(axis=1)]


def image(values: NDArray[np.uint8], affine: NDArray[np.float64]) -> vtk.vtkImageData:
    """Return the labels as an image whose first sample is at 0; `image_of` does so for a mask."""
    image = image_of(values > 0, tuple(np.diag(affine)[:3]))
    vtk_to_numpy(image.GetPointData().GetScalars())[:] = np.pad(values, 1).ravel()
    return image


def walls_table() -> None:
    methods: dict[str, Callable[..., Mesh]] = {"ours": ours, "SurfaceNets": surface_nets}
    for factor in (0.3, 0.5, 0.7):
        methods[f"joint sinc {factor}"] = lambda values, affine, factor=factor: joint_sinc(values, affine, factor)
    print(f"A ball of {RADIUS:g} mm cut by {WALLS} walls: distance to the wall, mean / 95 %, mm")
    print(f"{'wall':>6}{'slices':>8}" + "".join(f"{name:>17}" for name in methods) + "   ours to best peer, both ways")
    for seed, gap in product(range(WALLS), SLICES):
        means: dict[str, list[float]] = {name: [] for name in methods}
        for across in (False, True):
            wall = Wall(seed, across)
            labels = wall.labels(gap)
            wall_distances = {name: wall.distances(method(*labels)) for name, method in methods.items()}
            cells = "".join(f"{mean:9.3f} / {most:5.2f}" for mean, most in wall_distances.values())
            for name, (mean, _) in wall_distances.items():
                means[name].append(mean)
            ratio = means["ours"][0] + means["ours"][-1], min(sum(own) for own in list(means.values())[1:])
            end = f"{ratio[0] / ratio[1]:10.2f}" if across else ""
            print(f"{'across' if across else 'along':>6}{gap:8g}{cells}{end}", flush=True)


def reversed_share(mesh: ComplexMesh) -> float:
    """Return the share of wall triangles that occur reversed in the neighbor's own surface."""
    keys = {label: oriented(mesh, label) for label in mesh.labels}
    reversed_count = total = 0
    for one, other in sorted({tuple(sorted(wall[:2])) for wall in mesh.interfaces}):
        if one:
            total += int((np.sort(mesh.sides, axis=1) == (one, other)).all(axis=1).sum())
            turned = {(a, c, b) for a, b, c in keys[other]}
            reversed_count += len({(*each[k:], *each[:k]) for each in keys[one] for k in range(3)} & turned)
    return reversed_count / max(1, total)


def oriented(mesh: ComplexMesh, label: int) -> set[tuple[bytes, ...]]:
    own = mesh.of_label(label)
    corners = [vertex.tobytes() for vertex in own.vertices]
    return {(corners[a], corners[b], corners[c]) for a, b, c in own.faces.tolist()}


def labels_table(path: str) -> None:
    volume, one = read_volume(path), Budget(threads=1)
    complex = complex_of(volume)
    mesh = complex.surface.at(1.0)
    large = [label for label in complex.labels if complex.label_mm3[label] > 1000 * float(np.prod(volume.spacing))]
    worst = max((abs(complex.volumes_mm3[label] / complex.label_mm3[label] - 1) for label in large), default=0.0)
    print(f"\n{Path(path).name}: {len(mesh.labels)} labels, {len(mesh.faces):,} triangles")
    print(f"volume, worst of {len(large)} labels of more than 1,000 voxels: {100 * worst:.2f} %")
    print(f"triangles of walls that occur reversed in the neighbor: {100 * reversed_share(mesh):.1f} %")
    seconds = []
    for interfaces in ("shared", "separate"):
        settings, start = ReconstructionSettings(interfaces=interfaces), time.process_time()
        reconstruct_labels(volume, settings, budget=one)
        seconds.append(time.process_time() - start)
    print(f"time, processor seconds: shared {seconds[0]:.1f}, separate {seconds[1]:.1f}, {seconds[0] / seconds[1]:.2f}")
    print("Mean error of a label simplified with the others to that of its full surface simplified by the same rate:")
    print(f"{'rate':>6}{'asked':>10}{'made':>10}{'alone':>10}{'median':>8}{'90 %':>7}{'<= 1.1':>10}"
          f"{'crossings':>11}{'reversed':>10}{'s':>7}{'s alone':>9}")  # fmt: skip
    for rate in RATES:
        start = time.process_time()
        joint = finish(simplify_complex_steps(mesh, reduction=rate, budget=one))
        ours_s = time.process_time() - start
        ratios, separate_s, separate_faces = [], 0.0, 0
        for label in joint.mesh.labels:
            error = surface_distance(joint.mesh.of_label(label), mesh.of_label(label))
            full, start = mesh.of_label(label), time.process_time()
            separate = simplify(full, reduction=rate, budget=one)
            separate_s, separate_faces = separate_s + time.process_time() - start, separate_faces + len(separate.faces)
            ratios.append(error.mean / surface_distance(separate, full).mean)
        asked, own = round(len(mesh.faces) * (1 - rate)), f"{sum(r <= 1.1 for r in ratios)} of {len(ratios)}"
        print(f"{rate:6g}{asked:10,}{len(joint.mesh.faces):10,}{separate_faces:10,}{np.median(ratios):8.2f}"
              f"{np.quantile(ratios, 0.9):7.2f}{own:>10}{joint.self_intersections or 0:11}"
              f"{100 * reversed_share(joint.mesh):8.1f} %{ours_s:7.1f}{separate_s:9.1f}", flush=True)  # fmt: skip


def main() -> int:
    walls_table()
    for path in filter(None, os.environ.get("LABELS", "").split(":")):
        labels_table(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
