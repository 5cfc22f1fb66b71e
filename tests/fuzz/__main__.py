# SPDX-License-Identifier: GPL-3.0-or-later
"""`make fuzz`: whole files of every format, changed at random, each read with limits on memory and time.

SECONDS=600 SEED=1 FORMATS="nii npy" choose how long, which changes, and which formats. What was read is compared with a
second reader where there is one (peers.py). What should not have happened is listed once for each place in the code,
and one input for each is kept in out/fuzz.
"""

from __future__ import annotations

import argparse
import collections
import os
import random
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from ctmc_addon.core import Steps
from ctmc_addon.readers.dicom.pixels import stored

from . import worker
from .mutations import mutated
from .seeds import SEEDS

ROOT = Path(__file__).resolve().parents[2]
BATCH = 40  # inputs for one fork
IN_A_PROCESS = (
    0.2  # of the batches, one input each, are decoded as users have it, the others here, which takes milliseconds
)


def no_process_steps(_pixels: int) -> Steps[Any]:
    """Decode here."""
    yield from ()
    return None


def fuzz(seconds: float, seed: int, names: list[str]) -> int:
    """Fuzz for a while; returns how many different defects there were."""
    worker.load_libraries()
    chance = random.Random(seed)
    verdicts: collections.Counter[str] = collections.Counter()
    defects: dict[str, tuple[int, str]] = {}
    slowest, done, decoders_ended = 0.0, 0, 0
    with tempfile.TemporaryDirectory() as scratch:
        whole = {}
        for number, name in enumerate(names):
            folder = Path(scratch, f"whole{number}")
            folder.mkdir()
            whole[name] = SEEDS[name](folder).relative_to(folder)
            look = worker.look_at(folder / whole[name])
            if look.verdict not in ("volume", "surface", "not compared"):
                print(f"the whole {name} is not read: {look.verdict}, {look.text}", flush=True)
            elif look.verdict == "not compared":
                print(f"no second reader compares {name}: {look.text}", flush=True)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            in_process = chance.random() < IN_A_PROCESS
            batch = [changed(chance, Path(scratch), whole, number) for number in range(1 if in_process else BATCH)]
            looks = looked_at([path for _, path in batch], in_process)
            for number, ((name, path), look) in enumerate(zip(batch, looks, strict=True)):
                if look.is_defect and not in_process and "dicom" in name:
                    decoders_ended += 1
                    look = looked_at([path], True)[0]
                verdicts[look.verdict] += 1
                done += 1
                slowest = max(slowest, look.seconds)
                if look.is_defect:
                    what = f"{name}, " if look.verdict == "differs" else ""
                    key = f"{look.verdict}: {what}{look.text.partition(': ')[0]}"
                    count, text = defects.get(key, (0, ""))
                    if not count:
                        kept = ROOT / "out" / "fuzz" / f"{seed}-{done}"
                        shutil.copytree(Path(scratch, f"changed{number}"), kept, dirs_exist_ok=True)
                        text = f"{name}: {look.text}; {kept.relative_to(ROOT)}, {path.name}"
                        print(f"{key}: {text}", flush=True)
                    defects[key] = (count + 1, text)
                shutil.rmtree(Path(scratch, f"changed{number}"))
    counts = ", ".join(f"{count} {verdict}" for verdict, count in sorted(verdicts.items()))
    print(f"\n{done} inputs of {len(names)} formats in {seconds:.0f} s, seed {seed}: {counts}; slowest {slowest:.1f} s")
    print(f"{decoders_ended} ended a decoder, which in its own process is one sentence")
    for key, (count, text) in sorted(defects.items(), key=lambda pair: -pair[1][0]):
        print(f"{count:5} x {key} ({text})")
    return len(defects)


def changed(chance: random.Random, scratch: Path, whole: dict[str, Path], number: int) -> tuple[str, Path]:
    """A format, and what is to be opened of its whole files, of which one has been changed."""
    at = chance.randrange(len(whole))
    name = list(whole)[at]
    place = scratch / f"changed{number}"
    shutil.copytree(scratch / f"whole{at}", place)
    path = place / whole[name]
    victim = (
        path
        if path.is_file() and chance.random() < 0.8
        else chance.choice(sorted(each for each in place.rglob("*") if each.is_file()))
    )
    victim.write_bytes(mutated(chance, victim.read_bytes()))
    return name, victim if path.is_dir() and victim.parent == path and chance.random() < 0.2 else path


def looked_at(paths: list[Path], in_process: bool) -> list[worker.Look]:
    """Read paths, compressed pixels in a process of their own or here."""
    own = stored.started_steps
    try:
        if not in_process:
            stored.started_steps = no_process_steps
        return worker.look_at_all(paths)
    finally:
        stored.started_steps = own


def main() -> int:
    """Fuzz as the command line says; the exit code is 1 where there were defects."""
    parser = argparse.ArgumentParser(prog="make fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=float(os.environ.get("SECONDS") or 60))
    parser.add_argument("--seed", type=int, default=int(os.environ.get("SEED") or 1))
    parser.add_argument("--formats", nargs="*", default=(os.environ.get("FORMATS") or "").split())
    args = parser.parse_args()
    unknown = sorted(set(args.formats) - set(SEEDS))
    if unknown:
        parser.error(f"unknown formats {', '.join(unknown)}; there are {', '.join(SEEDS)}")
    return 1 if fuzz(args.seconds, args.seed, args.formats or list(SEEDS)) else 0


if __name__ == "__main__":
    sys.exit(main())
