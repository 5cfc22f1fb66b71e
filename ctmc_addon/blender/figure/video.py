# SPDX-License-Identifier: GPL-3.0-or-later
"""Make videos from pictures with the FFmpeg inside Blender."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import bpy

from ...core import OutputError
from ..datablocks import remove_render_results, render_results
from ..scene.studio import set_render
from .spec import VIDEO_FORMATS


def require_video(path: Path, transparent: bool) -> None:
    """Raise `OutputError` for a video that this Blender cannot write."""
    suffix = path.suffix.lower()
    if suffix not in VIDEO_FORMATS:
        raise OutputError(
            f"{suffix} is not a video that Blender writes; choose {', '.join(VIDEO_FORMATS)}, or a "
            "folder for PNG frames"
        )
    if transparent:
        raise OutputError("a video has a background; write PNG frames into a folder, or leave out the transparency")
    if not _has_format(suffix):
        raise OutputError(f"this Blender was built without {suffix} videos; write PNG frames into a folder")


def _has_format(suffix: str) -> bool:
    container, codec = VIDEO_FORMATS[suffix]
    ffmpeg = bpy.types.FFmpegSettings.bl_rna.properties
    supported = container in ffmpeg["format"].enum_items and codec in ffmpeg["codec"].enum_items
    return bool(bpy.app.ffmpeg.supported and bpy.app.build_options.codec_ffmpeg and supported)


class Video(NamedTuple):
    """A video to make from pictures.

    Parameters
    ----------
    frames : sequence of str
        Paths of the pictures.
    folder : str
        An empty folder for the video; Blender chooses the file name.
    name : str
        Name for messages; its suffix chooses the format.
    fps : int
        Pictures a second.
    size : (width, height) int
        Pixels.
    """

    frames: Sequence[str]
    folder: str
    name: str
    fps: int
    size: tuple[int, int]

    def make(self, _scene: bpy.types.Scene) -> None:
        """Write the video in a separate scene.

        Raises
        ------
        OutputError
            If Blender cannot.
        """
        scene, renders = bpy.data.scenes.new("CTMC Video"), render_results()
        try:
            _set_up(scene, [Path(frame) for frame in self.frames], Path(self.name).suffix.lower(), self.fps, self.size)
            scene.render.filepath = str((Path(self.folder) / "video").resolve())
            bpy.ops.render.render(animation=True, scene=scene.name)
        except RuntimeError as error:
            raise OutputError(f"{self.name} could not be written: {' '.join(str(error).split())}") from error
        finally:
            bpy.data.scenes.remove(scene)
            remove_render_results(renders)

    @property
    def file(self) -> Path:
        """Return the path of the video.

        Raises
        ------
        OutputError
            If the file is missing; Blender reports failures only in its printed output.
        """
        written = sorted(Path(self.folder).iterdir())
        if len(written) != 1 or not written[0].stat().st_size:
            raise OutputError(
                f"this Blender cannot write {Path(self.name).suffix} videos; write PNG frames into a folder"
            )
        return written[0]


def _set_up(scene: bpy.types.Scene, frames: Sequence[Path], suffix: str, fps: int, size: tuple[int, int]) -> None:
    """Put the pictures on a strip, and choose container and codec."""
    set_render(scene, size)
    scene.frame_start, scene.frame_end = 1, len(frames)
    editor = scene.sequence_editor_create()
    strips: Any = editor.strips if hasattr(editor, "strips") else editor.sequences
    strip = strips.new_image("Frames", str(frames[0].resolve()), channel=1, frame_start=1)
    for frame in frames[1:]:
        strip.elements.append(frame.name)
    render = scene.render
    render.use_sequencer, render.fps = True, fps
    if hasattr(render.image_settings, "media_type"):
        render.image_settings.media_type = "VIDEO"
    render.image_settings.file_format = "FFMPEG"
    render.ffmpeg.format, render.ffmpeg.codec = VIDEO_FORMATS[suffix]
    render.ffmpeg.constant_rate_factor = "HIGH"
    render.ffmpeg.ffmpeg_preset = "GOOD"
    render.ffmpeg.gopsize = fps
    render.ffmpeg.audio_codec = "NONE"
