"""What is drawn over a 3D viewport and stored nowhere."""

from .overlay import Picture, draw_letters, draw_lines
from .preview_surface import PreviewSurface, forget_shader

__all__ = [
    "Picture",
    "PreviewSurface",
    "draw_letters",
    "draw_lines",
    "forget_shader",
]
