# SPDX-License-Identifier: GPL-3.0-or-later
"""Write Geometry Nodes as an expression: a call adds a node, links its inputs and returns its output."""

from __future__ import annotations

from functools import reduce
from typing import Any

import bpy

COLUMN = 8  # Nodes in a column.


class Nodes:
    """Builder of a tree's nodes; sockets go in, sockets come out."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree

    def add(self, kind: str, **properties: str) -> Any:
        """Return a new node with these properties."""
        node = self.tree.nodes.new(kind)
        for name, value in properties.items():
            setattr(node, name, value)
        return node

    def link(self, source: Any, socket: Any) -> None:
        """Link a socket to another, or set it to a number."""
        if isinstance(source, bpy.types.NodeSocket):
            self.tree.links.new(source, socket)
        else:
            socket.default_value = source

    def of(self, kind: str, *sources: Any, **properties: str) -> Any:
        """Return the first output of a new node with these inputs in order; None keeps an input's value."""
        node = self.add(kind, **properties)
        # A node has sockets for every type it knows; those of other types than its own are disabled.
        inputs = [socket for socket in node.inputs if socket.enabled]
        for source, socket in zip(sources, inputs, strict=False):
            if source is not None:
                self.link(source, socket)
        return next(socket for socket in node.outputs if socket.enabled)

    def math(self, operation: str, *values: Any) -> Any:
        """Add a calculation with numbers."""
        return self.of("ShaderNodeMath", *values, operation=operation)

    def compare(self, operation: str, first: Any, second: float) -> Any:
        """Return whether a number is less or greater than another."""
        return self.of("FunctionNodeCompare", first, second, data_type="FLOAT", operation=operation)

    def negate(self, value: Any) -> Any:
        """Return whether a condition is false."""
        return self.of("FunctionNodeBooleanMath", value, operation="NOT")

    def either(self, first: Any, second: Any) -> Any:
        """Return whether at least one of two conditions is true."""
        return self.of("FunctionNodeBooleanMath", first, second, operation="OR")

    def total(self, values: Any) -> Any:
        """Return the sum of several numbers; a condition that is true counts as 1."""
        return reduce(lambda first, second: self.math("ADD", first, second), values)

    def switch(self, condition: Any, otherwise: Any, then: Any) -> Any:
        """Return one of two vectors, chosen by a condition."""
        return self.of("GeometryNodeSwitch", condition, otherwise, then, input_type="VECTOR")

    def between(self, share: Any, start: Any, end: Any) -> Any:
        """Return the point at a share, 0 to 1, of the way from one to another."""
        way = self.of("ShaderNodeVectorMath", end, start, operation="SUBTRACT")
        scale = self.add("ShaderNodeVectorMath", operation="SCALE")
        self.link(way, scale.inputs["Vector"])
        self.link(share, scale.inputs["Scale"])
        return self.of("ShaderNodeVectorMath", start, scale.outputs[0], operation="ADD")

    def z_of(self, vector: Any) -> Any:
        """Return the third number of a vector."""
        node = self.add("ShaderNodeSeparateXYZ")
        self.link(vector, node.inputs[0])
        return node.outputs["Z"]

    def at_points(self, condition: Any) -> Any:
        """Return a condition on vertices; an edge or a face meets it where all its vertices do."""
        return self.of("GeometryNodeFieldOnDomain", condition, data_type="BOOLEAN", domain="POINT")

    def on_faces(self, condition: Any) -> Any:
        """Return a condition on faces; a vertex meets it where any of its faces does."""
        return self.of("GeometryNodeFieldOnDomain", condition, data_type="BOOLEAN", domain="FACE")

    def captured(self, geometry: Any, condition: Any) -> tuple[Any, Any]:
        """Return a geometry whose vertices store a condition as evaluated here, and that condition."""
        node = self.add("GeometryNodeCaptureAttribute", domain="POINT")
        node.capture_items.new("BOOLEAN", "Condition")
        self.link(geometry, node.inputs[0])
        self.link(condition, node.inputs[1])
        return node.outputs[0], node.outputs[1]

    def at_vertex(self, kind: str, number: Any, value: Any) -> Any:
        """Return the value, a FLOAT or FLOAT_VECTOR, that the vertex of this number has."""
        node = self.add("GeometryNodeFieldAtIndex", data_type=kind, domain="POINT")
        self.link(number, node.inputs["Index"])
        self.link(value, next(socket for socket in node.inputs if socket.enabled and socket.name == "Value"))
        return next(socket for socket in node.outputs if socket.enabled)

    def vertex_from(self, corner: Any, steps: int) -> Any:
        """Return the number of the vertex that lies some corners farther along the face."""
        return self.of("GeometryNodeVertexOfCorner", self.of("GeometryNodeOffsetCornerInFace", corner, steps))

    def separate(self, geometry: Any, condition: Any, domain: str) -> tuple[Any, Any]:
        """Return the part of a geometry that meets a condition, and the remaining part."""
        node = self.add("GeometryNodeSeparateGeometry", domain=domain)
        self.link(geometry, node.inputs["Geometry"])
        self.link(condition, node.inputs["Selection"])
        return node.outputs[0], node.outputs[1]

    def join(self, *geometries: Any) -> Any:
        """Add a node that joins several geometries."""
        node = self.add("GeometryNodeJoinGeometry")
        for geometry in reversed(geometries):  # Blender puts the last link first
            self.tree.links.new(geometry, node.inputs[0])
        return node.outputs[0]

    def transform_of(self, obj: bpy.types.Object) -> Any:
        """Return the transform of an object, in the space of the object with the modifier."""
        info = self.add("GeometryNodeObjectInfo", transform_space="RELATIVE")
        info.inputs["Object"].default_value = obj
        return info.outputs["Transform"]

    def stored(self, geometry: Any, name: str, value: Any) -> Any:
        """Return a geometry whose corners store a position on a picture under a name."""
        node = self.add("GeometryNodeStoreNamedAttribute", data_type="FLOAT2", domain="CORNER")
        node.inputs["Name"].default_value = name
        self.link(geometry, node.inputs["Geometry"])
        self.link(value, next(socket for socket in node.inputs if socket.enabled and socket.name == "Value"))
        return node.outputs[0]

    def arrange(self) -> None:
        """Arrange the nodes side by side in the editor."""
        for number, node in enumerate(self.tree.nodes):
            node.location = (220 * (number // COLUMN), -180 * (number % COLUMN))
