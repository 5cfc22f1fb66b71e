# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the factor that turns a PET's values into the standardized uptake by body weight (SUVbw), in g/ml.

The rules are QIBA's vendor-neutral pseudo-code (UPICT and FDG-PET profile, "SUV vendor neutral pseudo-code, happy path
and robust"). Weight, dose and times are read here, and none of them is kept or written anywhere.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

from ...core import LN_2, Steps, natural_logarithm, power_of_two
from ..optional_imports import needed, quiet, quiet_batches_steps
from .header import Slice, one_line, pydicom_errors

DAY = 86400.0
EARLIEST = -3600.0  # Seconds; a tracer may be given after the scan has begun, as for the heart.
MOST_HALF_LIVES = 20.0  # A tracer that was given longer ago has left nothing to measure.
LEAST_DOSE = 1e4  # Bq; less than this is a dose in MBq.
PHILIPS_SUV, PHILIPS_ACTIVITY = (0x7053, 0x1000), (0x7053, 0x1009)
GE_SCAN = (0x0009, 0x100D)  # Date and time of the scan, in the block of GEMS_PETD_01.
CREATORS = ((0x7053, 0x0010), (0x0009, 0x0010))
KEYWORDS = (
    *("Units", "SUVType", "CorrectedImage", "DecayCorrection", "PatientWeight", "TimezoneOffsetFromUTC"),
    *("SeriesDate", "SeriesTime", "AcquisitionDate", "AcquisitionTime", "FrameReferenceTime", "ActualFrameDuration"),
    "RadiopharmaceuticalInformationSequence",
)
UNITS = {"BQML": "Bq/ml", "CNTS": "counts", "GML": "g/ml"}
"""How notes write the units of (0054,1001)."""


class Uptake(NamedTuple):
    """The slices of a PET in SUVbw if their factor is known, else as they were, and notes."""

    slices: list[Slice]
    is_suv: bool
    notes: list[str]


class _Unknown(Exception):
    """SUVbw cannot be worked out; the text says why."""


def uptake_steps(slices: Sequence[Slice], series: Sequence[Slice]) -> Steps[Uptake]:
    """Scale the slices of a PET to SUVbw.

    Parameters
    ----------
    slices : sequence of Slice
        Slices to scale; each has its own slope.
    series : sequence of Slice
        All slices of their series, because the scan begins with the first.

    Returns
    -------
    Uptake
    """
    paths = list(dict.fromkeys(ct_slice.image.path for ct_slice in series))
    read = yield from quiet_batches_steps(_values_of, paths, "Reading headers", 16)
    values = dict(zip(paths, read, strict=True))
    unit = _text(values[slices[0].image.path], "Units")
    try:
        if any(_text(values[each.image.path], "Units") != unit for each in slices):
            raise _Unknown("its slices have several Units")
        factors, note = _factors({each.image.path for each in slices}, values, unit)
    except _Unknown as error:
        stays = f"stay in {UNITS.get(unit, unit)}" if unit else "have no known unit"
        return Uptake(list(slices), False, [f"the PET's values {stays} and are not SUV: {error}"])
    images = {}
    for ct_slice in slices:
        image, factor = ct_slice.image, factors[ct_slice.image.path]
        if image not in images:
            frames = tuple(
                frame._replace(slope=frame.slope * factor, intercept=frame.intercept * factor) for frame in image.frames
            )
            images[image] = replace(image, frames=frames, float_values=True)
    return Uptake([Slice(images[each.image], each.frame) for each in slices], True, [note])


def _factors(paths: set[Path], values: Mapping[Path, Mapping[Any, Any]], unit: str) -> tuple[dict[Path, float], str]:
    """Return the factor of each file and a note; raise `_Unknown` with what is missing."""
    first = values[min(paths)]
    if unit == "GML":
        kind = _text(first, "SUVType")
        if kind not in ("", "BW"):
            raise _Unknown(f"SUVType is {kind}, not BW")
        return dict.fromkeys(paths, 1.0), "the PET's values are SUVbw, as the files have them (Units GML)"
    if unit == "CNTS":
        factors = {path: _number(values[path].get(PHILIPS_SUV)) for path in paths}
        nonzero = {path: factor for path, factor in factors.items() if factor}
        if len(nonzero) == len(paths):
            return nonzero, "the PET's values are SUVbw, by Philips' factor (7053,1000)"
        activity = {path: _number(values[path].get(PHILIPS_ACTIVITY)) for path in paths}
        per_count = {path: factor for path, factor in activity.items() if factor}
        if len(per_count) < len(paths):
            raise _Unknown("Philips' factors (7053,1000) and (7053,1009) are missing")
        factor, note = _body_weight_factor(first, list(values.values()))
        by_activity = note.replace("the PET's values are SUVbw", "the PET's values are SUVbw, by Philips' (7053,1009)")
        return {path: factor * each for path, each in per_count.items()}, by_activity
    if unit != "BQML":
        raise _Unknown(f"Units are {unit}" if unit else "Units is missing")
    factor, note = _body_weight_factor(first, list(values.values()))
    return dict.fromkeys(paths, factor), note


