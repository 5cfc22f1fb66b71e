# SPDX-License-Identifier: GPL-3.0-or-later
"""Elements read by their place: the values that pydicom reads, and a sentence for what breaks the rules."""

from __future__ import annotations

import io

import numpy as np
import pydicom
import pytest

from ctmc_addon.core import finish
from ctmc_addon.readers.dicom.labels.elements import DEEPEST, LOCATION, VALUE, Damaged, ElementWalker, after_meta

POSITION = {0x52009230: {0x00209113: {0x00200032: VALUE}, 0x0062000A: {0x0062000B: VALUE}}}


def read(content, wanted, implicit=False):
    return finish(ElementWalker(io.BytesIO(content), len(content), implicit).dataset_steps(wanted))


@pytest.mark.parametrize("syntax", ["1.2.840.10008.1.2", "1.2.840.10008.1.2.1"])
@pytest.mark.parametrize("undefined", [False, True])
def test_items_are_those_of_pydicom(tmp_path, save_segmentation, syntax, undefined):
    path = tmp_path / "seg.dcm"
    frames = [(1 + at % 3, (0.5, -1.25, 2.5 * at), np.ones((3, 4))) for at in range(600)]
    save_segmentation(path, frames, syntax=syntax, undefined=undefined)
    with path.open("rb") as file:
        assert after_meta(file)[0] == syntax
        elements = ElementWalker(file, path.stat().st_size, syntax == "1.2.840.10008.1.2")
        steps = list(elements.dataset_steps(POSITION))
        assert len(steps) == 2
        after_meta(file)
        found = finish(ElementWalker(file, path.stat().st_size, elements.implicit).dataset_steps(POSITION))
    dataset = pydicom.dcmread(path)
    groups = dataset.PerFrameFunctionalGroupsSequence
    assert len(found[0x52009230]) == len(groups) == 600
    for own, group in zip(found[0x52009230], groups, strict=True):
        position = [float(text) for text in own[0x00209113][0][0x00200032].split(b"\\")]
        assert position == list(group.PlanePositionSequence[0].ImagePositionPatient)
        number = group.SegmentIdentificationSequence[0].ReferencedSegmentNumber
        assert int.from_bytes(own[0x0062000A][0][0x0062000B], "little") == number
    assert found[0x7FE00010].start == dataset.get_item("PixelData").value_tell


def element(tag, vr, value, length=None):
    length = len(value) if length is None else length
    head = (tag >> 16).to_bytes(2, "little") + (tag & 0xFFFF).to_bytes(2, "little") + vr
    return head + (b"\0\0" + length.to_bytes(4, "little") if vr == b"SQ" else length.to_bytes(2, "little")) + value


def item(value, length=None):
    length = len(value) if length is None else length
    return b"\xfe\xff\x00\xe0" + length.to_bytes(4, "little") + value


def test_sequences_within_each_other_without_end_are_refused():
    content = b""
    for _ in range(DEEPEST + 2):
        content = element(0x00081115, b"SQ", item(content))
    assert read(content, {}) == {}  # passed over
    wanted = {}
    wanted[0x00081115] = wanted  # as deep as the file goes
    with pytest.raises(Damaged, match=f"more than {DEEPEST} nested sequences"):
        read(content, wanted)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (element(0x00080005, b"CS", b"", 10), "0 of 10 bytes"),
        (element(0x00081115, b"SQ", element(0x00080005, b"CS", b"ab")), "no item"),
        (element(0x00081115, b"SQ", item(b"", 0xFFFFFFFF), 0xFFFFFFFF), "does not end"),
        (element(0x00081115, b"SQ", item(element(0x00080005, b"CS", b"ab"), 4)), "does not end|midst"),
        (b"\x08\x00\x05", "within an element"),
        (element(0x00080005, b"UT", b"", 0), "within an element"),
    ],
)
def test_what_breaks_the_rules_is_said(content, words):
    with pytest.raises(Damaged, match=words):
        read(content, {0x00081115: {0x00080005: VALUE}, 0x00080005: VALUE})


def test_a_place_is_where_the_bytes_are():
    content = element(0x00080005, b"CS", b"ISO_IR 100") + element(0x00080016, b"UI", b"1.2\0")
    found = read(content, {0x00080016: LOCATION})
    place = found[0x00080016]
    assert content[place.start : place.start + place.length] == b"1.2\0"
