# SPDX-License-Identifier: GPL-3.0-or-later
"""Words for units of length: the same millimeters in every format that has them, and a note for each other word."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile

from ctmc_addon.core import ReadError
from ctmc_addon.readers import read_volume
from ctmc_addon.readers.images.tiff_axes import spacing_in_mm
from ctmc_addon.readers.length_units import in_mm, mm_of

VALUES = np.arange(60, dtype=np.uint8).reshape(3, 4, 5)
LENGTHS = (35.0, 70.0, 140.0)
MM = {
    **dict.fromkeys(["nm", "nanometer", "Nanometers", "nanometre"], 1e-6),
    **dict.fromkeys(["um", "\u00b5m", "\u03bcm", "UM", "micron", "Microns", "micrometer", "micrometers"], 1e-3),
    **dict.fromkeys(["micrometre", "micrometres", " um "], 1e-3),
    **dict.fromkeys(["mm", "MM", "millimeter", "millimeters", "Millimetre"], 1.0),
    **dict.fromkeys(["cm", "CM", "centimeter", "centimetres"], 10.0),
    **dict.fromkeys(["dm", "decimeter"], 100.0),
    **dict.fromkeys(["m", "meter", "meters", "metre", "METERS"], 1000.0),
    **dict.fromkeys(["in", "inch", "Inches"], 25.4),
    **dict.fromkeys(["ft", "foot", "feet"], 304.8),
    **dict.fromkeys(["angstrom", "Angstroms", "\u00c5", "\u212b"], 1e-7),
}
UNKNOWN = ("parsec", "pixel", "Mm", "furlong")


def nrrd(path, *lines):
    head = ["NRRD0005", "type: uchar", "dimension: 3", "sizes: 5 4 3", "encoding: raw", *lines, "", ""]
    path.write_bytes("\n".join(head).encode() + VALUES.tobytes())
    return path


def nrrd_of_space(folder, unit):
    words = "space directions: (35,0,0) (0,70,0) (0,0,140)", f'space units: "{unit}" "{unit}" "{unit}"'
    return nrrd(folder / "space.nrrd", "space: left-posterior-superior", *words)


def nrrd_of_axes(folder, unit):
    return nrrd(folder / "axes.nrrd", "spacings: 35 70 140", f'units: "{unit}" "{unit}" "{unit}"')


def metaimage(folder, unit):
    head = "NDims = 3\nDimSize = 5 4 3\nElementType = MET_UCHAR\nElementSpacing = 35 70 140\n"
    text = f"{head}DistanceUnits = {unit}\nElementDataFile = LOCAL\n"
    (folder / "ct.mha").write_bytes(text.encode() + VALUES.tobytes())
    return folder / "ct.mha"


def ome_zarr(folder, unit):
    zarr_stores = pytest.importorskip("zarr_stores")
    pytest.importorskip("zarr")
    about = zarr_stores.multiscales("0.4", unit=unit)
    about["datasets"][0]["coordinateTransformations"] = [{"type": "scale", "scale": LENGTHS[::-1]}]
    return zarr_stores.save_by_hand(folder / "ct.ome.zarr", VALUES, VALUES.shape, attrs={"multiscales": [about]})


def ome_tiff(folder, unit):
    sizes = "".join(
        f' PhysicalSize{axis}="{size}" PhysicalSize{axis}Unit="{unit}"'
        for axis, size in zip("XYZ", LENGTHS, strict=True)
    )
    text = (
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">'
        '<Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint8" SizeX="5" SizeY="4" SizeC="1" SizeZ="3" SizeT="1"'
        f'{sizes}><TiffData IFD="0" PlaneCount="3"/></Pixels></Image></OME>'
    )
    path = folder / "ct.ome.tif"
    tifffile.imwrite(path, VALUES, photometric="minisblack", description=text.encode(), metadata=None)
    return path


def imagej(folder, unit):
    escaped = "".join(letter if letter.isascii() else f"\\u{ord(letter):04X}" for letter in unit)
    options = {
        "imagej": True,
        "resolution": (1 / 35, 1 / 70),
        "metadata": {"axes": "ZYX", "spacing": 140.0, "unit": escaped},
    }
    tifffile.imwrite(folder / "ct.tif", VALUES, **options)
    return folder / "ct.tif"


MAKERS = (nrrd_of_space, nrrd_of_axes, metaimage, ome_zarr, ome_tiff, imagej)


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("unit", MM)
def test_a_length_in_any_unit_is_that_length_in_mm(tmp_path, make, unit):
    path = make(tmp_path, unit)
    if max(LENGTHS) * MM[unit] > 10000:
        with pytest.raises(ReadError, match=r"it must be from 1e-06 to 10000 mm; give the spacing x, y, z in mm"):
            read_volume(path)
        return
    volume = read_volume(path)
    assert volume.spacing == pytest.approx([length * MM[unit] for length in LENGTHS], rel=1e-5)
    assert any(f" {unit.strip()} and w" in note for note in volume.notes) == (MM[unit] != 1)
    assert not any("known unit" in note for note in volume.notes)


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("unit", UNKNOWN)
def test_a_unit_that_is_not_known_is_quoted_and_taken_as_mm(tmp_path, make, unit):
    path = make(tmp_path, unit)
    volume = read_volume(path)
    assert read_volume(path, spacing=(1, 2, 3)).spacing == (1, 2, 3)
    if unit == "pixel" and make in (ome_tiff, imagej):  # a picture without scale
        assert volume.spacing == (1, 1, 1)
        assert any("has no spacing: 1 mm is assumed" in note for note in volume.notes)
        return
    assert volume.spacing == pytest.approx(LENGTHS, rel=1e-5)
    said = f"the file's unit '{unit}' is not a known unit of length: taken as mm; give the spacing in mm for another"
    assert volume.notes.count(said) == 1


@pytest.mark.parametrize("make", MAKERS[:4])
@pytest.mark.parametrize("unit", ["", " "])
def test_no_unit_is_mm(tmp_path, make, unit):
    volume = read_volume(make(tmp_path, unit))
    assert volume.spacing == LENGTHS
    assert any("no unit: taken as mm" in note for note in volume.notes) == (make is ome_zarr)


def test_each_axis_of_a_nrrd_has_its_own_unit(tmp_path):
    directions = "space directions: (35,0,0) (0,70,0) (0,0,140)", "space origin: (1000,2000,3)"
    words = 'space units: "um" "nm" "cm"'
    volume = read_volume(nrrd(tmp_path / "a.nrrd", "space: right-anterior-superior", *directions, words))
    np.testing.assert_allclose(volume.spacing, (0.035, 7e-5, 1400))
    np.testing.assert_allclose(volume.affine[:3, 3], (1, 0.002, 30))
    assert volume.notes == ("the file's positions are in cm and nm and um and were converted to mm",)
    of_axes = read_volume(nrrd(tmp_path / "b.nrrd", "spacings: 35 70 140", 'units: "um" "um" "mm"'))
    np.testing.assert_allclose(of_axes.spacing, (0.035, 0.07, 140))


PLACED = (
    "space: right-anterior-superior",
    "space directions: (35,0,0) (0,70,0) (0,0,140)",
    "space origin: (1000,2000,3)",
)


def test_units_of_axes_convert_directions_where_space_has_none(tmp_path):
    volume = read_volume(nrrd(tmp_path / "a.nrrd", *PLACED, 'units: "um" "um" "mm"'))
    np.testing.assert_allclose(volume.affine, [[0.035, 0, 0, 1], [0, 0.07, 0, 2], [0, 0, 140, 3], [0, 0, 0, 1]])
    assert volume.notes == (
        "the file's units 'um', 'um', 'mm' differ and it has no space units: directions and origin were converted by "
        "the unit of each axis",
        "the file's positions are in um and were converted to mm",
    )
    even = read_volume(nrrd(tmp_path / "b.nrrd", *PLACED, 'units: "um" "micron" "um"', 'space units: "" "" ""'))
    np.testing.assert_allclose(even.affine[:3, 3], (1, 2, 0.003))
    np.testing.assert_allclose(even.spacing, (0.035, 0.07, 0.14))


def test_the_first_sample_keeps_its_place_in_samples_where_units_of_oblique_axes_differ(tmp_path):
    directions = "space directions: (3,4,0) (-4,3,0) (0,0,2)", "space origin: (10,55,-8)"
    words = "space: right-anterior-superior", *directions, 'units: "cm" "mm" "m"'
    volume = read_volume(nrrd(tmp_path / "a.nrrd", *words))
    np.testing.assert_allclose(volume.affine[:3, :3], [[30, -4, 0], [40, 3, 0], [0, 0, 2000]])
    # (10, 55) is 10 times (3, 4) and 5 times (-4, 3)
    np.testing.assert_allclose(volume.affine[:3, 3], (10 * 30 - 5 * 4, 10 * 40 + 5 * 3, -8000), atol=1e-9)


@pytest.mark.parametrize(
    ("units", "space_units", "said"),
    [
        ("um um um", "mm mm mm", "'mm', 'mm', 'mm' and units 'um', 'um', 'um'"),
        ("um um mm", "mm mm mm", "'mm', 'mm', 'mm' and units 'um', 'um', 'mm'"),
        ("mm MM millimeter", "mm mm mm", ""),
    ],
)
def test_units_beside_other_space_units_are_said(tmp_path, units, space_units, said):
    words = [" ".join(f'"{word}"' for word in text.split()) for text in (units, space_units)]
    volume = read_volume(nrrd(tmp_path / "a.nrrd", *PLACED, f"units: {words[0]}", f"space units: {words[1]}"))
    assert volume.spacing == LENGTHS
    assert volume.notes == ((f"the file has space units {said}: the space units are taken",) if said else ())
    without = read_volume(
        nrrd(tmp_path / "b.nrrd", "spacings: 35 70 140", 'units: "um" "um" "um"', 'space units: "mm"')
    )
    np.testing.assert_allclose(without.spacing, (0.035, 0.07, 0.14))
    assert without.notes[1] == (
        "the file has units 'um', 'um', 'um' and space units 'mm', 'mm', 'mm': the units are taken"
    )


def test_the_unit_of_time_converts_no_length(tmp_path):
    lines = ["type: uchar", "dimension: 4", "sizes: 5 4 3 2", "encoding: raw", "space: left-posterior-superior-time"]
    lines += ["space directions: (35,0,0,0) (0,70,0,0) (0,0,140,0) (0,0,0,1)", "space origin: (0,0,0,0)"]
    lines += ['space units: "um" "um" "um" "s"']
    (tmp_path / "a.nrrd").write_bytes(("NRRD0005\n" + "\n".join(lines) + "\n\n").encode() + VALUES.tobytes() * 2)
    volume = read_volume(tmp_path / "a.nrrd", time=2)
    np.testing.assert_allclose(volume.spacing, (0.035, 0.07, 0.14))


def test_a_metaimage_in_latin_1_says_micrometers(tmp_path):
    path = metaimage(tmp_path, "\u00b5m")
    path.write_bytes(path.read_bytes().replace("\u00b5m".encode(), b"\xb5m"))
    np.testing.assert_allclose(read_volume(path).spacing, (0.035, 0.07, 0.14))


def test_a_mark_of_inches_is_one():
    assert (mm_of('"'), mm_of("'"), mm_of("")) == (25.4, None, None)


@pytest.mark.parametrize("unit", ["um", "mm", "furlong"])
def test_a_tiff_and_any_other_format_say_a_unit_in_the_same_words(unit):
    lengths, said = in_mm([unit] * 3)
    assert spacing_in_mm([2.0, 3.0, 4.0], [unit] * 3) == (tuple(np.multiply((2, 3, 4), lengths)), said)
