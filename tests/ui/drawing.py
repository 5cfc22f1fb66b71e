# SPDX-License-Identifier: GPL-3.0-or-later
"""A layout that writes down what a panel asks for, and the meshes of a scene."""

from __future__ import annotations

import bpy


class Layout:
    """Takes the place of Blender's, which exists only while a window is drawn."""

    def __init__(self):
        self.shown, self.buttons, self.texts, self.labels, self.names, self.bare = [], [], [], [], [], []
        self.folds = {}

    def row(self, **_):
        return self

    box = column = split = grid_flow = row

    def panel(self, identifier, default_closed=False):
        """Open it, and note whether it would begin closed."""
        self.folds[identifier] = default_closed
        return self, self

    def popover(self, panel, **_):
        assert hasattr(bpy.types, panel)

    def template_icon(self, *_a, **_k):
        pass

    def prop(self, owner, name, text=None, expand=False, **_):
        assert name in owner.bl_rna.properties, name
        self.shown.append(name)
        self.labels.append(text or "")
        about = owner.bl_rna.properties[name]
        if text is None and not expand and about.type != "BOOLEAN":  # Blender writes its name on the left
            self.names.append(about.name)
            is_number = about.type in ("INT", "FLOAT") and about.unit == "NONE" and about.subtype != "FACTOR"
            if is_number and not about.name.endswith("]"):
                self.bare.append(about.name)

    def prop_enum(self, owner, name, _value, text=None, **_):
        assert name in owner.bl_rna.properties, name
        self.shown.append(name)
        self.labels.append(text or "")

    def prop_search(self, owner, name, _data, _property, **options):
        self.prop(owner, name, **options)

    def operator(self, name, text=None, **_):
        self.buttons.append(name if text is None else f"{name} {text}".rstrip())
        return type("Button", (), {})()

    def operator_menu_enum(self, name, _property, text=None, **_):
        return self.operator(name, text)

    def label(self, text="", **_):
        self.texts.append(text)

    def progress(self, factor, text):
        assert 0 <= factor <= 1
        self.texts.append(text)

    def template_list(self, kind, _, owner, name, *_a, **_k):
        assert hasattr(bpy.types, kind)
        self.shown.append(name)


def drawn(*panels):
    layout = Layout()
    for panel in panels:  # a part of a page is a function
        if isinstance(panel, type):
            panel.draw(type("Panel", (), {"layout": layout})(), bpy.context)
        else:
            panel(layout, bpy.context)
    return layout


def meshes_in(scene):
    """The scene's objects but the boxes of CTs."""
    return [obj for obj in scene.objects if obj.type == "MESH"]
