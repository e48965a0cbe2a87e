"""Read, patch and write URDF files.

For MuJoCo, meshes are found and read, and the base becomes a link. Meshes are searched as by ROS:
``package://NAME/...`` in a folder NAME, or in one with the package, up the tree from the file; ``file://`` and plain
paths beside the file. STL, OBJ and DAE are read.
"""

import re
import struct
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.limits import MESH_BYTES, TEXT_BYTES
from lab.core.se3 import Array
from lab.formats.description import IdentifiedRobot
from lab.formats.link_tree import Link, free_name, last_axis_frame, link_tree
from lab.formats.structured import read_bytes, read_text
from lab.formats.ur_calibration import ur_frames
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = [
    "UrdfSource",
    "identified_urdf",
    "is_from_xacro",
    "is_urdf",
    "mesh_files",
    "read_urdf",
    "stl_of_collada",
    "with_origins",
    "xacro_properties",
]

_LISTED = 12  # links in a message
_PLACEHOLDER_KG = 1e-3
_GYRATION_M = 0.05
_ABOUT = """\
The identified geometry alone: no sag, no backlash, no shapes.
The root link is the frame in which the arm was measured. Lengths in m, angles in rad.
A velocity or an effort of 0 is not given.
"""


def identified_urdf(identified: IdentifiedRobot[SerialArm, object]) -> str:
    """Return the identified arm as links and joints, to the last digit.

    Joints have the chain's names. Links are those of ``link_tree``: the instrument's frame, frame 0, one a joint, the
    last frame, and one a target; for Universal Robots also tool0, as in ``ur_kinematics.yaml``.
    """
    chain, loads = identified.arm.chain, identified.loads
    root = ET.Element("robot", name=identified.name)
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", fusestatic="false")  # MuJoCo keeps fixed links
    for link in [*link_tree(identified.arm, identified.values).links, *_tool0(identified)]:
        element = ET.SubElement(root, "link", name=link.name)
        if link.joint is not None:
            _add_mass(element, *_mass_and_centre(loads, link))
        if link.parent is not None:
            _add_joint(root, chain, link, link.parent)
    ET.indent(root)
    head = f'<?xml version="1.0"?>\n<!--\n{_ABOUT}{_masses_note(loads)}\n-->\n'
    return head + ET.tostring(root, encoding="unicode") + "\n"


def _tool0(identified: IdentifiedRobot[SerialArm, object]) -> list[Link]:
    """Return tool0 of an arm of Universal Robots, fixed to the last link; none for another arm, or a bad fit's."""
    arm, values = identified.arm, identified.values
    tree = link_tree(arm, values)
    name = free_name("tool0", [link.name for link in tree.links])
    try:
        placed = ur_frames(arm, values)
    except LabError:  # the identified arm has no such frame; its own links are written all the same
        return []
    if placed is None:
        return []
    T_instrument_last = arm.T_tracker_frame0(values) @ last_axis_frame(arm, values)
    T_last_tool0 = se3.inverse(T_instrument_last) @ placed.T_instrument_base @ placed.joints[-1]
    return [Link(name, tree.moving[-1].name, T_last_tool0, np.eye(4))]


def _add_mass(element: ET.Element, mass_kg: float, centre: Array) -> None:
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", xyz=_numbers(centre), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(mass_kg))
    moment = repr(mass_kg * _GYRATION_M**2)  # some readers refuse a moving link without an inertia
    ET.SubElement(inertial, "inertia", ixx=moment, iyy=moment, izz=moment, ixy="0", ixz="0", iyz="0")


def _add_joint(root: ET.Element, chain: Chain, link: Link, parent: str) -> None:
    i = link.joint
    kind = "fixed" if i is None else "prismatic" if chain.prismatic[i] else "revolute"
    name = free_name(f"{link.name}_fixed", chain.joint_names) if i is None else chain.joint_names[i]
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=link.name)
    xyz, rpy = _origin(link.T_parent_link)
    ET.SubElement(joint, "origin", xyz=xyz, rpy=rpy)
    if i is None:
        return
    ET.SubElement(joint, "axis", xyz=_numbers(np.array([0.0, 0.0, link.sign])))
    lower, upper, speed = (repr(float(value[i])) for value in (chain.lower, chain.upper, np.nan_to_num(chain.speed)))
    ET.SubElement(joint, "limit", lower=lower, upper=upper, effort="0", velocity=speed)


