# SPDX-License-Identifier: GPL-3.0-or-later
"""Predicted and actual seconds of Reconstruct, through the panel's own operators.

    python3 -m benchmarks.predictions CT [--labels FILE] [--only label,label] [--shared]

Surfaces are made one after the other, so each prediction knows those above it. With `--shared`, on a machine that
others use, the clock is processor time.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from typing import Any

Case = tuple[str, Mapping[str, Any]]
BONE = {"goal": "none", "keep_parts": 0, "min_part_mm3": 0.0}
LABELS = {**BONE, "interfaces": "separate"}
OF_THRESHOLD: tuple[Case, ...] = (
    ("bone, the first surface", BONE),
    ("bone again", BONE),
    ("components above 10 mm3", {**BONE, "min_part_mm3": 10.0}),
    ("largest component", {**BONE, "keep_parts": 1}),
    ("90 % removed", {**BONE, "reduction": 0.9}),
    ("above 10 mm3, 80 % removed", {**BONE, "min_part_mm3": 10.0, "reduction": 0.8}),
)
OF_LABELS: tuple[Case, ...] = (
    ("separate", LABELS),
    ("separate again", LABELS),
    ("separate, 90 % removed", {**LABELS, "reduction": 0.9}),
    ("shared walls", {**LABELS, "interfaces": "shared"}),
    ("shared walls again", {**LABELS, "interfaces": "shared"}),
    ("shared walls, 90 % removed", {**LABELS, "interfaces": "shared", "reduction": 0.9}),
)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("ct", help="file or folder of a CT in HU")
    parser.add_argument("--threshold", type=float, default=200.0)
    parser.add_argument("--labels", help="file of labels on the grid of the CT")
    parser.add_argument("--only", help="names of labels, after all of them have been made together")
    parser.add_argument("--shared", action="store_true", help="count processor time")
    args = parser.parse_args()
    if args.shared:
        time.perf_counter = time.process_time  # type: ignore[assignment]
    import bpy

    import ctmc_addon

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    ctmc_addon.register()
    bpy.ops.ctmc.load(filepath=args.ct)
    settings = bpy.context.scene.ctmc
    settings.preview, settings.threshold = False, args.threshold
    print("| surface | triangles | predicted | taken | ratio |\n|---|---|---|---|---|")
    _print_rows("", OF_THRESHOLD)
    if args.labels:
        bpy.ops.ctmc.load_labels(filepath=args.labels)
        for names in (None, args.only.split(",")) if args.only else (None,):
            for item in settings.labels:
                item.chosen = names is None or item.name in names
            count = sum(item.chosen for item in settings.labels)
            _print_rows(f"{count} labels, ", OF_LABELS)


def _print_rows(prefix: str, cases: tuple[Case, ...]) -> None:
    """Make the surfaces of all cases, and print a row for each."""
    import bpy

    from ctmc_addon.ui.state import session
    from ctmc_addon.ui.viewport.surface import live

    scene = bpy.context.scene
    for name, values in cases:
        for setting, value in values.items():
            setattr(scene.ctmc, setting, value)
        live.start(scene, stale=True)
        while live.tick() is not None:
            pass
        cost = session.of(scene).cost
        if cost.error:
            print(f"| {prefix}{name} | {cost.error} | | | |")
            continue
        predicted, start = cost.seconds, time.perf_counter()
        bpy.ops.ctmc.reconstruct(new=True)
        taken = time.perf_counter() - start
        numbers = f"{cost.faces:,} | {predicted:.2f} s | {taken:.2f} s | {predicted / taken:.2f}"
        print(f"\n| {prefix}{name} | {numbers} |", flush=True)


if __name__ == "__main__":
    main()
