"""What `make figures` runs: the pictures of docs/figures.md, each by the command that stands beside it.

The commands run on the phantom in out/figures; the page gets small copies.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path

from PIL import Image

from ctmc_addon.cli import main as ctmc

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "out" / "figures"
PAGE = ROOT / "docs" / "figures.md"
PICTURES = ROOT / "docs" / "pictures" / "figures"
DPI = "150"
MOST_BYTES = 150_000


def main() -> int:
    """Run the commands of the page on the phantom, and put their pictures beside it; 0 if all went well."""
    parser = argparse.ArgumentParser(description="The pictures of docs/figures.md.")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="pictures to make, such as sheet.png")
    chosen = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    PICTURES.mkdir(parents=True, exist_ok=True)
    if not (OUT / "ct" / "volume-0.nii.gz").exists() and ctmc(["phantom", str(OUT / "ct"), "--format", "nifti"]):
        return 1
    for words in commands(PAGE.read_text("utf-8")):
        name = words[words.index("-o") + 1]
        if not name.endswith(".png") or (chosen.only and name not in chosen.only):
            continue
        print(f"\n{name}", flush=True)
        if ctmc(in_folder(words, name)):
            return 1
        shrink(OUT / name, (PICTURES / name).with_suffix(".jpg"))
    return 0


def commands(page: str) -> list[list[str]]:
    """The words of every `ctmc figure` command in a page, without `ctmc`."""
    lines = page.replace("\\\n", " ").splitlines()
    return [shlex.split(line)[1:] for line in lines if line.startswith("ctmc figure ") and " -o " in line]


def in_folder(words: list[str], name: str) -> list[str]:
    """The same command with its files in `OUT`, and at the page's resolution."""
    placed = [str(OUT / word) if word == name or word.startswith("ct/") else word for word in words]
    return [*placed, "--dpi", DPI, "--no-blend"]


def shrink(source: Path, target: Path) -> None:
    """Copy a picture as a JPEG as good as a small one can be."""
    with Image.open(source) as picture:
        for quality in (92, 85, 75, 65):
            picture.convert("RGB").save(target, quality=quality, subsampling=0, optimize=True, dpi=(int(DPI), int(DPI)))
            if target.stat().st_size <= MOST_BYTES:
                return


if __name__ == "__main__":
    sys.exit(main())