def _body_weight_factor(first: Mapping[Any, Any], series: Sequence[Mapping[Any, Any]]) -> tuple[float, str]:
    """Return g/ml for each Bq/ml, and a note; raise `_Unknown` with what is missing."""
    corrected = first.get("CorrectedImage")
    words = {str(word).upper() for word in ([corrected] if isinstance(corrected, str) else corrected or ())}
    if words and "ATTN" not in words:
        raise _Unknown("the PET is not corrected for attenuation (CorrectedImage)")
    tracer = (first.get("RadiopharmaceuticalInformationSequence") or [{}])[0]
    correction = _text(first, "DecayCorrection").upper()
    if correction not in ("", "START", "ADMIN"):
        raise _Unknown(f"DecayCorrection is {correction}, not START or ADMIN")
    needs: dict[str, Any] = {
        "DecayCorrection": correction,
        "PatientWeight": _number(first.get("PatientWeight")),
        "RadionuclideTotalDose": _number(tracer.get("RadionuclideTotalDose")),
    }
    decay, at = 0.0, "corrected to when the tracer was given (DecayCorrection ADMIN)"
    half_life = _number(tracer.get("RadionuclideHalfLife"))
    began, given = _scan_start(series, half_life), _given(tracer, first)
    if correction == "START":
        needs |= {"RadionuclideHalfLife": half_life, "RadiopharmaceuticalStartTime": given}
        needs |= {"SeriesTime or AcquisitionTime": began}
    missing = [name for name, value in needs.items() if not value]
    if missing:
        listed = missing[0] if len(missing) == 1 else f"{', '.join(missing[:-1])} and {missing[-1]}"
        raise _Unknown(f"{listed} {'is' if len(missing) == 1 else 'are'} missing")
    dose, weight = needs["RadionuclideTotalDose"], needs["PatientWeight"]
    if dose < LEAST_DOSE:
        raise _Unknown(f"RadionuclideTotalDose is {dose:g} Bq, too little for a scan; it may be in MBq")
    if correction == "START" and half_life and began and given:
        decay = _seconds_between(given, began, half_life)
        if decay > MOST_HALF_LIVES * half_life:
            raise _Unknown(f"the tracer was given {decay / half_life:.0f} half-lives before the scan")
        at = f"decayed for {decay / 60:.4g} minutes to the start of the scan"
    left = dose * power_of_two(-decay / half_life) if half_life else dose
    return weight * 1000.0 / left, f"the PET's values are SUVbw: Bq/ml by weight and dose, {at}"


class _DayTime(NamedTuple):
    """A day, None if unknown, and seconds in it."""

    day: int | None
    seconds: float

    def minus(self, other: _DayTime) -> float:
        """Return the seconds from another moment to this one, of the same day where one has none."""
        days = 0 if self.day is None or other.day is None else self.day - other.day
        return days * DAY + self.seconds - other.seconds

    def later(self, seconds: float) -> _DayTime:
        """Return the moment after some seconds."""
        days, rest = divmod(self.seconds + seconds, DAY)
        return _DayTime(None if self.day is None else self.day + int(days), rest)


def _scan_start(series: Sequence[Mapping[Any, Any]], half_life: float | None) -> _DayTime | None:
    """Return when the scan began, to which values were corrected for decay; None if no file says it."""
    started = _moment(series[0].get("SeriesDate"), series[0].get("SeriesTime"))
    acquired = [(_moment(record.get("AcquisitionDate"), record.get("AcquisitionTime")), record) for record in series]
    taken = [(moment, record) for moment, record in acquired if moment is not None]
    if not taken:
        return started
    earliest, own = min(taken, key=lambda each: (each[0].day or 0, each[0].seconds))
    if started is not None and started.minus(earliest) <= 0:
        return started
    # The series was made after the scan, so its time is another.
    scan = _date_time(own.get(GE_SCAN))
    if scan is not None:
        return scan
    reference, duration = _number(own.get("FrameReferenceTime")), _number(own.get("ActualFrameDuration"))
    if reference and duration and half_life:
        constant = LN_2 / half_life
        in_frame = constant * duration / 1000.0
        left = power_of_two(-duration / 1000.0 / half_life)
        average = natural_logarithm(in_frame / (1.0 - left)) / constant if left < 1 else 0.0
        return earliest.later(average - reference / 1000.0)
    return earliest


