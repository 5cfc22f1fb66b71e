# SPDX-License-Identifier: GPL-3.0-or-later
"""The volumes that have been read in this session. The .blend holds their path and fingerprint, never their values.

Undo may bring back a scene that refers to an earlier volume, so those stay while there is memory for them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ...blender.scene.ct_box import noted_paths
from ...core import ReadError, ReconstructionSettings, Volume, available_bytes
from ...core.volume import ValueKind, VolumeStatistics, lie_in_one_place, settings_of_copy
from ...readers import ReadingOptions, Series
from .drawn import Drawn

OF_THE_SAME_SAMPLES = ("spacing", "flip", "remove_table")
"""Reading options that move samples or change values; each sample stays the same one."""


@dataclass(frozen=True, eq=False)
class Loaded:
    """A volume, and what the panel says of it.

    Parameters
    ----------
    reading : ReadingOptions
        How it was read.
    geometry : bool
        Whether the files say spacing and orientation; else the panel asks.
    series_number : int
        Which of the series it is.
    labels_beside : tuple of Path
        Files and folders of labels that lie with it.
    file : Volume or None
        The CT in its file, where it does not fit in memory: `volume` is then a coarse copy, and surfaces are made from
        the file.
    shown_stride : (x, y, z) int
        Every so many samples of the file are in the copy.
    drawn : dict of (int, str) to Drawn
        What was drawn on it, by session_uid of the scene and key of the structure; `masks` makes and changes it.
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
    drawn: dict[tuple[int, str], Drawn] = field(default_factory=dict)

    @property
    def nbytes(self) -> int:
        """Return the bytes of the samples in memory, and of what was drawn on them."""
        return self.volume.nbytes + sum(drawn.mask.nbytes for drawn in self.drawn.values())

    @property
    def full(self) -> Volume:
        """Return all samples: what surfaces are made from, and what regions and strides count in."""
        return self.file or self.volume

    @property
    def times(self) -> int:
        """Volumes at the same place that the series holds."""
        return next((series.times for series in self.series if series.number == self.series_number), 1)

    def is_another_time_of(self, other: Loaded | None) -> bool:
        """Return whether it is the same series at another time: what was chosen for one then holds for the other."""
        if other is None or (self.path, self.series_number) != (other.path, other.series_number):
            return False
        return self.times > 1 and self.full.size == other.full.size and self.reading.time != other.reading.time

    def has_samples_of(self, other: Loaded | None) -> bool:
        """Return whether it is the same series read another way, each sample the same one: what was drawn then fits."""
        if other is None or (self.path, self.series_number) != (other.path, other.series_number):
            return False
        read = replace(other.reading, **{name: getattr(self.reading, name) for name in OF_THE_SAME_SAMPLES})
        return read == self.reading and self.full.size == other.full.size and (self.file, other.file) == (None, None)

    def for_copy(self, settings: ReconstructionSettings) -> ReconstructionSettings:
        """Return the settings as they are for `volume`."""
        return settings_of_copy(settings, self.shown_stride)


_loaded: dict[str, Loaded] = {}


def keep(loaded: Loaded, scene: bpy.types.Scene) -> None:
    """Make a volume the current one of `scene`; earlier ones stay while they take less than the memory available."""
    fingerprint = loaded.statistics.fingerprint
    scene.ctmc.volume_path = stored_path(loaded.path)
    scene.ctmc.volume_fingerprint = fingerprint
    _loaded.pop(fingerprint, None)
    _loaded[fingerprint] = loaded  # the last one loaded stands last
    used, room = _panel_fingerprints(), available_bytes()
    for earlier in [name for name in reversed(_loaded) if name not in used]:
        room = None if room is None else room - _loaded[earlier].nbytes
        if room is not None and room < 0:
            del _loaded[earlier]


def _panel_fingerprints() -> set[str]:
    """The fingerprints that the scenes of the file refer to."""
    return {scene.ctmc.volume_fingerprint for scene in bpy.data.scenes}


def _all_fingerprints() -> set[str]:
    """The fingerprints of all CTs of the file's scenes, also of those that are not the panel's."""
    return _panel_fingerprints() | {scan.volume_fingerprint for scene in bpy.data.scenes for scan in scene.ctmc_scans}


def discard_unused(*_: Any) -> None:
    """Release the volumes that no scene of a newly opened file refers to."""
    for fingerprint in set(_loaded) - _all_fingerprints():
        del _loaded[fingerprint]


def all_cts() -> Iterator[Loaded]:
    """Yield all CTs in memory."""
    yield from _loaded.values()


def ct_of(fingerprint: str) -> Loaded | None:
    """Return the CT with this fingerprint, the panel's or another; None where it is not in memory."""
    return _loaded.get(fingerprint)


def loaded(scene: bpy.types.Scene) -> Loaded | None:
    """Return what was last loaded for `scene`, if it was loaded in this session."""
    return ct_of(scene.ctmc.volume_fingerprint)


