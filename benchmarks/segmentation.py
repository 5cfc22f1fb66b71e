# SPDX-License-Identifier: GPL-3.0-or-later
"""How many clicks a structure takes, ours and the peers' in one run: `make segmentation`.

    benchmarks/environment.py benchmarks.segmentation ball liver tumor --clicks 6 --without random_walker

A simulated user clicks the most interior voxel of the largest error, in the structure where voxels are missing and in
its surroundings where there are too many, and again. Cases are phantoms, and patients below CTMC_TEST_CT (by default
shared/data beside the checkout) where they are. Peers see a box around the truth alone, ours the whole CT; FastMarching
stops at the time that is best for the truth, which no user knows. 3D Slicer's grow-from-seeds is in no package; GrowCut
here is its shortest paths, by SciPy.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ctmc_addon import readers
from ctmc_addon.core import SettingsError, Volume, finish
from ctmc_addon.core.segmentation import Click, compete_steps, connected_steps
from ctmc_addon.core.segmentation.distance import grown_window, squared_distances, window_of
from ctmc_addon.core.smoothing.gaussian import convolved, weights
from ctmc_addon.core.smoothing.label_components import label_components_steps
from ctmc_addon.core.volume import ValueKind, to_index, transform_points

Mask = NDArray[np.bool_]
DATA = Path(os.environ.get("CTMC_TEST_CT", Path(__file__).resolve().parents[3] / "shared" / "data"))
ORGANS = {"spleen": 1, "kidney": 2, "gallbladder": 4, "liver": 5, "vertebra": 28, "aorta": 52, "vena cava": 63,
          "portal vein": 64, "hip": 77}  # fmt: skip
SIMULATED_TUMORS = {8: (16, 282, 228), 12: (2, 212, 188), 20: (4, 298, 168), 30: (7, 237, 223)}  # {mm: position}
SIMULATED_HU, SIMULATED_BLUR_MM = -40.0, 1.0
ROOM_MM = 30.0  # Peers see this margin around the truth.
GOAL = 0.8
SHOWN = (1, 2, 4, 6, 10, 12)


class Case(NamedTuple):
    """A CT, and the structure that is to be drawn."""

    name: str
    ct: Volume
    truth: Mask


def dice(first: Mask, second: Mask) -> float:
    """Return twice the voxels of both by the voxels of each."""
    return float(2 * np.count_nonzero(first & second) / (np.count_nonzero(first) + np.count_nonzero(second)))


def next_click(drawn: Mask, case: Case) -> Click | None:
    """Return the most interior voxel of the largest component of the error."""
    components = finish(label_components_steps(drawn ^ case.truth))
    if not len(components.voxels):
        return None
    largest = np.arange(len(components.voxels)) == len(components.voxels) - 1
    at = np.stack(components.samples(largest)[:3], axis=1)
    low, high = at.min(axis=0) - 1, at.max(axis=0) + 2
    outside = np.ones(high - low, bool)
    outside[tuple((at - low).T)] = False
    deep = squared_distances(outside, case.ct.spacing)[tuple((at - low).T)]
    z, y, x = at[int(deep.argmax())].tolist()
    return Click((z, y, x), int(case.truth[z, y, x]))


def value_limits(case: Case, clicks: list[Click], smooth: NDArray[np.float32]) -> tuple[float, float]:
    """Return mean and 2.5 standard deviations of smoothed values within two voxels of the structure's clicks."""
    own = []
    for click in clicks:
        if click.structure:
            z, y, x = (slice(max(0, at - 2), at + 3) for at in click.sample)
            own.append(smooth[z, y, x][case.truth[z, y, x]])  # the user clicks well inside
    values = np.concatenate(own)
    return float(values.mean() - 2.5 * values.std()), float(values.mean() + 2.5 * values.std())


Method = Callable[[Case, list[Click], NDArray[np.float32]], Mask]


def compete(case: Case, clicks: list[Click], smooth: NDArray[np.float32]) -> Mask:
    """Segment with our `compete`."""
    return finish(compete_steps(case.ct, clicks)) == 1


def connected(case: Case, clicks: list[Click], smooth: NDArray[np.float32]) -> Mask:
    """Segment with our `connected` in the value range of the clicks, through openings of two voxels."""
    low, high = value_limits(case, clicks, smooth)
    allowed = (smooth >= low) & (smooth <= high)
    for click in clicks:
        if not click.structure:
            z, y, x = (slice(max(0, at - 1), at + 2) for at in click.sample)
            allowed[z, y, x] = False
    own = [click.sample for click in clicks if click.structure]
    try:
        return finish(connected_steps(allowed, own, case.ct.spacing, opening_mm=2 * min(case.ct.spacing)))
    except SettingsError:
        return finish(connected_steps(allowed, own, case.ct.spacing))