def _given(tracer: Mapping[Any, Any], values: Mapping[Any, Any]) -> list[_DayTime] | None:
    """Return when the tracer was given: with its day if a file says it, then by the time of day; None if unknown."""
    moments = []
    whole = _date_time(tracer.get("RadiopharmaceuticalStartDateTime"), _text(values, "TimezoneOffsetFromUTC"))
    if whole is not None:
        moments.append(whole)
    of_day = _moment(None, tracer.get("RadiopharmaceuticalStartTime"))
    if of_day is not None:
        moments.append(of_day)
    elif whole is not None:
        moments.append(_DayTime(None, whole.seconds))
    return moments or None


def _seconds_between(given: Sequence[_DayTime], began: _DayTime, half_life: float) -> float:
    """Return the seconds from the tracer to the scan.

    Days that removing names has moved apart do not count; without days it is less than a day, perhaps over midnight.
    """
    for moment in given:
        seconds = began.minus(moment)
        is_dated = moment.day is not None and began.day is not None
        if is_dated and EARLIEST <= seconds <= MOST_HALF_LIVES * half_life:
            return seconds
    seconds = began.seconds - given[-1].seconds
    return (seconds - EARLIEST) % DAY + EARLIEST


def _moment(day: Any, time: Any) -> _DayTime | None:
    """Return the moment of a DICOM date (DA) and time (TM); None without a time."""
    seconds = _seconds(str(time or "").strip())
    return None if seconds is None else _DayTime(_day(str(day or "").strip()), seconds)


def _date_time(value: Any, zone: str = "") -> _DayTime | None:
    """Return the moment of a DICOM date and time (DT), in the time zone of the other times.

    Examples
    --------
    >>> _date_time("20240229010000+0000", "+0200").seconds
    10800.0
    """
    text = value.decode("ascii", "ignore") if isinstance(value, bytes) else str(value or "")
    digits, sign, offset = re.match(r"([0-9.]*)([+-]?)([0-9]*)", text.strip()).groups()  # type: ignore[union-attr]
    moment = _moment(digits[:8], digits[8:])
    if moment is not None and sign and zone:
        moment = moment.later(_zone_seconds(zone) - _zone_seconds(sign + offset))
    return moment


def _zone_seconds(zone: str) -> float:
    match = re.fullmatch(r"([+-])(\d\d)(\d\d)", zone.strip())
    return 0.0 if match is None else (-1.0 if match[1] == "-" else 1.0) * (int(match[2]) * 3600 + int(match[3]) * 60)


def _day(text: str) -> int | None:
    match = re.fullmatch(r"(\d{4})[.]?(\d\d)[.]?(\d\d)", text)
    try:
        return None if match is None else date(int(match[1]), int(match[2]), int(match[3])).toordinal()
    except ValueError:
        return None


def _seconds(text: str) -> float | None:
    """Return the seconds in the day of a DICOM time.

    Examples
    --------
    >>> _seconds("101530.25"), _seconds("10:15"), _seconds("")
    (36930.25, 36900.0, None)
    """
    match = re.fullmatch(r"(\d\d):?(\d\d)?:?(\d\d(?:\.\d*)?)?", text)
    if match is None:
        return None
    return int(match[1]) * 3600.0 + int(match[2] or 0) * 60.0 + float(match[3] or 0)


def _number(value: Any) -> float | None:
    """Return a number above 0; None for anything else, which no dose, weight or factor is."""
    text = value.decode("ascii", "ignore").strip("\0 ") if isinstance(value, bytes) else value
    try:
        number = float(text)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) and number > 0 else None


def _text(values: Mapping[Any, Any], keyword: str) -> str:
    return one_line(values.get(keyword)).upper()


def _values_of(path: Path) -> dict[Any, Any]:
    """Return the elements of one file that SUV needs, by keyword, and private ones by tag."""
    pydicom = needed("pydicom", "pydicom", "DICOM")
    private = (PHILIPS_SUV, PHILIPS_ACTIVITY, GE_SCAN)
    try:
        with quiet():
            dataset = pydicom.dcmread(
                path, specific_tags=[*KEYWORDS, *private, *CREATORS], stop_before_pixels=True, force=True
            )
            values: dict[Any, Any] = {keyword: dataset.get(keyword, None) for keyword in KEYWORDS}
            sequence = "RadiopharmaceuticalInformationSequence"
            values[sequence] = [{item.keyword: item.value for item in each} for each in values[sequence] or ()]
            return values | {tag: dataset[tag].value for tag in private if tag in dataset}
    except pydicom_errors() as error:
        if isinstance(error, OSError) and error.errno is not None:  # the system's
            raise
        return {}
