"""Alpha of a finished surface, moved through its shape key with no extraction."""

from __future__ import annotations

import json

import bpy

from .objects import KEY, MEMORY


def has_alpha(thing: bpy.types.Object) -> bool:
    """Whether a surface's alpha is still open: the built-in simplifier and Make Final fix it."""
    keys = getattr(thing.data, "shape_keys", None)
    return thing.get(MEMORY) is not None and keys is not None and KEY in keys.key_blocks


def set_alpha(thing: bpy.types.Object, alpha: float) -> bool:
    """Move a surface to `alpha` and note it among its settings; whether anything changed.

    An animation or driver of the key has the last word.
    """
    if not has_alpha(thing):
        return False
    keys, memory = thing.data.shape_keys, thing[MEMORY]
    noted = json.loads(memory["settings"])
    if noted.get("alpha") == alpha and abs(keys.key_blocks[KEY].value - alpha) < 1e-6:
        return False
    keys.key_blocks[KEY].value = alpha
    noted["alpha"] = alpha
    memory["settings"] = json.dumps(noted)
    report = json.loads(memory["report"])
    report["settings"]["alpha"] = alpha
    memory["report"] = json.dumps(report, ensure_ascii=False)
    return True