def image_of(values: NDArray[np.float32], case: Case):
    """Return values as SimpleITK's image."""
    import SimpleITK as sitk

    image = sitk.GetImageFromArray(values)
    image.SetSpacing(case.ct.spacing)
    return image


def seeds_of(clicks: list[Click], structure: int) -> list[tuple[int, int, int]]:
    """Return clicks in SimpleITK's order."""
    return [click.sample[::-1] for click in clicks if click.structure == structure]


def connected_threshold(case: Case, clicks: list[Click], smooth: NDArray[np.float32]) -> Mask:
    """Segment with SimpleITK's ConnectedThreshold."""
    import SimpleITK as sitk

    low, high = value_limits(case, clicks, smooth)
    return sitk.GetArrayFromImage(sitk.ConnectedThreshold(image_of(smooth, case), seeds_of(clicks, 1), low, high)) > 0


def confidence_connected(case: Case, clicks: list[Click], smooth: NDArray[np.float32]) -> Mask:
    """Segment with SimpleITK's ConfidenceConnected."""
    import SimpleITK as sitk

    seeds = seeds_of(clicks, 1)
    segmented = sitk.ConfidenceConnected(image_of(smooth, case), seeds, 3, 2.5, 1, 1)
    return sitk.GetArrayFromImage(segmented) > 0


def fast_marching(case: Case, clicks: list[Click], smooth: NDArray[np.float32]) -> Mask:
    """Segment with SimpleITK's FastMarching from both kinds of clicks, stopped at the best time for the truth."""
    import SimpleITK as sitk

    gradient = sitk.GradientMagnitude(image_of(smooth, case))
    speed = sitk.Exp(-gradient / 10.0) + 1e-3
    times = []
    for structure in (1, 0):
        seeds = seeds_of(clicks, structure)
        arrived = sitk.GetArrayFromImage(sitk.FastMarching(speed, seeds)) if seeds else np.full(smooth.shape, np.inf)
        times.append(arrived)
    own = np.where(times[0] < times[1], times[0], np.inf)
    inside = own[case.truth & np.isfinite(own)]
    stops = np.percentile(inside, np.arange(5, 101, 5)) if inside.size else [0.0]
    return max((own <= stop for stop in stops), key=lambda mask: dice(mask, case.truth))


def random_walker(case: Case, clicks: list[Click], smooth: NDArray[np.float32]) -> Mask:
    """Segment with scikit-image's random_walker; the border of the box is background."""
    from skimage.segmentation import random_walker as walk

    labels = np.full(smooth.shape, 2, np.int32)
    labels[1:-1, 1:-1, 1:-1] = 0
    for click in clicks:
        labels[click.sample] = 1 if click.structure else 2
    segmented = walk(np.clip(smooth, -200, 400), labels, beta=130, mode="cg_j", tol=1e-2, spacing=case.ct.spacing[::-1])
    return segmented == 1


