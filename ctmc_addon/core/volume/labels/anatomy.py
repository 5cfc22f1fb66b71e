# SPDX-License-Identifier: GPL-3.0-or-later
"""Color and opacity of a structure by its anatomical name, in English, German or Latin.

`anatomy.toml` has the colors, the names and their sources. Sides and numbers do not count, but for vertebrae, of which
every second one is darker.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

FIRST_OF_REGION = {"c": 1, "t": 8, "th": 8, "l": 20, "s": 25}  # The first vertebra, counted from the head.
VERTEBRA_NUMBER = re.compile(r"(?<![a-z])(c|th?|l|s)[ _-]?(\d{1,2})(?!\d)")
FURTHER = re.compile(r"\b(?:and|with|incl\w*|und|mit|or|oder)\b|[/+&,;(]")
TUMOR = re.compile(r"^gtv|tumou?r|lesion|cancer|karzinom|carcinoma|metasta|neoplas|lasion")
CYST = re.compile(r"(?:[ck]yst|zyste)[esn]*$")
ABBREVIATED = re.compile(r"^(vv?\.|aa?\.|m\.|n\.|musc |glnd |bone ) *")
PLURALS = ("s", "es", "n", "en", "e")


class Anatomy(NamedTuple):
    """Appearance of a structure.

    Parameters
    ----------
    rgb : (red, green, blue) int
        sRGB, 0 to 255.
    opacity : float
        From 0, invisible, to 1: below 1 where what lies inside matters more, such as the vessels of a liver.
    """

    rgb: tuple[int, int, int]
    opacity: float


def anatomy_of(name: str) -> Anatomy | None:
    """Return color and opacity of the structure that a name means; None for a name that is not known.

    Upper and lower case, sides, numbers, spaces and underscores are not told apart; words may be glued.

    Examples
    --------
    >>> anatomy_of("Leber") == anatomy_of("liver_segment_4") == anatomy_of("liver")
    True
    >>> anatomy_of("livertumor1") == anatomy_of("Tumor"), anatomy_of("leftkidney") == anatomy_of("linke Niere")
    (True, True)
    >>> anatomy_of("skin"), anatomy_of("vertebrae_L4") == anatomy_of("vertebrae_L5"), anatomy_of("structure 7")
    (Anatomy(rgb=(233, 185, 156), opacity=0.25), False, None)
    """
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    plain = _folded(spaced).replace("_", " ").replace("non-enhancing", "enhancing")
    plain = ABBREVIATED.sub(lambda match: _table()["abbreviations"][match[1]] + " ", plain)
    words = re.findall(r"[a-z]+", plain)
    if not words or not set(words).isdisjoint(_table()["negations"]):
        return None
    number = VERTEBRA_NUMBER.search(plain)
    if number and any("vertebra" in word or "wirbel" in word for word in words):
        count = FIRST_OF_REGION[number[1]] + int(number[2]) - 1
        return _index()["vertebra"] if count % 2 else Anatomy(_rgb(_table()["second_vertebra"]), 1.0)
    return _listed(words) or _first_of_several(spaced, plain) or _by_a_word(words)


def is_lesion(name: str) -> bool:
    """Return whether a name means a tumor or a cyst, of whatever organ.

    Examples
    --------
    >>> is_lesion("livertumor1"), is_lesion("Nierenzyste"), is_lesion("liver with tumor"), is_lesion("liver")
    (True, True, False, False)
    """
    return anatomy_of(name) in (_index()["tumor"], _index()["cyst"])


def _folded(name: str) -> str:
    """Return a name in small letters without accents; an umlaut and its spelling with an e are the plain letter."""
    letters = unicodedata.normalize("NFKD", name.casefold())
    plain = "".join(letter for letter in letters if not unicodedata.combining(letter))
    return re.sub(r"(?<=[aou])e", "", plain)


def _listed(words: list[str]) -> Anatomy | None:
    """Return the entry of the table for these words: as they are, without sides, and without position."""
    long = [word for word in words if len(word) > 1]
    sides = set(_table()["sides"])
    for key_words in (words, long, [word for word in long if word not in sides], _without_fillers(long)):
        key = "".join(key_words)
        for plain in (key, *_without_sides(key)):
            anatomy = _singular(plain)
            if anatomy is not None:
                return anatomy
    return None


def _without_fillers(words: list[str]) -> list[str]:
    """Words of more than a letter that are neither sides nor fillers."""
    left_out = {*_table()["sides"], *_table()["fillers"]}
    return [word for word in words if word not in left_out and len(word) > 1]


def _without_sides(key: str) -> list[str]:
    """Return a glued name without a side at its beginning or end."""
    begins = [key[len(side) :] for side in _table()["sides"] if key.startswith(side)]
    return begins + [key[: -len(side)] for side in _table()["sides"] if key.endswith(side)]


def _singular(key: str) -> Anatomy | None:
    """Return the entry of the table for a key or for its singular."""
    stems = (key[: -len(ending)] for ending in PLURALS if key.endswith(ending))
    return next((_index()[stem] for stem in (key, *stems) if stem in _index()), None)


def _first_of_several(spaced: str, plain: str) -> Anatomy | None:
    """Return the first of two structures that a name counts: 'liver with tumor' is a liver."""
    first, *rest = FURTHER.split(plain, maxsplit=1)
    return anatomy_of(first) if rest and len(first) < len(spaced) else None


def _by_a_word(words: list[str]) -> Anatomy | None:
    """Return the entry for the chief word of a name: a tumor of anything, any artery, any muscle."""
    if TUMOR.search("".join(words)) or "mass" in words:
        return _index()["tumor"]
    if any(map(CYST.search, words)):
        return _index()["cyst"]
    key = "".join(_without_fillers(words))
    endings = {key, *(key[: -len(ending)] for ending in PLURALS if key.endswith(ending))}
    for head in _table()["heads"]:
        if any(ending.endswith(head.replace(" ", "")) for ending in endings):
            return _singular(_key(_table()["aliases"].get(head, head)))
    if words[0] in _table()["latin_heads"] and len(words) > 1:  # 'os sacrum' is a sacrum, 'os pedis' a bone
        return _listed(words[1:]) or _index()[words[0]]
    return None


def _key(name: str) -> str:
    return "".join(re.findall(r"[a-z]+", _folded(name)))


def _rgb(color: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(color.lstrip("#"))
    return red, green, blue


@cache
def _table() -> Mapping[str, Any]:
    import tomllib  # Only a command that names structures needs it.

    return tomllib.loads((files(__package__) / "anatomy.toml").read_text("utf-8"))


@cache
def _index() -> dict[str, Anatomy]:
    """Return the table by its names, without spaces."""
    index: dict[str, Anatomy] = {}
    for each in _table()["structures"]:
        for name in each["names"]:
            index.setdefault(_key(name), Anatomy(_rgb(each["color"]), float(each.get("opacity", 1.0))))
    return index
