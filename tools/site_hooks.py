# SPDX-License-Identifier: GPL-3.0-or-later
"""Make further pages for MkDocs: a gallery, a reference of Python, the pages of the checkout's root.

Nothing of it is stored: the gallery shows the pictures of the pages with the commands that stand above them there, the
reference is made from docstrings, and the root's pages are copied with their links turned.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any, NamedTuple

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
OF_ROOT = {
    name: f"{name.removesuffix('.md').lower()}.md" for name in ("CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md")
}
GALLERY = ("figures.md", "interfaces.md", "index.md", "segmenting.md", "simulation.md", "experiments.md", "sidebar.md")
"""Pages whose pictures stand in the gallery, in this order."""
COMMANDS_BY_FOLDER = {
    "readme": "make readme-pictures CT=FOLDER",
    "sidebar": 'make sidebar-pictures CT=FOLDER ARGS="--click 60.4 -146.5 -489.8"',
    "experiments": "make experiments",
}
"""Commands of folders of pictures that no command of their page names."""
PYTHON = {
    "Read": ["ctmc_addon.readers.read_volume", "ctmc_addon.readers.open_volume", "ctmc_addon.readers.ReadingOptions"],
    "Volumes": ["ctmc_addon.core.Volume"],
    "Reconstruct": [
        f"ctmc_addon.core.{name}"
        for name in (
            "reconstruct",
            "reconstruct_labels",
            "ReconstructionSettings",
            "Budget",
            "Reconstruction",
            "finish",
        )
    ],
    "Surfaces": [f"ctmc_addon.core.{name}" for name in ("TriangleMesh", "marching_cubes", "simplify", "distances")],
    "Files": ["ctmc_addon.core.save_structures", "ctmc_addon.core.write_structures"],
    "Structures from points": [
        f"ctmc_addon.core.segmentation.{name}"
        for name in (
            "range_mask_steps",
            "connected_steps",
            "Click",
            "compete_steps",
            "between_slices_steps",
            "margin_steps",
            "islands_steps",
            "holes_filled_steps",
            "brushed_window",
            "combined",
            "change_of",
        )
    ],
    "Errors": ["ctmc_addon.core.CtmcError", "ctmc_addon.core.ReadError", "ctmc_addon.core.SettingsError"],
}

# Commands of the gallery are read, not scrolled; tables of numbers fit a page.
STYLE = """\
.md-typeset .grid pre > code { white-space: pre-wrap; overflow-wrap: anywhere; }
.md-typeset table:not([class]) :is(th, td) { min-width: 0; padding: 0.5em 0.6em; }
.md-typeset td[style*="right"] { white-space: nowrap; }
"""


class Picture(NamedTuple):
    """A picture of a page, and the command above it."""

    page: str
    heading: str
    text: str
    path: str
    command: str


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    pages = {place: (ROOT / name).read_text(encoding="utf-8") for name, place in OF_ROOT.items()}
    pages["site.css"] = STYLE
    pages |= {"gallery.md": gallery(Path(config.docs_dir)), "python.md": python_reference()}
    for place, text in pages.items():
        files.append(File.generated(config, place, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn links between docs/ and the root to where the pages are in the site."""
    place = page.file.src_uri
    inside = posixpath.dirname(place)
    for name, target in OF_ROOT.items():
        up = posixpath.relpath(posixpath.join("..", name), inside or ".")
        here = posixpath.relpath(target, inside or ".")
        markdown = markdown.replace(f"]({name if place in OF_ROOT.values() else up}", f"]({here}")
    return markdown.replace("](docs/", "](") if place in OF_ROOT.values() else markdown


def gallery(docs: Path) -> str:
    """Return the page of all pictures, each with the command that made it."""
    shown: list[str] = []
    for name in GALLERY:
        pictures = pictures_of(name, (docs / name).read_text(encoding="utf-8"))
        if pictures:
            title = re.search(r"^# (.*)$", (docs / name).read_text(encoding="utf-8"), re.MULTILINE)
            shown.append(f'\n## {title[1] if title else name}\n\n<div class="grid cards" markdown>\n')
            shown += [card(picture) for picture in pictures]
            shown.append("</div>\n")
    about = "Pictures with the commands that made them. Where the data are from: [sources](pictures/SOURCES.md)."
    return f"# Gallery\n\n{about}\n" + "\n".join(shown)


def pictures_of(name: str, text: str) -> list[Picture]:
    """Return the pictures of a page that have a command: one above them with their name, or that of their folder."""
    pictures, heading, commands = [], "", dict[str, str]()
    blocks = re.finditer(
        r"^```(\w*)\n(.*?)^```$|^#+ ([^\n]*)$|!\[([^\]]*)\]\(([^)]+)\)", text, re.MULTILINE | re.DOTALL
    )
    for block in blocks:
        if block[3]:
            heading = block[3]
        elif block[2]:
            for command in re.findall(r"^ctmc (?:.*\\\n)*.*$", block[2], re.MULTILINE):
                output = re.search(r" -o (\S+)\.\w+", command)
                if output:
                    commands[output[1]] = command
        elif block[5]:
            stem = posixpath.splitext(posixpath.basename(block[5]))[0]
            command = commands.get(stem) or COMMANDS_BY_FOLDER.get(posixpath.basename(posixpath.dirname(block[5])))
            if command:
                pictures.append(Picture(name, heading, block[4], block[5], command))
    return pictures


def card(picture: Picture) -> str:
    """Return a picture, what it shows and its command."""
    link = f"[{picture.heading}]({picture.page}#{anchor(picture.heading)})"
    # A line for each flag, as a card is narrow.
    words = re.sub(r"\s*\\\n\s*", " ", picture.command)
    command = re.sub(r" (?=--?[a-zA-Z])", " \\\\\n      ", f"    {words}")
    return (
        f"-   ![{picture.text}]({picture.path}){{ loading=lazy }}\n\n"
        f"    {picture.text}: {link}\n\n    ```sh\n{command}\n    ```\n"
    )


def anchor(heading: str) -> str:
    """Return the anchor of a heading, as GitHub and the site make it."""
    kept = re.sub(r"[^\w\- ]", "", re.sub(r"`|\[([^\]]*)\]\([^)]*\)", r"\1", heading))
    return kept.strip().lower().replace(" ", "-")


def python_reference() -> str:
    """Return the page that mkdocstrings fills from docstrings."""
    about = (
        "What scripts call. A name that ends in `_steps` is a generator: `finish(...)` runs it to its end, and a loop "
        "over it can show progress or stop. Points are in RAS+ mm."
    )
    parts: list[Any] = [f"# Python\n\n{about}\n"]
    for title, names in PYTHON.items():
        parts.append(f"\n## {title}\n")
        parts += [f"\n::: {name}\n" for name in names]
    return "".join(parts)
