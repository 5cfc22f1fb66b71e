# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the volumes read in this session. The .blend stores their path and fingerprint, never their values.

Undo may bring back a scene that refers to an earlier volume, so those stay while there is memory for them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import bpy

from ....core import CtmcError, ReadError, ReconstructionSettings, Volume, available_bytes
from ....core.volume import ValueKind, VolumeStatistics, lie_in_one_place, quick_threshold, settings_of_copy
from ....readers import ReadingOptions, Series
from .. import change_events, session
from ..draw.drawn import Drawn
from .stored_paths import stored_cts, stored_path

OF_THE_SAME_SAMPLES = ("spacing", "flip", "remove_table")
"""Reading options that move samples or change values; each sample stays the same one."""


@dataclass(frozen=True, eq=False)
class Loaded:
    """A volume, and its facts for the panel.

    Parameters
    ----------
    reading : ReadingOptions
        Options with which it was read.
    geometry : bool
        Whether the files contain spacing and orientation; else the panel asks.
    series_number : int
        Which of the series it is.
    labels_beside : tuple of Path
        Files and folders of labels that lie with it.
    file : Volume or None
        The CT in its file, where it does not fit in memory: `volume` is then a coarse copy, and surfaces are made from
        the file.
    shown_stride : (x, y, z) int
        Step between samples of the file in the copy.
    labels : dict of str to Volume
        Labels from files, on its grid, by the key of their source.
    drawn : dict of (int, str) to Drawn
        Drawings on it, by session_uid of the scene and key of the structure; `masks` makes and changes them.
    """

    path: Path
    volume: Volume
    statistics: VolumeStatistics
    series: tuple[Series, ...] = ()
    reading: ReadingOptions = field(default_factory=ReadingOptions)
    geometry: bool = True
    series_number: int = 1
    labels_beside: tuple[Path, ...] = ()
    file: Volume | None = None
    shown_stride: tuple[int, int, int] = (1, 1, 1)
    labels: dict[str, Volume] = field(default_factory=dict)
    drawn: dict[tuple[int, str], Drawn] = field(default_factory=dict)

    @property
    def nbytes(self) -> int:
        """Return the bytes of the samples in memory, and of the drawings on them."""
        return self.volume.nbytes + sum(drawn.mask.nbytes for drawn in self.drawn.values())

    @property
    def full(self) -> Volume:
        """Return all samples, from which surfaces are made and in which regions and strides count."""
        return self.file or self.volume

    @property
    def times(self) -> int:
        """Return the number of volumes at the same position in the series."""
        return next((series.times for series in self.series if series.number == self.series_number), 1)

    def is_another_time_of(self, other: Loaded | None) -> bool:
        """Return whether it is the same series at another time, so that choices made for one hold for the other."""
        if other is None or (self.path, self.series_number) != (other.path, other.series_number):
            return False
        return self.times > 1 and self.full.size == other.full.size and self.reading.time != other.reading.time

    def has_samples_of(self, other: Loaded | None) -> bool:
        """Return whether it is the same series read another way, with equal samples, so that drawings fit."""
        if other is None or (self.path, self.series_number) != (other.path, other.series_number):
            return False
        read = replace(other.reading, **{name: getattr(self.reading, name) for name in OF_THE_SAME_SAMPLES})
        return read == self.reading and self.full.size == other.full.size and (self.file, other.file) == (None, None)

    def for_copy(self, settings: ReconstructionSettings) -> ReconstructionSettings:
        """Return the settings adapted to `volume`."""
        return settings_of_copy(settings, self.shown_stride)


_loaded: dict[str, Loaded] = {}


def keep(loaded: Loaded, scene: bpy.types.Scene) -> None:
    """Make a volume the current one of `scene`; earlier ones stay while they take less than the memory available."""
    fingerprint = loaded.statistics.fingerprint
    scene.ctmc.volume_path = stored_path(loaded.path)
    scene.ctmc.volume_fingerprint = fingerprint
    before = _loaded.pop(fingerprint, None)
    if before is not None:
        loaded.labels.update(before.labels)
    _loaded[fingerprint] = loaded  # The last one loaded comes last.
    used, room = _panel_fingerprints(), available_bytes()
    for earlier in [name for name in reversed(_loaded) if name not in used]:
        room = None if room is None else room - _loaded[earlier].nbytes
        if room is not None and room < 0:
            del _loaded[earlier]


def _panel_fingerprints() -> set[str]:
    """Return the fingerprints of the scenes' present CTs."""
    return {scene.ctmc.volume_fingerprint for scene in bpy.data.scenes}


