"""Films from pictures, by the FFmpeg inside Blender."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy

from ...core import OutputError
from ..datablocks import remove_render_results, render_results
from ..output_files import written_whole
from ..studio import set_render

# Container and codec, Blender's names, for every suffix.
FILMS = {
    ".mp4": ("MPEG4", "H264"),
    ".mkv": ("MKV", "H264"),
    ".mov": ("QUICKTIME", "H264"),
    ".webm": ("WEBM", "WEBM"),
    ".avi": ("AVI", "MPEG4"),
    ".ogv": ("OGG", "THEORA"),
}


def require_film(path: Path, transparent: bool) -> None:
    """Raise `OutputError` for a film that this Blender cannot write."""
    suffix = path.suffix.lower()
    if suffix not in FILMS:
        raise OutputError(
            f"{suffix} is no film Blender writes; take one of {', '.join(FILMS)}, or a folder for PNG frames"
        )
    if transparent:
        raise OutputError("a film has a background; write PNG frames into a folder, or leave the transparency out")
    if not has_format(suffix):
        raise OutputError(f"this Blender was built without {suffix} films; take PNG frames in a folder")


def has_format(suffix: str) -> bool:
    """Whether this Blender was built with a film format."""
    container, codec = FILMS[suffix]
    ffmpeg = bpy.types.FFmpegSettings.bl_rna.properties
    known = container in ffmpeg["format"].enum_items and codec in ffmpeg["codec"].enum_items
    return bool(bpy.app.ffmpeg.supported and bpy.app.build_options.codec_ffmpeg and known)


def encode(frames: Sequence[Path], path: Path, fps: int, size: tuple[int, int]) -> None:
    """Write a film of pictures, whole or not at all, in a scene of its own.

    Raises
    ------
    OutputError
        If Blender cannot write it.
    """
    scene = bpy.data.scenes.new("CTMC Film")
    folder, renders = frames[0].parent / ".film", render_results()
    try:
        set_up(scene, frames, path.suffix.lower(), fps, size)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        scene.render.filepath = str((folder / "film").resolve())
        bpy.ops.render.render(animation=True, scene=scene.name)
        made = sorted(folder.iterdir())
        if len(made) != 1 or not made[0].stat().st_size:
            raise OutputError(f"this Blender cannot write {path.suffix} films; take PNG frames in a folder")
        with written_whole(path) as beside:
            shutil.copyfile(made[0], beside)
    except RuntimeError as error:
        raise OutputError(f"{path.name} could not be written: {' '.join(str(error).split())}") from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        bpy.data.scenes.remove(scene)
        remove_render_results(renders)


def set_up(scene: bpy.types.Scene, frames: Sequence[Path], suffix: str, fps: int, size: tuple[int, int]) -> None:
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
    render.ffmpeg.format, render.ffmpeg.codec = FILMS[suffix]
    render.ffmpeg.constant_rate_factor = "HIGH"
    render.ffmpeg.ffmpeg_preset = "GOOD"
    render.ffmpeg.gopsize = fps
    render.ffmpeg.audio_codec = "NONE"