def require_loaded(scene: bpy.types.Scene) -> Loaded:
    """Return the CT of the scene, or a `ReadError`."""
    return require_ct(scene.ctmc.volume_fingerprint)


def require_ct(fingerprint: str) -> Loaded:
    """Return the CT with this fingerprint, or a `ReadError`."""
    ct = ct_of(fingerprint)
    if ct is None:
        raise ReadError("the CT is not in memory; load it first")
    return ct


def ct_and_labels(fingerprint: str) -> tuple[Volume | None, Volume | None]:
    """Return the CT and the labels of surfaces of a volume; None for what is not in memory.

    The CT of labels is one on their grid that was loaded in this session.

    Parameters
    ----------
    fingerprint : str
        Of the volume that the surfaces were made from.
    """
    own = _loaded.get(fingerprint)
    if own is None or own.volume.kind != ValueKind.LABEL:
        return None if own is None else own.full, None
    cts = [other.full for other in reversed(_loaded.values()) if other.volume.kind != ValueKind.LABEL]
    return next((ct for ct in cts if lie_in_one_place(ct, own.full)), None), own.full


def current(scene: bpy.types.Scene) -> Volume | None:
    """Return the volume last loaded for `scene`, if it was loaded in this session."""
    ct = loaded(scene)
    return None if ct is None else ct.volume


def current_full(scene: bpy.types.Scene) -> Volume | None:
    """Return all samples of the CT last loaded for `scene`, in memory or in its file."""
    ct = loaded(scene)
    return None if ct is None else ct.full


def is_coarse(scene: bpy.types.Scene) -> bool:
    """Return whether a coarse copy is shown of a CT that does not fit in memory."""
    ct = loaded(scene)
    return ct is not None and ct.file is not None


def last_path() -> Path | None:
    """Return where the CT lies that was loaded last in this session, of whatever file."""
    return _loaded[next(reversed(_loaded))].path if _loaded else None


def called(scene: bpy.types.Scene) -> str:
    """Return what the CT of a scene is called: the panel's Name, else as its file or folder; it must be loaded."""
    return called_as(scene.ctmc, require_loaded(scene))


def called_as(stored: Any, ct: Loaded) -> str:
    """Return what a CT of a scene is called; `stored` is what the panel knows of it."""
    return str(stored.volume_name).strip() or ct.volume.name


def missing(scene: bpy.types.Scene) -> bool:
    """Return whether the file knows a CT that is not in memory."""
    return bool(scene.ctmc.volume_path) and loaded(scene) is None


def has_volume(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether a CT is in memory, with the reason if not."""
    if current(context.scene) is None:
        operator.poll_message_set("Load the CT again first" if missing(context.scene) else "Load a CT first")
        return False
    return True


def exists(path: str) -> bool:
    """Return whether a file or folder exists at a path that a .blend has noted."""
    return Path(bpy.path.abspath(path)).exists()


def name_of(path: str) -> str:
    """Return the last part of a path that a file has noted, whichever system wrote it."""
    return path.replace("\\", "/").rstrip("/").rpartition("/")[2]


def stored_path(path: Path, blend_path: str = "") -> str:
    """Return how a file notes a path: relative to `blend_path`, by default the present .blend, where possible."""
    blend = blend_path or bpy.data.filepath
    if not blend:
        return str(path)
    try:
        return str(bpy.path.relpath(str(path), start=str(Path(blend).parent)))
    except ValueError:  # another drive
        return str(path)


_absolute: list[str] = []  # where the noted paths lead, while the file is saved


def noted() -> list[tuple[str, Callable[[str], None]]]:
    """Return the paths that the open file has noted, each with what notes another in its place."""
    cts = [ct for scene in bpy.data.scenes for ct in (scene.ctmc, *scene.ctmc_scans)]
    sources = [source for ct in cts for source in ct.label_sources]
    notes = [(ct.volume_path, partial(setattr, ct, "volume_path")) for ct in cts]
    notes += [(source.path, partial(setattr, source, "path")) for source in sources]
    return notes + noted_paths()


def before_save(target: str, *_: Any) -> None:
    """Make paths relative to the place that the .blend is saved to; those of another system stay as they are."""
    paths = [bpy.path.abspath(path) for path, _ in noted()]
    _absolute[:] = [path if Path(path).is_absolute() else "" for path in paths]
    _relate_paths(target)


def after_save(*_: Any) -> None:
    """Make paths relative to the open file again, which is not the saved one if that was a copy."""
    _relate_paths(bpy.data.filepath)
    _absolute.clear()


def _relate_paths(blend: str) -> None:
    """Note the paths relative to a .blend, or whole where it has no place yet."""
    for (_, note), path in zip(noted(), _absolute, strict=False):
        if path:
            note(stored_path(Path(path), blend))


HANDLERS = {"load_post": discard_unused, "save_pre": before_save, "save_post": after_save, "save_post_fail": after_save}


def register() -> None:
    """Listen for files that are opened and saved."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(bpy.app.handlers.persistent(handler))


def unregister() -> None:
    """Stop listening, and release every volume."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    _loaded.clear()
