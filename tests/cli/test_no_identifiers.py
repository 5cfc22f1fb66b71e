# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever a DICOM header says of a person, a place or a time is in nothing that comes out.

Every attribute of PS3.15 table E.1-1 holds a word of its own, and every output is searched for all of them.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

ATTRIBUTES = Path(__file__).with_name("confidential_attributes.txt").read_text("utf-8").split("\n", 1)[1].split()
SHOWN = ("SeriesDescription", "SeriesInstanceUID")  # `ctmc info` tells series apart by them, on the screen alone


def word_for(vr, number):
    """A value of a type that nothing else has."""
    if vr == "UI":
        return f"2.25.7770{number:04d}"
    if vr in ("DA", "DT", "TM"):
        day = f"{1861 + number // 300}{1 + number % 300 // 28:02d}{1 + number % 28:02d}"
        return {"DA": day, "DT": f"{day}0317", "TM": f"0317{number % 60:02d}.{number:06d}"}[vr]
    return {
        "DS": f"77{number:04d}.25",
        "IS": f"77{number:04d}",
        "US": 40000 + number,
        "AS": f"{number % 1000:03d}Y",
    }.get(vr, f"CANARY{number:04d}")


@pytest.fixture(scope="module")
def words(tmp_path_factory):
    """A folder with a CT whose header is full of them, and the bytes of each by attribute."""
    pydicom = pytest.importorskip("pydicom")
    from fuzz.dicom_seeds import ct_dataset
    from pydicom.datadict import dictionary_VR, tag_for_keyword
    from pydicom.dataset import Dataset

    folder = tmp_path_factory.mktemp("in") / "thorax"
    folder.mkdir()
    values = {}
    tags = {keyword: tag_for_keyword(keyword) for keyword in ATTRIBUTES}
    known = [keyword for keyword, tag in tags.items() if tag is not None and tag >> 16 >= 8]  # of a dataset
    assert len(known) > 600
    z, y, x = np.ogrid[-1:1:12j, -1:1:40j, -1:1:40j]
    ball = (1000 + 300 * (1 - x * x - y * y - z * z)).astype(np.uint16)
    for at, plane in enumerate(ball):
        dataset = ct_dataset(at, plane)
        for number, keyword in enumerate(known):
            vr = dictionary_VR(keyword)
            word = word_for("LO" if vr == "SQ" else vr, number)
            if keyword == "SOPInstanceUID":
                word = f"{word}.{at}"
            content = word
            if vr == "SQ":
                content = Dataset()
                content.PatientName = content.TextValue = word
                content = [content]
            elif vr in ("OB", "UN", "OW"):
                content = word.encode()
            setattr(dataset, keyword, content)
            if not isinstance(word, int) and vr != "AS":  # numbers of a few digits are everywhere
                values[keyword] = word.encode()
        dataset.file_meta.MediaStorageSOPInstanceUID = dataset.SOPInstanceUID
        pydicom.dcmwrite(folder / f"{at}.dcm", dataset, enforce_file_format=True)
    assert len(values) > 600
    assert b"CANARY" in (folder / "0.dcm").read_bytes()
    return folder, values


def require_clean(content, values, where, shown=()):
    """Fail if any of the words is in `content`."""
    if not isinstance(content, bytes):
        content = content.encode("utf-8", "surrogateescape")
    found = [keyword for keyword, word in values.items() if word in content and keyword not in shown]
    assert not found, (where, found[:5])
    assert not re.search(rb"CANARY(?!%b)" % b"|".join(values[name][6:] for name in shown if name in values), content)


def require_all_clean(folder, values):
    """Fail if any file below a folder holds one of the words, in its name or its content."""
    from PIL import Image

    files = [path for path in folder.rglob("*") if path.is_file()]
    for path in files:
        require_clean(path.name, values, path)
        require_clean(path.read_bytes(), values, path)
        if path.suffix == ".png":
            with Image.open(path) as image:
                require_clean(repr(getattr(image, "text", "")), values, path)
    return {path.suffix for path in files}


def test_the_words_are_found_where_they_are(words):
    folder, values = words
    with pytest.raises(AssertionError):
        require_all_clean(folder, values)