def grow_cut(case: Case, clicks: list[Click], smooth: NDArray[np.float32]) -> Mask:
    """Segment as 3D Slicer's grow-from-seeds, by SciPy: least sums of differences over 26 neighbors.

    Zhu, Kolesov, Gao, Kikinis and Tannenbaum 2014, An effective interactive medical image segmentation method using
    fast GrowCut; as Slicer's vtkImageGrowCut with its default seed locality, 0.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    numbers = np.pad(np.arange(smooth.size, dtype=np.int32).reshape(smooth.shape), 1, constant_values=-1)
    ends = []
    for step in [step for step in np.ndindex(3, 3, 3) if step > (1, 1, 1)]:
        ahead = numbers[tuple(slice(at, at + count) for at, count in zip(step, smooth.shape, strict=True))].ravel()
        ends.append((np.flatnonzero(ahead >= 0).astype(np.int32), ahead[ahead >= 0]))
    first, second = (np.concatenate(each) for each in zip(*ends, strict=True))
    values = smooth.ravel()
    differences = np.abs(values[first] - values[second]) + np.float32(
        1e-3
    )  # SciPy takes no difference for no neighbors
    both = np.concatenate([first, second]), np.concatenate([second, first])
    graph = coo_array((np.tile(differences, 2), both), (smooth.size, smooth.size)).tocsr()
    inside = np.zeros(smooth.shape, bool)
    seeds = np.ones(smooth.shape, bool)
    seeds[1:-1, 1:-1, 1:-1] = False
    for click in clicks:
        seeds[click.sample], inside[click.sample] = True, bool(click.structure)
    nearest = dijkstra(graph, indices=np.flatnonzero(seeds), min_only=True, return_predecessors=True)[2]
    segmented: Mask = inside.ravel()[nearest].reshape(smooth.shape)
    return segmented


OURS: dict[str, Method] = {"compete": compete, "connected": connected}
PEERS: dict[str, Method] = {
    "ConnectedThreshold": connected_threshold,
    "ConfidenceConnected": confidence_connected,
    "FastMarching": fast_marching,
    "random_walker": random_walker,
    "GrowCut": grow_cut,
}


def smoothed(case: Case) -> NDArray[np.float32]:
    """Return values smoothed by 1 mm, for methods that look at single voxels."""
    values = case.ct.values.astype(np.float32)
    for axis, mm in enumerate(reversed(case.ct.spacing)):
        values = convolved(values, weights(1.0 / mm), axis)
    return values


def boxed(case: Case) -> Case:
    """Return the case around its truth."""
    window = window_of(case.truth)
    assert window is not None
    z, y, x = grown_window(window, ROOM_MM, case.ct.spacing, case.truth.shape)
    part = case.ct.cropped((x.start, y.start, z.start), (x.stop, y.stop, z.stop))
    return Case(case.name, part, case.truth[z, y, x])


def session(case: Case, method: Method, most: int) -> tuple[list[float], float]:
    """Return the Dice after every click, and the processor seconds of the longest."""
    drawn, clicks, scores, longest = np.zeros(case.truth.shape, bool), [], [], 0.0
    smooth = smoothed(case)
    for _ in range(most):
        click = next_click(drawn, case)
        if click is None:
            break
        clicks.append(click)
        start = time.process_time()
        drawn = method(case, clicks, smooth)
        longest = max(longest, time.process_time() - start)
        scores.append(dice(drawn, case.truth))
    return scores, longest


def clicks_to(scores: list[float], goal: float) -> float:
    """Return the first click with the goal reached, infinite where none has."""
    return next((number for number, score in enumerate(scores, 1) if score >= goal), np.inf)


def phantoms() -> dict[str, Callable[[], Case]]:
    """Return noisy phantoms by name: neighboring balls, and a branching vessel."""

    def simulated_case(name: str, inside: Mask, neighbor: Mask, spacing: tuple[float, float, float]) -> Case:
        noise = np.random.default_rng(1).normal(0, 15, inside.shape)
        values = np.where(inside, 60, np.where(neighbor, 105, 30)) + noise
        return Case(name, Volume(values.astype(np.int16), np.diag([*spacing, 1.0]), kind="HU"), inside)

    def grid(shape: tuple[int, int, int], spacing: tuple[float, float, float]) -> NDArray[np.float64]:
        return np.indices(shape) * np.array(spacing[::-1])[:, None, None, None]

    def ball() -> Case:
        spacing = (1.0, 1.0, 2.0)
        at = grid((36, 72, 72), spacing)
        inside = ((at - 34.0) ** 2).sum(axis=0) < 12**2
        neighbor = ((at - np.array([34.0, 34.0, 26.0])[:, None, None, None]) ** 2).sum(axis=0) < 27**2
        return simulated_case("ball", inside, neighbor & ~inside, spacing)

    def vessel() -> Case:
        at = grid((64, 64, 64), (1.0, 1.0, 1.0))
        bend = 32 + 10 * np.sin(at[0] / 12)
        inside = (at[1] - bend) ** 2 + (at[2] - 32) ** 2 < 4.5**2
        branch = (at[1] - 32 - (at[0] - 32) * 0.8) ** 2 + (at[2] - 32 - (at[0] - 32) * 0.5) ** 2 < 3.5**2
        case = simulated_case("vessel", inside | (branch & (at[0] > 32)), np.zeros(inside.shape, bool), (1.0, 1.0, 1.0))
        values = np.where(case.truth, 150, 60) + np.random.default_rng(2).normal(0, 15, inside.shape)
        return case._replace(ct=Volume(values.astype(np.int16), np.eye(4), kind="HU"))

    return {"ball": ball, "vessel": vessel}


def organ(name: str) -> Case:
    """Return an organ of TotalSegmentator's example."""
    ct = readers.read_volume(DATA / "ts_nifti" / "example_ct.nii.gz")
    labels = readers.read_volume(DATA / "ts_nifti" / "example_seg_fast_force_split.nii.gz")
    hu = Volume(ct.values, ct.affine, kind=ValueKind.HU)
    return Case(name, hu, labels.values == ORGANS[name])


