# SPDX-License-Identifier: GPL-3.0-or-later
"""A format is one line of the registry and one module; everything that lists formats is made from it."""

from __future__ import annotations

import importlib
import inspect
from collections import Counter

import numpy as np
import pytest
import tifffile

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import open_volume, registry, volume_name
from ctmc_addon.readers.registry import FORMATS


def module_of(name):
    return importlib.import_module(f"ctmc_addon.readers.{FORMATS[name].module}")


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_opened_by_one_convention(name):
    module = module_of(name)
    if FORMATS[name].holds in (registry.VOLUME, registry.FOLDER):
        assert list(inspect.signature(module.open_source).parameters) == ["path"]
        assert not inspect.isgeneratorfunction(module.open_source)
        assert not hasattr(module, "is_whole_volume")
    else:
        assert list(inspect.signature(module.open_steps).parameters) == ["path"]
        assert list(inspect.signature(module.is_whole_volume).parameters) == ["path"]


def test_a_suffix_a_name_and_a_mark_tell_one_format_each():
    entries = FORMATS.values()
    for told in ([about.suffixes for about in entries], [about.names for about in entries]):
        assert [word for word, count in Counter(word for words in told for word in words).items() if count > 1] == []
    marks = Counter(mark for about in entries for mark in about.marks)
    assert max(marks.values()) == 1


def test_the_lists_of_suffixes_hold_every_suffix():
    images = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".jp2", ".j2k", ".jpx", ".j2c")
    volumes = (".nii", ".nii.gz", ".nrrd", ".nhdr", ".npy", ".mha", ".mhd", ".mgh", ".mgz", ".hdr")
    volumes += (".vff", ".vgi", ".vol.info")
    assert images == registry.IMAGE_SUFFIXES
    assert set(registry.VOLUME_SUFFIXES) == set(volumes)
    assert set(registry.MASK_SUFFIXES) == set(volumes) - {".npy", ".hdr", ".vff", ".vgi", ".vol.info"}
    assert set(registry.KNOWN_SUFFIXES) - set(registry.FOLDER_SUFFIXES) == {*images, *volumes, ".dcm", ".dicom", ".ima"}


def test_dicom_is_asked_for_before_tiff():
    """A dual-personality file begins like a TIFF and has DICOM's mark behind its preamble."""
    head = b"II*\0".ljust(128, b"\0") + b"DICM"
    assert registry.marked(head) == "DICOM"
    assert registry.marked(head[:128]) == "TIFF"


def test_a_source_is_called_as_in_the_registry(tmp_path):
    np.save(tmp_path / "ct.npy", np.zeros((3, 4, 5), np.int16))
    tifffile.imwrite(tmp_path / "ct.tif", np.zeros((3, 4, 5), np.uint16), photometric="minisblack")
    assert [open_volume(tmp_path / name).format for name in ("ct.npy", "ct.tif")] == ["NumPy", "TIFF"]
    for name in FORMATS:
        sources = [kind for _, kind in inspect.getmembers(module_of(name), inspect.isclass) if hasattr(kind, "series")]
        assert all(kind.format in FORMATS for kind in sources if kind.__module__ == module_of(name).__name__)


def test_a_slice_gives_its_folders_name_and_a_stack_of_pages_its_own(tmp_path):
    folder = tmp_path / "scan"
    folder.mkdir()
    tifffile.imwrite(folder / "page.tif", np.zeros((4, 5), np.uint16), photometric="minisblack")
    tifffile.imwrite(folder / "pages.tif", np.zeros((3, 4, 5), np.uint16), photometric="minisblack")
    assert volume_name(folder / "page.tif") == "scan"
    assert volume_name(folder / "pages.tif") == "pages"


def test_an_unknown_suffix_is_told_every_known_one(tmp_path):
    (tmp_path / "ct.xyz").write_bytes(b"words")
    with pytest.raises(CtmcError) as refused:
        open_volume(tmp_path / "ct.xyz")
    listed = ", ".join(registry.KNOWN_SUFFIXES)
    assert str(refused.value) == (
        f"ct.xyz has the unknown suffix '.xyz'; choose a folder, or a file that ends in {listed}"
    )