def _mass_and_centre(loads: Loads | None, link: Link) -> tuple[float, Array]:
    """Return mass (kg) and centre ``(3,)`` (m) in the frame of a moving link, nominal or placeholders."""
    assert link.joint is not None
    mass = 0.0 if loads is None else float(loads.mass_kg[link.joint])
    if loads is None or mass <= 0:
        return _PLACEHOLDER_KG, np.zeros(3)
    return mass, se3.transform(link.T_link_frame, loads.centre_m[link.joint][None])[0]


def _masses_note(loads: Loads | None) -> str:
    if loads is None:
        return "Masses and inertias are placeholders: the robot's are not given."
    return "Masses and their centres are the nominal model's (1 g where it has none); inertias are placeholders."


def _numbers(vector: Array) -> str:
    """Format a vector with every digit; zero has no sign."""
    return " ".join(repr(float(value) + 0.0) for value in vector)


_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_JOINT = re.compile(
    r"<joint\b[^>]*?\bname\s*=\s*([\"'])(?P<name>.*?)\1[^>]*?(?<!/)>(?P<body>.*?)</joint\s*>", re.DOTALL
)
_ORIGIN = re.compile(r"<origin\b[^>]*?(/>|>\s*</origin\s*>)", re.DOTALL)


def with_origins(text: str, origins: Mapping[str, Array]) -> str:
    """Replace the origins of joints in a URDF by poses ``(4, 4)`` (m) in their parents' frames."""
    plain = _COMMENT.sub(lambda match: " " * len(match[0]), text)  # comments may hold joints too
    placed, parts, at = set[str](), list[str](), 0
    for joint in _JOINT.finditer(plain):
        if joint["name"] not in origins or joint["name"] in placed or "<parent" not in joint["body"]:
            continue
        placed.add(joint["name"])
        origin = _ORIGIN.search(plain, joint.start("body"), joint.end("body"))
        start, end = origin.span() if origin else (joint.start("body"), joint.start("body"))
        xyz, rpy = _origin(origins[joint["name"]])
        parts += [text[at:start], f'<origin xyz="{xyz}" rpy="{rpy}"/>']
        at = end
    if missing := sorted(set(origins) - placed):
        raise LabError(f"joint {missing[0]} is not in the URDF as a joint with an origin; its text cannot be patched")
    return "".join([*parts, text[at:]])


def _origin(T: Array) -> tuple[str, str]:
    return _numbers(T[:3, 3]), _numbers(se3.roll_pitch_yaw(T[:3, :3]))


def is_from_xacro(text: str) -> bool:
    """Check whether a URDF was generated from a xacro, by its own comment."""
    return "autogenerated by xacro" in text


def xacro_properties(origins: Mapping[str, Array]) -> str:
    """Return the origins as xacro properties ``JOINT_xyz`` and ``JOINT_rpy``, for inclusion in a source."""
    lines = ['<?xml version="1.0"?>', '<robot xmlns:xacro="http://www.ros.org/wiki/xacro">']
    lines.append("  <!-- Identified origins: include this file, and give each joint")
    lines.append('       <origin xyz="${JOINT_xyz}" rpy="${JOINT_rpy}"/>, with its name for JOINT -->')
    for name, T in origins.items():
        word = re.sub(r"\W", "_", name)
        for end, numbers in zip(("xyz", "rpy"), _origin(T), strict=True):
            lines.append(f'  <xacro:property name="{word}_{end}" value="{numbers}"/>')
    return "\n".join([*lines, "</robot>", ""])


_XACRO = "www.ros.org/wiki/xacro"


@dataclass(frozen=True)
class UrdfSource:
    """Input for MuJoCo.

    Attributes:
        text: the URDF, with meshes named as in ``assets``.
        assets: content of each mesh, as STL or OBJ.
        missing: a missing or unreadable mesh, and the paths tried, or "".
        fixed_joints: joints of a gripper, fixed at zero.
    """

    text: str
    assets: dict[str, bytes]
    missing: str
    fixed_joints: tuple[str, ...]


