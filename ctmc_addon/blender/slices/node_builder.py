# SPDX-License-Identifier: GPL-3.0-or-later
"""Write Geometry Nodes as an expression: a call adds a node, links its inputs and returns its output."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from typing import Any

import bpy

from ..sockets import MATH, input_of, output_of

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

    def of(self, kind: str, output: str, inputs: Mapping[str, Any] | None = None, **properties: str) -> Any:
        """Return an output of a new node whose inputs of these names are given; the others stay as they are."""
        node = self.add(kind, **properties)
        for called, source in (inputs or {}).items():
            self.link(source, input_of(node, called))
        return output_of(node, output)

    def math(self, operation: str, *values: Any) -> Any:
        """Add a calculation with numbers."""
        return self.of("ShaderNodeMath", "Value", dict(zip(MATH, values, strict=False)), operation=operation)

    def compare(self, operation: str, first: Any, second: float) -> Any:
        """Return whether a number is less or greater than another."""
        numbers = {"A": first, "B": second}
        return self.of("FunctionNodeCompare", "Result", numbers, data_type="FLOAT", operation=operation)

    def negate(self, value: Any) -> Any:
        """Return whether a condition is false."""
        return self.of("FunctionNodeBooleanMath", "Boolean", {"Boolean": value}, operation="NOT")

    def either(self, first: Any, second: Any) -> Any:
        """Return whether at least one of two conditions is true."""
        conditions = {"Boolean": first, "Boolean_001": second}
        return self.of("FunctionNodeBooleanMath", "Boolean", conditions, operation="OR")

    def total(self, values: Any) -> Any:
        """Return the sum of several numbers; a condition that is true counts as 1."""
        return reduce(lambda first, second: self.math("ADD", first, second), values)

    def switch(self, condition: Any, otherwise: Any, then: Any) -> Any:
        """Return one of two vectors, chosen by a condition."""
        inputs = {"Switch": condition, "False": otherwise, "True": then}
        return self.of("GeometryNodeSwitch", "Output", inputs, input_type="VECTOR")

    def between(self, share: Any, start: Any, end: Any) -> Any:
        """Return the point at a share, 0 to 1, of the way from one to another."""
        way = self.vector("SUBTRACT", end, start)
        part = self.of("ShaderNodeVectorMath", "Vector", {"Vector": way, "Scale": share}, operation="SCALE")
        return self.vector("ADD", start, part)

    def vector(self, operation: str, first: Any, second: Any) -> Any:
        """Add a calculation with two vectors."""
        inputs = {"Vector": first, "Vector_001": second}
        output = "Value" if operation == "DOT_PRODUCT" else "Vector"
        return self.of("ShaderNodeVectorMath", output, inputs, operation=operation)

    def transformed(self, point: Any, matrix: Any) -> Any:
        """Return a point in another space."""
        return self.of("FunctionNodeTransformPoint", "Vector", {"Vector": point, "Transform": matrix})

    def moved(self, geometry: Any, position: Any, condition: Any = True) -> Any:
        """Return a geometry whose vertices that meet a condition have other positions."""
        inputs = {"Geometry": geometry, "Selection": condition, "Position": position}
        return self.of("GeometryNodeSetPosition", "Geometry", inputs)

    def z_of(self, vector: Any) -> Any:
        """Return the third number of a vector."""
        return self.of("ShaderNodeSeparateXYZ", "Z", {"Vector": vector})

    def at_points(self, condition: Any) -> Any:
        """Return a condition on vertices; an edge or a face meets it where all its vertices do."""
        return self.of("GeometryNodeFieldOnDomain", "Value", {"Value": condition}, data_type="BOOLEAN", domain="POINT")

    def on_faces(self, condition: Any) -> Any:
        """Return a condition on faces; a vertex meets it where any of its faces does."""
        return self.of("GeometryNodeFieldOnDomain", "Value", {"Value": condition}, data_type="BOOLEAN", domain="FACE")

    def captured(self, geometry: Any, condition: Any) -> tuple[Any, Any]:
        """Return a geometry whose vertices store a condition as evaluated here, and that condition."""
        node = self.add("GeometryNodeCaptureAttribute", domain="POINT")
        node.capture_items.new("BOOLEAN", "Condition")
        self.link(geometry, input_of(node, "Geometry"))
        self.link(condition, input_of(node, "Condition"))
        return output_of(node, "Geometry"), output_of(node, "Condition")

    def at_vertex(self, kind: str, number: Any, value: Any) -> Any:
        """Return the value, a FLOAT or FLOAT_VECTOR, that the vertex of this number has."""
        inputs = {"Index": number, "Value": value}
        return self.of("GeometryNodeFieldAtIndex", "Value", inputs, data_type=kind, domain="POINT")

    def vertex_from(self, corner: Any, steps: int) -> Any:
        """Return the number of the vertex that lies `steps` corners farther along the face."""
        inputs = {"Corner Index": corner, "Offset": steps}
        farther = self.of("GeometryNodeOffsetCornerInFace", "Corner Index", inputs)
        return self.of("GeometryNodeVertexOfCorner", "Vertex Index", {"Corner Index": farther})

    def separate(self, geometry: Any, condition: Any, domain: str) -> tuple[Any, Any]:
        """Return the part of a geometry that meets a condition, and the remaining part."""
        node = self.add("GeometryNodeSeparateGeometry", domain=domain)
        self.link(geometry, input_of(node, "Geometry"))
        self.link(condition, input_of(node, "Selection"))
        return output_of(node, "Selection"), output_of(node, "Inverted")

    def join(self, *geometries: Any) -> Any:
        """Add a node that joins several geometries."""
        node = self.add("GeometryNodeJoinGeometry")
        for geometry in reversed(geometries):  # Blender puts the last link first
            self.link(geometry, input_of(node, "Geometry"))
        return output_of(node, "Geometry")

    def transform_of(self, obj: bpy.types.Object) -> Any:
        """Return where an object is, in the space of the one that has the modifier."""
        return self.of("GeometryNodeObjectInfo", "Transform", {"Object": obj}, transform_space="RELATIVE")

    def stored(self, geometry: Any, name: str, value: Any) -> Any:
        """Return a geometry whose corners keep a place on a picture under a name."""
        inputs = {"Name": name, "Geometry": geometry, "Value": value}
        kinds = {"data_type": "FLOAT2", "domain": "CORNER"}
        return self.of("GeometryNodeStoreNamedAttribute", "Geometry", inputs, **kinds)

    def arrange(self) -> None:
        """Arrange the nodes side by side in the editor."""
        for number, node in enumerate(self.tree.nodes):
            node.location = (220 * (number // COLUMN), -180 * (number % COLUMN))
