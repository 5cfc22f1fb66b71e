# SPDX-License-Identifier: GPL-3.0-or-later
"""Sockets of nodes, found by what they are called and never by their number, which differs between Blender versions.

Identifiers stay where names change: what 4.2 calls Fac, 5.0 calls Factor, and both identify as Fac.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

MATH = ("Value", "Value_001", "Value_002")
"""Identifiers of the inputs of a Math node, whose names are all the same."""


def input_of(node: Any, called: str) -> Any:
    """Return the input of a node with this identifier, else with this name, among those that it uses."""
    return _socket(node, node.inputs, called)


def output_of(node: Any, called: str) -> Any:
    """Return the output of a node with this identifier, else with this name, among those that it uses."""
    return _socket(node, node.outputs, called)


def _socket(node: Any, sockets: Iterable[Any], called: str) -> Any:
    # A node has sockets for every type it knows; those of other types than its own are disabled.
    enabled = [socket for socket in sockets if socket.enabled]
    for attribute in ("identifier", "name"):
        for socket in enabled:
            if getattr(socket, attribute) == called:
                return socket
    raise KeyError(f"{node.bl_idname} has no socket {called!r} but {[socket.identifier for socket in enabled]}")