def is_urdf(path: Path) -> bool:
    """Check whether a file is a URDF: by its suffix, or by its beginning."""
    return path.suffix == ".urdf" or b"<robot" in read_bytes(path, TEXT_BYTES)[:4096]


def read_urdf(path: Path, *, gripper: bool = True) -> UrdfSource:
    """Read a URDF and its meshes.

    Visual shapes are used only if no link has collision shapes.

    Args:
        gripper: whether branches into which an arm forks, if all have fewer joints than the arm, are a gripper, fixed
            at zero.
    """
    text = read_text(path, TEXT_BYTES)
    if "<!ENTITY" in text or "<!DOCTYPE" in text:
        raise LabError(f"{path}: it declares entities or a document type, which no URDF needs; remove them")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise LabError(f"{path}: not a readable MJCF or URDF, mend it there: {error}") from error
    if any(_XACRO in element.tag for element in root.iter()):
        raise LabError(f"{path}: is a xacro that is not expanded; run 'xacro {path.name} > robot.urdf', and give that")
    _refuse_loose_joints(path, root)
    _keep_solid_shapes(root)
    held = _hold_gripper(root) if gripper else ()
    _add_world(root)
    assets, missing = _take_meshes(path, root)
    if root.find("mujoco/compiler") is None:
        compiler = ET.SubElement(ET.SubElement(root, "mujoco"), "compiler")
    else:
        compiler = next(root.iter("compiler"))
    compiler.set("strippath", "false")
    return UrdfSource(ET.tostring(root, encoding="unicode"), assets, missing, held)


def _take_meshes(path: Path, root: ET.Element) -> tuple[dict[str, bytes], str]:
    """Name the meshes anew, and return their contents by name, and a message on the first that is missing, or ""."""
    assets, missing = dict[str, bytes](), ""
    for mesh in root.iter("mesh"):
        try:
            file = _found(path, mesh.get("filename", ""))
            asset = f"mesh{len(assets)}{'.obj' if file.suffix.lower() == '.obj' else '.stl'}"
            assets[asset] = _content(file)
            mesh.set("filename", asset)
        except LabError as error:
            missing = missing or str(error)
    return assets, missing


def mesh_files(path: Path) -> Iterator[Path]:
    """Yield the existing meshes of a URDF."""
    try:
        root = ET.fromstring(read_text(path, TEXT_BYTES))
    except ET.ParseError as error:
        raise LabError(f"{path}: not a readable URDF, mend it there: {error}") from error
    for mesh in root.iter("mesh"):
        with suppress(LabError):
            yield _found(path, mesh.get("filename", ""))


def _refuse_loose_joints(path: Path, root: ET.Element) -> None:
    """Refuse joints that do not name the two links that they join, or name one that is not there."""
    links = {"world", *(name for each in root.iter("link") if (name := each.get("name")))}
    for joint in root.findall("joint"):
        for part in ("parent", "child"):
            name, link = joint.get("name", "without a name"), joint.find(part)
            if link is None or not (named := link.get("link")):
                raise LabError(f'{path}: joint {name} names no {part} link; give it a <{part} link="..."/>')
            if named not in links:
                near = get_close_matches(named, links, 1)
                meant = f"is {near[0]} meant?" if near else f"there are {', '.join(sorted(links)[:_LISTED])}"
                raise LabError(
                    f"{path}: joint {name}: its {part} link '{named}' is not in the file; {meant} (mend its name)"
                )


def _keep_solid_shapes(root: ET.Element) -> None:
    """Keep collision shapes, or visual ones if there are none."""
    links = root.findall("link")
    has_solid = any(link.find("collision") is not None for link in links)
    for link in links:
        for visual in link.findall("visual"):
            if has_solid:
                link.remove(visual)
            else:
                visual.tag = "collision"


def _moving_chains(root: ET.Element) -> list[list[ET.Element]]:
    """Return the joints that move, from the base to each tip."""
    joints = {_link(joint, "child"): joint for joint in root.findall("joint")}
    carriers = {_link(joint, "parent") for joint in joints.values()}
    chains = []
    for link in [name for name in joints if name not in carriers]:
        chain = list[ET.Element]()
        while (joint := joints.get(link)) is not None and len(chain) <= len(joints):
            chain.insert(0, joint)
            link = _link(joint, "parent")
        chains.append([joint for joint in chain if joint.get("type") not in ("fixed", None)])
    return chains