def test_no_output_of_the_command_line_holds_an_identifier(words, ctmc, scene, tmp_path):
    import bpy

    folder, values = words
    out = tmp_path / "out"
    out.mkdir()
    flags = ["--threshold", "150", "--report", out / "a.json"]
    said = []
    for suffix in ("stl", "ply", "obj", "glb", "blend"):
        outcome = ctmc("reconstruct", folder, "-o", out / f"a.{suffix}", *flags)
        assert outcome.code == 0, outcome.errors
        said += [outcome.out, *outcome.errors]
    # Blender packs what it writes.
    bpy.ops.wm.open_mainfile(filepath=str(out / "a.blend"))
    bpy.ops.wm.save_as_mainfile(filepath=str(out / "unpacked.blend"), compress=False, copy=True)
    (out / "a.blend").unlink()
    assert (out / "unpacked.blend").read_bytes().startswith(b"BLENDER")
    outcome = ctmc("batch", folder.parent, "-o", out / "batch", "--threshold", "150", "--no-thumbnails")
    assert outcome.code == 0, outcome.errors
    said += [outcome.out, *outcome.errors]
    for text in said:
        require_clean(text, values, "printed")
    suffixes = require_all_clean(out, values)
    assert {".stl", ".ply", ".obj", ".glb", ".blend", ".json", ".csv", ".html"} <= suffixes


def test_no_picture_or_video_holds_an_identifier(words, ctmc, scene, tmp_path):
    folder, values = words
    small = ["--threshold", "150", "--width-mm", "40", "--height-mm", "60", "--dpi", "60"]
    outcome = ctmc("figure", folder, "-o", tmp_path / "a.png", *small)
    assert outcome.code == 0, outcome.errors
    require_clean(outcome.out + "".join(outcome.errors), values, "printed")
    outcome = ctmc("figure", "turntable", folder, "-o", tmp_path / "a.mp4", *small, "--seconds", "1", "--fps", "3")
    assert outcome.code == 0, outcome.errors
    require_clean(outcome.out + "".join(outcome.errors), values, "printed")
    assert {".png", ".mp4"} <= require_all_clean(tmp_path, values)


def test_info_shows_what_tells_series_apart_and_nothing_else(words, ctmc):
    folder, values = words
    for flags in ((), ("--json",)):
        outcome = ctmc("info", folder, *flags)
        assert outcome.code == 0, outcome.errors
        require_clean(outcome.out, values, "info", SHOWN)


def test_no_error_names_an_identifier(words, ctmc, tmp_path):
    folder, values = words
    content = (folder / "5.dcm").read_bytes()
    for number, length in enumerate(range(200, len(content), len(content) // 12)):
        place = tmp_path / f"case {number}"
        place.mkdir()
        for at in (4, 6):
            (place / f"{at}.dcm").write_bytes((folder / f"{at}.dcm").read_bytes())
        (place / "5.dcm").write_bytes(content[:length])
        outcome = ctmc("reconstruct", place, "-o", tmp_path / "a.stl")
        require_clean(outcome.out + "".join(outcome.errors), values, "error")
        (place / "5.dcm").write_bytes(content.replace(b"IS", b"XX", 5).replace(b"-10\\-20", b"nan\\nan"))
        outcome = ctmc("reconstruct", place, "-o", tmp_path / "a.stl")
        require_clean(outcome.out + "".join(outcome.errors), values, "error")


def test_a_file_saved_from_the_panel_holds_no_identifier(words, scene, tmp_path):
    import bpy

    import ctmc_addon
    from ctmc_addon.ui.operators.results.results import command_text

    folder, values = words
    bpy.ops.wm.read_factory_settings(use_empty=True)
    ctmc_addon.register()
    try:
        panel = bpy.context.scene
        uid = values["SeriesInstanceUID"].decode()
        assert bpy.ops.ctmc.load(directory=str(folder), series=uid) == {"FINISHED"}
        panel.ctmc.use_threshold, panel.ctmc.threshold = True, 150.0
        assert bpy.ops.ctmc.reconstruct() == {"FINISHED"}
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "panel.blend"), compress=False, copy=True)
        require_clean(command_text(panel), values, "the copied command")
        require_clean(panel.ctmc.series + repr(bpy.context.window_manager.clipboard), values, "panel")
    finally:
        ctmc_addon.unregister()
    assert require_all_clean(tmp_path, values | {"path": b"not-there"}) == {".blend"}
