"""Triangles of a COLLADA file (DAE), as a binary STL.

Geometry alone: its triangles and polygons, put where the scene's nodes have them, in metres. The axis that the file
calls up is passed over, as the readers of robot descriptions do (COLLADA 1.4.1, Khronos Group 2008).
"""

import struct
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array

__all__ = ["stl_of_collada", "stl_of_triangles"]

_Indices = NDArray[np.int_]

_HEADER = 80  # bytes of a binary STL before the number of its triangles


def stl_of_triangles(triangles: Array) -> bytes:
    """A binary STL of triangles ``(n, 3, 3)``."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    record = np.zeros(len(triangles), dtype=[("numbers", "<f4", (4, 3)), ("rest", "<u2")])
    record["numbers"][:, 0] = normals / np.where(lengths > 0, lengths, 1.0)
    record["numbers"][:, 1:] = triangles
    return bytes(_HEADER) + struct.pack("<I", len(triangles)) + record.tobytes()


def stl_of_collada(path: Path, content: bytes) -> bytes:
    """The file's triangles as a binary STL."""
    try:
        root = ET.fromstring(content)
    except ET.ParseError as error:
        raise LabError(f"{path}: not a COLLADA file: {error}; export the mesh again") from error
    for element in root.iter():
        element.tag = element.tag.rsplit("}", 1)[-1]  # without the name space
    unit = root.find("asset/unit")
    scale = 1.0 if unit is None else float(unit.get("meter", "1"))
    try:
        found = list(_placed(root))
    except (ValueError, KeyError, IndexError, AttributeError) as error:
        raise LabError(f"{path}: its geometry cannot be read ({error!r}); export the mesh as STL") from error
    if not found:
        raise LabError(f"{path}: has no triangle; export the mesh as STL")
    return stl_of_triangles(scale * np.concatenate(found))


def _placed(root: ET.Element) -> Iterator[Array]:
    """The triangles of every geometry that the scene shows, where it shows them; of all as they are without a scene."""
    geometries = {each.get("id"): each for each in root.iter("geometry")}
    nodes = {each.get("id"): each for each in root.iter("node")}
    scenes = root.findall("library_visual_scenes/visual_scene")
    if not scenes:
        for geometry in geometries.values():
            yield from _triangles(geometry)
    for scene in scenes:
        for node in scene.findall("node"):
            yield from _of_node(node, np.eye(4), geometries, nodes)


def _of_node(
    node: ET.Element, T_parent: Array, geometries: dict[str | None, ET.Element], nodes: dict[str | None, ET.Element]
) -> Iterator[Array]:
    T = T_parent @ _transform(node)
    for instance in node.findall("instance_geometry"):
        for triangles in _triangles(geometries[instance.get("url", "").removeprefix("#")]):
            yield triangles @ T[:3, :3].T + T[:3, 3]
    for child in node.findall("node"):
        yield from _of_node(child, T, geometries, nodes)
    for reference in node.findall("instance_node"):
        yield from _of_node(nodes[reference.get("url", "").removeprefix("#")], T, geometries, nodes)


def _transform(node: ET.Element) -> Array:
    """A node's pose ``(4, 4)``, with its scale."""
    T = np.eye(4)
    for element in node:
        numbers = np.array((element.text or "").split(), dtype=np.float64) if element.tag in _STEPS else None
        if numbers is not None:
            T = T @ _STEPS[element.tag](numbers)
    return T


def _scaled(numbers: Array) -> Array:
    return np.diag([*numbers, 1.0])


_STEPS = {
    "matrix": lambda numbers: numbers.reshape(4, 4),
    "translate": lambda numbers: se3.pose(np.eye(3), numbers),
    "rotate": lambda numbers: se3.pose(se3.exp(np.deg2rad(numbers[3]) * numbers[:3]), np.zeros(3)),
    "scale": _scaled,
}


def _triangles(geometry: ET.Element) -> Iterator[Array]:
    """Triangles ``(n, 3, 3)`` of each group of a geometry; a polygon is a fan about its first corner."""
    sources = {f"#{each.get('id')}": each for each in geometry.iter("source")}
    vertices = {
        f"#{each.get('id')}": next(i.get("source") for i in each.findall("input") if i.get("semantic") == "POSITION")
        for each in geometry.iter("vertices")
    }
    for group in (each for tag in ("triangles", "polylist", "polygons") for each in geometry.iter(tag)):
        inputs = group.findall("input")
        stride = 1 + max(int(each.get("offset", "0")) for each in inputs)
        vertex = next(each for each in inputs if each.get("semantic") == "VERTEX")
        points = _points(sources[vertices[vertex.get("source", "")] or ""])
        corners = [
            np.array((each.text or "").split(), dtype=np.int_).reshape(-1, stride)[:, int(vertex.get("offset", "0"))]
            for each in group.findall("p")
        ]
        yield points[np.concatenate([_fans(group, each) for each in corners])]


def _points(source: ET.Element) -> Array:
    array, accessor = source.find("float_array"), source.find("technique_common/accessor")
    assert array is not None
    stride = 3 if accessor is None else int(accessor.get("stride", "3"))
    return np.array((array.text or "").split(), dtype=np.float64).reshape(-1, stride)[:, :3]


def _fans(group: ET.Element, corners: _Indices) -> _Indices:
    """The corners ``(n, 3)`` of triangles."""
    counts = group.find("vcount")
    if group.tag == "triangles":
        return corners.reshape(-1, 3)
    sizes = [len(corners)] if counts is None else [int(each) for each in (counts.text or "").split()]
    ends = np.cumsum(sizes)
    fans = [
        np.stack([np.full(size - 2, end - size), np.arange(end - size + 1, end - 1), np.arange(end - size + 2, end)], 1)
        for size, end in zip(sizes, ends.tolist(), strict=True)
        if size >= 3
    ]
    return np.asarray(corners[np.concatenate(fans)])
