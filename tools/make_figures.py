# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `make figures`: render the pictures of docs/figures.md, each by the command beside it.

The commands run on the phantom in out/figures, and the page gets small copies. `make experiments` does the same for its
own page.
"""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from PIL import Image

from ctmc_addon.cli import main as ctmc

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "out" / "figures"
PAGE = ROOT / "docs" / "figures.md"
DPI = "150"
MOST_BYTES = 150_000


def main() -> int:
    """Run the commands of the page on the phantom, and put their pictures beside it; 0 if all went well."""
    parser = argparse.ArgumentParser(description="The pictures of docs/figures.md.")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="pictures to make, such as sheet.png")
    chosen = parser.parse_args()
    folder = OUT / "ct"
    if not (folder / "volume-0.nii.gz").exists() and ctmc(["phantom", str(folder), "--format", "nifti"]):
        return 1
    return render(PAGE, OUT, {"ct": folder}, chosen.only)


def render(page: Path, out: Path, inputs: Mapping[str, Path], only: Sequence[str] | None = None) -> int:
    """Run the figure commands of a page; 0 if all went well.

    Parameters
    ----------
    out : Path
        Where the pictures go; those that the page shows get small copies where it looks for them.
    inputs : mapping of str to Path
        Folders by the names that the commands have for them; a command with another input is left out.
    only : sequence of str, optional
        Pictures to make.
    """
    out.mkdir(parents=True, exist_ok=True)
    text = page.read_text("utf-8")
    shown = {Path(path).stem: page.parent / path for path in re.findall(r"\]\((pictures/[^)]+\.jpg)\)", text)}
    for words in commands(text):
        name = words[words.index("-o") + 1]
        has_input = any(word.partition("/")[0] in inputs for word in words)
        if not has_input or not name.endswith(".png") or (only and name not in only):
            continue
        print(f"\n{name}", flush=True)
        if ctmc([*(placed(word, inputs, out) for word in words), "--dpi", DPI, "--no-blend"]):
            return 1
        if Path(name).stem in shown:
            shrink(out / name, shown[Path(name).stem])
    return 0


def commands(page: str) -> list[list[str]]:
    """Return the words of every `ctmc figure` command in a page, without `ctmc`."""
    lines = page.replace("\\\n", " ").splitlines()
    return [shlex.split(line)[1:] for line in lines if line.startswith("ctmc figure ") and " -o " in line]


def placed(word: str, inputs: Mapping[str, Path], out: Path) -> str:
    """Return a word of a command with the real paths: inputs in their folders, pictures in `out`."""
    first, _, rest = word.partition("/")
    if first in inputs:
        return str(inputs[first] / rest)
    return str(out / word) if word.endswith(".png") else word


def shrink(source: Path, target: Path) -> None:
    """Copy a picture as a small JPEG of high quality."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with Image.open(source) as picture:
        for quality in (92, 85, 75, 65):
            picture.convert("RGB").save(target, quality=quality, subsampling=0, optimize=True, dpi=(int(DPI), int(DPI)))
            if target.stat().st_size <= MOST_BYTES:
                return


if __name__ == "__main__":
    sys.exit(main())