def _discard_unused(*_: Any) -> None:
    """Release the volumes and labels that no scene of a newly opened file uses."""
    stored = stored_cts()
    for fingerprint in _loaded.keys() - {ct.volume_fingerprint for ct in stored}:
        del _loaded[fingerprint]
    sources = {source.key for ct in stored for source in ct.label_sources}
    for ct in _loaded.values():
        for key in ct.labels.keys() - sources:
            del ct.labels[key]


def release(fingerprint: str) -> None:
    """Release a CT: its samples, labels and drawings, and the surfaces that wait for another simplification.

    The file keeps its path and all choices, so it can be loaded again.
    """
    _loaded.pop(fingerprint, None)
    session.drop_surfaces(fingerprint)
    for scene in bpy.data.scenes:
        change_events.notify(scene.ctmc, change_events.RELEASED)


def all_cts() -> Iterator[Loaded]:
    """Yield all CTs in memory."""
    yield from _loaded.values()


def ct_of(fingerprint: str) -> Loaded | None:
    """Return the CT with this fingerprint, the panel's or another; None if it is not in memory."""
    return _loaded.get(fingerprint)


def loaded(scene: bpy.types.Scene) -> Loaded | None:
    """Return the CT of `scene`, if it is in memory."""
    return ct_of(scene.ctmc.volume_fingerprint)


def require_loaded(scene: bpy.types.Scene) -> Loaded:
    """Return the CT of the scene; raise a `ReadError` if it is not in memory."""
    return require_ct(scene.ctmc.volume_fingerprint)


def require_ct(fingerprint: str) -> Loaded:
    """Return the CT with this fingerprint; raise a `ReadError` if it is not in memory."""
    ct = ct_of(fingerprint)
    if ct is None:
        raise ReadError("the CT is not in memory; load it first")
    return ct


def ct_and_labels(fingerprint: str) -> tuple[Volume | None, Volume | None]:
    """Return the CT and the labels of surfaces of a volume; None for one that is not in memory.

    The CT of labels is one on their grid that was loaded in this session.

    Parameters
    ----------
    fingerprint : str
        Fingerprint of the surfaces' volume.
    """
    own = _loaded.get(fingerprint)
    if own is None or own.volume.kind != ValueKind.LABEL:
        return None if own is None else own.full, None
    cts = [each.full for each in reversed(_loaded.values()) if each.volume.kind != ValueKind.LABEL]
    return next((ct for ct in cts if lie_in_one_place(ct, own.full)), None), own.full


def current(scene: bpy.types.Scene) -> Volume | None:
    """Return the volume of `scene`, if it is in memory."""
    ct = loaded(scene)
    return None if ct is None else ct.volume


def current_full(scene: bpy.types.Scene) -> Volume | None:
    """Return all samples of the CT of `scene`, in memory or in its file."""
    ct = loaded(scene)
    return None if ct is None else ct.full


def used_threshold(scene: bpy.types.Scene) -> float | None:
    """Return the threshold of a reconstruction; None if it is not known yet or not used."""
    ct = loaded(scene)
    try:
        return None if ct is None else quick_threshold(ct.volume, ct.for_copy(scene.ctmc.to_settings()))
    except CtmcError:
        return None


def used_limits(scene: bpy.types.Scene) -> tuple[float | None, float | None]:
    """Return threshold and upper limit of a reconstruction; a structure has no upper limit of the panel's."""
    settings = scene.ctmc
    return used_threshold(scene), settings.upper if settings.use_upper and not settings.use_label else None


def is_coarse(scene: bpy.types.Scene) -> bool:
    """Return whether the CT does not fit in memory and a coarse copy is shown."""
    ct = loaded(scene)
    return ct is not None and ct.file is not None


def last_path() -> Path | None:
    """Return the path of the CT that was loaded last in this session, by whatever file."""
    return _loaded[next(reversed(_loaded))].path if _loaded else None


def called(scene: bpy.types.Scene) -> str:
    """Return the name of a scene's CT, which must be loaded: the panel's Name, else that of its file or folder."""
    return called_as(scene.ctmc, require_loaded(scene))


def called_as(stored: Any, ct: Loaded) -> str:
    """Return the name of a CT of a scene; `stored` is the panel's state of it."""
    return str(stored.volume_name).strip() or ct.volume.name


def missing(scene: bpy.types.Scene) -> bool:
    """Return whether the file has a CT that is not in memory."""
    return bool(scene.ctmc.volume_path) and loaded(scene) is None


def has_volume(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether a CT is in memory, with the reason if not."""
    if current(context.scene) is None:
        operator.poll_message_set("Load the CT again first" if missing(context.scene) else "Load a CT first")
        return False
    return True


register, unregister = change_events.following(load_post=_discard_unused, at_end=_loaded.clear)
