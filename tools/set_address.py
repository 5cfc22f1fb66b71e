# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the project's address into all files that name it: `make address URL=https://host/owner/repository`.

The extension's manifest, the Python package, the citation and the site each have the address in a form of their own. A
checkout that was published nowhere has none. The releases' workflow compares it with the repository that it runs in.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from urllib.parse import urlsplit

ROOT = Path(__file__).resolve().parents[1]
# A file, the line that the address stands behind, and the line that holds it.
PLACES = (
    ("blender_manifest.toml", r"^tagline = .*\n", 'website = "URL"'),
    (
        "pyproject.toml",
        r"^dynamic = .*\n",
        'urls = { Homepage = "URL", Changelog = "URL/blob/main/CHANGELOG.md", Issues = "URL/issues" }',
    ),
    ("CITATION.cff", r"^type: software\n", 'repository-code: "URL"'),
    ("mkdocs.yml", r"^site_name: .*\n", 'repo_url: "URL"'),
)


def addresses(root: Path = ROOT) -> list[str]:
    """Return the address that each file names, "" where it names none."""
    named = []
    for name, _, line in PLACES:
        match = re.search(rf'^{re.escape(line.partition("URL")[0])}([^"]*)"', _text(root / name), re.MULTILINE)
        named.append(match[1] if match else "")
    return named


def set_address(url: str, root: Path = ROOT) -> None:
    """Write an address into all files, in place of the one that they name."""
    for name, after, line in PLACES:
        text = re.sub(rf"^{re.escape(line.partition('URL')[0])}.*\n", "", _text(root / name), flags=re.MULTILINE)
        place = re.search(after, text, re.MULTILINE)
        if place is None:
            raise ValueError(f"{name} has no line like {after}")
        text = text[: place.end()] + line.replace("URL", url) + "\n" + text[place.end() :]
        (root / name).write_text(text, encoding="utf-8", newline="\n")


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def main() -> int:
    """Set the address that the command line gives; without one, print the one that is there."""
    parser = argparse.ArgumentParser(description="Write the project's address into its files.")
    parser.add_argument("url", nargs="?", help="such as https://host/owner/repository")
    url = parser.parse_args().url
    if url is None:
        print(*sorted(set(addresses()) - {""}))
        return 0
    address = urlsplit(url)
    if address.scheme != "https" or not address.netloc or address.path.count("/") != 2 or url != url.rstrip("/"):
        print(f"'{url}' is not an address like https://host/owner/repository", file=sys.stderr)
        return 2
    set_address(url)
    return 0


if __name__ == "__main__":
    sys.exit(main())