def _link(joint: ET.Element, end: str) -> str | None:
    """Return the link at an end of a joint, ``parent`` or ``child``."""
    element = joint.find(end)
    return None if element is None else element.get("link")


def _hold_gripper(root: ET.Element) -> tuple[str, ...]:
    """Fix the joints of shorter branches beyond a fork, and return their names."""
    chains = _moving_chains(root)
    shared = [each[0] for each in zip(*chains, strict=False) if all(other is each[0] for other in each)]
    branches = [chain[len(shared) :] for chain in chains]
    moving = [branch for branch in branches if branch]
    if len(moving) < 2 or max(map(len, moving)) >= len(shared):
        return ()
    held = dict.fromkeys(joint for branch in moving for joint in branch)
    for joint in held:
        joint.set("type", "fixed")
        for mimic in joint.findall("mimic"):
            joint.remove(mimic)
    return tuple(joint.get("name", "") for joint in held)


def _add_world(root: ET.Element) -> None:
    """Fix the base to a world: MuJoCo takes a root link for the world, whose contacts cannot be excluded."""
    children = {child.get("link") for child in root.iter("child")}
    roots = [link for link in root.findall("link") if link.get("name") not in children]
    names = {link.get("name", "") for link in root.findall("link")}
    if len(roots) != 1 or roots[0].find("collision") is None:
        return
    world = free_name("world", names)
    base = roots[0].get("name", "")
    ET.SubElement(root, "link", name=world)
    joint = ET.SubElement(root, "joint", name=f"{base}_to_{world}", type="fixed")
    ET.SubElement(joint, "parent", link=world)
    ET.SubElement(joint, "child", link=base)


def _found(path: Path, name: str) -> Path:
    tried = list(_places(path.resolve(), name))
    for file in tried:
        if file.is_file():
            return file
    raise LabError(f"{path}: mesh '{name}' is missing; paths tried: {', '.join(map(str, tried[:3]))}")


def _places(path: Path, name: str) -> Iterator[Path]:
    """Yield the possible paths of a mesh, the most likely first."""
    if name.startswith("package://"):
        package, _, rest = name.removeprefix("package://").partition("/")
        for folder in path.parents:
            if folder.name == package:
                yield folder / rest
        for folder in path.parents:
            yield folder / package / rest
        yield from (folder / rest for folder in path.parents[:3])
    else:
        yield path.parent / name.removeprefix("file://")
    yield path.parent / name.rsplit("/", 1)[-1]


def _content(file: Path) -> bytes:
    content, ending = read_bytes(file, MESH_BYTES), file.suffix.lower()
    if ending == ".dae":
        return stl_of_collada(file, content)
    if ending == ".stl":
        return _binary_stl(file, content)
    if ending == ".obj":
        return content
    raise LabError(f"{file}: is neither STL, OBJ nor DAE; convert the mesh")


def _binary_stl(file: Path, content: bytes) -> bytes:
    count = int.from_bytes(content[80:84], "little")
    if len(content) >= 84 + 50 * count and not content.lstrip().startswith(b"solid "):
        return content
    if len(content) == 84 + 50 * count:  # a binary one may begin with the word, too
        return content
    try:
        corners = [line.split()[1:4] for line in content.decode("ascii").splitlines() if line.split()[:1] == ["vertex"]]
        return _stl_of_triangles(np.array(corners, dtype=np.float64).reshape(-1, 3, 3))
    except ValueError as error:
        raise LabError(f"{file}: not a readable STL ({error}); export the mesh again") from error


# Triangles of a COLLADA file (DAE), placed by the nodes of its scene, in metres. Its up axis is ignored, as
# by the readers of robot descriptions (COLLADA 1.4.1, Khronos Group 2008).

_HEADER = 80  # bytes of a binary STL before the number of its triangles