def tumor() -> Case:
    """Return the lung tumor of IBSI's phantom, its mask put on the CT's grid."""
    ct = readers.read_volume(DATA / "ibsi_lung_tumor" / "dicom" / "image")
    mask = readers.read_volume(DATA / "ibsi_lung_tumor" / "nifti_mask" / "mask.nii.gz")
    at = np.argwhere(mask.values > 0)[:, ::-1]
    place = np.rint(to_index(ct.affine, transform_points(mask.affine, at))).astype(int)
    truth = np.zeros(ct.shape, bool)
    truth[tuple(place.T[::-1])] = True
    assert np.count_nonzero(truth) == len(at)
    return Case("tumor", ct, truth)


def simulated_tumor(diameter_mm: float, middle: tuple[int, int, int]) -> Case:
    """Return a tumor that was made: an uneven ball, blurred, taken off a patient's liver, whose noise it keeps."""
    ct = readers.read_volume(DATA / "ts_dicom_j2k")
    sides = np.array(ct.spacing[::-1])
    away = (np.indices(ct.shape) - np.reshape(middle, (3, 1, 1, 1))) * sides[:, None, None, None]
    distance = np.sqrt((away**2).sum(axis=0))
    z, y, x = away / np.maximum(distance, 1e-6)
    radius = diameter_mm / 2 * (1 + 0.2 * z * y + 0.1 * np.cos(5 * x + y))
    truth = distance < radius
    share = truth.astype(np.float32)
    for axis, side in enumerate(sides):
        share = convolved(share, weights(SIMULATED_BLUR_MM / side), axis)
    values = (ct.values + SIMULATED_HU * share).round().astype(np.int16)
    return Case(f"made tumor {diameter_mm} mm", Volume(values, ct.affine, kind=ValueKind.HU), truth)


def cases() -> dict[str, Callable[[], Case]]:
    """Return the available cases by name."""
    makers = phantoms()
    if (DATA / "ibsi_lung_tumor").is_dir():
        makers["tumor"] = tumor
    if (DATA / "ts_nifti").is_dir():
        makers |= {name: lambda name=name: organ(name) for name in ORGANS}
    if (DATA / "ts_dicom_j2k").is_dir():
        makers |= {
            f"made tumor {mm} mm": lambda mm=mm, at=at: simulated_tumor(mm, at) for mm, at in SIMULATED_TUMORS.items()
        }
    return makers


def main() -> None:
    """Print Dice, clicks and seconds of every method, and our ratios to the best peer."""
    makers = cases()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", help=f"some of: {', '.join(makers)}")
    parser.add_argument("--clicks", type=int, default=12)
    parser.add_argument("--without", action="append", default=[], choices=[*OURS, *PEERS])
    args = parser.parse_args()
    for name in args.cases or makers:
        case = makers[name]()
        small = boxed(case)
        print(f"\n{name}: {np.count_nonzero(case.truth)} voxels of {case.truth.size}, Dice after clicks")
        print(f"{'':24s}{''.join(f'{number:>7d}' for number in SHOWN)}{'best':>7s}   clicks to {GOAL}  cpu s, longest")
        reached: dict[str, tuple[float, float, float]] = {}
        for title, method in {**OURS, **PEERS}.items():
            if title in args.without:
                continue
            scores, seconds = session(case if title == "compete" else small, method, args.clicks)
            goal = clicks_to(scores, GOAL)
            shown = "".join(f"{scores[at - 1]:7.3f}" if at <= len(scores) else f"{'':7s}" for at in SHOWN)
            print(f"{title:24s}{shown}{max(scores):7.3f}{goal:13.0f}{seconds:13.2f}", flush=True)
            reached[title] = (goal, scores[-1], seconds)
        peers = {title: figures for title, figures in reached.items() if title in PEERS}
        ours = {title: figures for title, figures in reached.items() if title in OURS}
        if peers and ours:
            best = min(peers, key=lambda title: (peers[title][0], -peers[title][1]))
            mine = min(ours, key=lambda title: (ours[title][0], -ours[title][1]))
            clicks = ours[mine][0] / peers[best][0] if np.isfinite(peers[best][0]) else 0.0
            left = (1 - ours[mine][1]) / (1 - peers[best][1])
            print(
                f"{mine} to {best}: clicks {clicks:.2f}{' (the peer never)' if not clicks else ''}, what is missing to "
                f"Dice 1 at the end {left:.2f}, seconds {ours[mine][2] / peers[best][2]:.2f}"
            )


if __name__ == "__main__":
    main()