def _stl_of_triangles(triangles: Array) -> bytes:
    """Return a binary STL of triangles ``(n, 3, 3)``."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    record = np.zeros(len(triangles), dtype=[("numbers", "<f4", (4, 3)), ("rest", "<u2")])
    record["numbers"][:, 0] = normals / np.where(lengths > 0, lengths, 1.0)
    record["numbers"][:, 1:] = triangles
    return bytes(_HEADER) + struct.pack("<I", len(triangles)) + record.tobytes()


def stl_of_collada(path: Path, content: bytes) -> bytes:
    """Return the triangles of a COLLADA file as a binary STL."""
    try:
        root = ET.fromstring(content)
    except ET.ParseError as error:
        raise LabError(f"{path}: not a COLLADA file: {error}; export the mesh again") from error
    for element in root.iter():
        element.tag = element.tag.rsplit("}", 1)[-1]  # without the name space
    unit = root.find("asset/unit")
    scale = 1.0 if unit is None else float(unit.get("meter", "1"))
    try:
        triangles = list(_scene_triangles(root))
    except (ValueError, KeyError, IndexError, AttributeError) as error:
        raise LabError(f"{path}: its geometry cannot be read ({error!r}); export the mesh as STL") from error
    if not triangles:
        raise LabError(f"{path}: has no triangle; export the mesh as STL")
    return _stl_of_triangles(scale * np.concatenate(triangles))


def _scene_triangles(root: ET.Element) -> Iterator[Array]:
    """Yield the triangles of every geometry in the scene, or of all without a scene."""
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
    T = T_parent @ _node_pose(node)
    for instance in node.findall("instance_geometry"):
        for triangles in _triangles(geometries[instance.get("url", "").removeprefix("#")]):
            yield triangles @ T[:3, :3].T + T[:3, 3]
    for child in node.findall("node"):
        yield from _of_node(child, T, geometries, nodes)
    for reference in node.findall("instance_node"):
        yield from _of_node(nodes[reference.get("url", "").removeprefix("#")], T, geometries, nodes)


def _node_pose(node: ET.Element) -> Array:
    T = np.eye(4)
    for element in node:
        numbers = np.array((element.text or "").split(), dtype=np.float64) if element.tag in _STEPS else None
        if numbers is not None:
            T = T @ _STEPS[element.tag](numbers)
    return T


_STEPS: Mapping[str, Callable[[Array], Array]] = {
    "matrix": lambda numbers: numbers.reshape(4, 4),
    "translate": lambda numbers: se3.pose(np.eye(3), numbers),
    "rotate": lambda numbers: se3.pose(se3.exp(np.deg2rad(numbers[3]) * numbers[:3]), np.zeros(3)),
    "scale": lambda numbers: np.diag([*numbers, 1.0]),
}


def _triangles(geometry: ET.Element) -> Iterator[Array]:
    """Yield triangles ``(n, 3, 3)`` of each group of a geometry; a polygon is a fan about its first corner."""
    corners_of = _corner_places(geometry)
    for group in (each for tag in ("triangles", "polylist", "polygons") for each in geometry.iter(tag)):
        inputs = group.findall("input")
        stride = 1 + max(int(each.get("offset", "0")) for each in inputs)
        vertex = next(each for each in inputs if each.get("semantic") == "VERTEX")
        points, offset = corners_of[vertex.get("source", "")], int(vertex.get("offset", "0"))
        indices = [np.array((each.text or "").split(), dtype=np.int_) for each in group.findall("p")]
        corners = [_fans(group, each.reshape(-1, stride)[:, offset]) for each in indices]
        yield points[np.concatenate(corners)]


def _corner_places(geometry: ET.Element) -> dict[str, Array]:
    """Return the places ``(n, 3)`` of the corners of a geometry, by the reference of their vertices."""
    sources = {f"#{each.get('id')}": each for each in geometry.iter("source")}
    places = {}
    for each in geometry.iter("vertices"):
        position = next(i.get("source") for i in each.findall("input") if i.get("semantic") == "POSITION")
        places[f"#{each.get('id')}"] = _points(sources[position or ""])
    return places


def _points(source: ET.Element) -> Array:
    array, accessor = source.find("float_array"), source.find("technique_common/accessor")
    assert array is not None
    stride = 3 if accessor is None else int(accessor.get("stride", "3"))
    return np.array((array.text or "").split(), dtype=np.float64).reshape(-1, stride)[:, :3]


def _fans(group: ET.Element, corners: NDArray[np.int_]) -> NDArray[np.int_]:
    """Return the corners ``(n, 3)`` of triangles."""
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
