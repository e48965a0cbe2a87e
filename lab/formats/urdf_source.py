"""A URDF as it comes from elsewhere, made ready for MuJoCo: meshes found and read, the base a link of its own.

Meshes are looked for as ROS names them: ``package://NAME/...`` in a folder NAME, or in one that holds the package, up
the tree from the file; ``file://`` and plain paths beside the file. STL, OBJ and DAE are read.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lab.core.errors import LabError
from lab.core.limits import MESH_BYTES, TEXT_BYTES
from lab.formats.collada import stl_of_collada, stl_of_triangles
from lab.formats.text_file import read_bytes, read_text

__all__ = ["UrdfSource", "is_urdf", "mesh_files", "read_urdf"]

_WORLD = "world"
_XACRO = "www.ros.org/wiki/xacro"


@dataclass(frozen=True)
class UrdfSource:
    """What MuJoCo is given.

    Attributes:
        text: the URDF, with meshes named as in ``assets``.
        assets: the content of each mesh, as STL or OBJ.
        missing: a mesh that is not there or cannot be read, and where it was looked for; "" where all are read.
        held: joints of a gripper, held at zero.
    """

    text: str
    assets: dict[str, bytes]
    missing: str
    held: tuple[str, ...]


def is_urdf(path: Path) -> bool:
    """Whether a file is a URDF: by its ending, or by what it begins with."""
    return path.suffix == ".urdf" or b"<robot" in read_bytes(path, TEXT_BYTES)[:4096]


def read_urdf(path: Path) -> UrdfSource:
    """Read a URDF and its meshes.

    Links whose shape is given for looks alone keep it where no link has one for collisions. Where an arm forks into
    branches that all have fewer joints than it has, these are taken for a gripper, and held at zero.

    Raises:
        LabError: it is no URDF, a xacro that is not expanded, or a joint of it names no link that it joins.
    """
    text = read_text(path, TEXT_BYTES)
    if "<!ENTITY" in text or "<!DOCTYPE" in text:
        raise LabError(f"{path}: it declares entities or a document type, which no URDF needs; take them out")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise LabError(f"{path}: not a readable MJCF or URDF, mend it there: {error}") from error
    if any(_XACRO in element.tag for element in root.iter()):
        raise LabError(f"{path}: is a xacro that is not expanded; run 'xacro {path.name} > robot.urdf', and give that")
    _refuse_loose_joints(path, root)
    _keep_solid_shapes(root)
    held = _hold_gripper(root)
    _add_world(root)
    assets, missing = dict[str, bytes](), ""
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        try:
            file = _found(path, name)
            asset = f"mesh{len(assets)}{'.obj' if file.suffix.lower() == '.obj' else '.stl'}"
            assets[asset] = _content(file)
            mesh.set("filename", asset)
        except LabError as error:
            missing = missing or str(error)
    compiler = (
        ET.SubElement(ET.SubElement(root, "mujoco"), "compiler")
        if root.find("mujoco/compiler") is None
        else (next(root.iter("compiler")))
    )
    compiler.set("strippath", "false")
    return UrdfSource(ET.tostring(root, encoding="unicode"), assets, missing, held)


def mesh_files(path: Path) -> Iterator[Path]:
    """The meshes of a URDF, as far as they are there.

    Raises:
        LabError: it is no XML.
    """
    try:
        root = ET.fromstring(read_text(path, TEXT_BYTES))
    except ET.ParseError as error:
        raise LabError(f"{path}: not a readable URDF, mend it there: {error}") from error
    for mesh in root.iter("mesh"):
        with suppress(LabError):
            yield _found(path, mesh.get("filename", ""))


def _refuse_loose_joints(path: Path, root: ET.Element) -> None:
    """Every joint is to name the two links that it joins."""
    for joint in root.findall("joint"):
        for part in ("parent", "child"):
            if (link := joint.find(part)) is None or not link.get("link"):
                name = joint.get("name", "without a name")
                raise LabError(f'{path}: joint {name} names no {part} link; give it a <{part} link="..."/>')


def _keep_solid_shapes(root: ET.Element) -> None:
    """Drop what is for looks alone where there are shapes for collisions, else take it for these."""
    links = root.findall("link")
    has_solid = any(link.find("collision") is not None for link in links)
    for link in links:
        for visual in link.findall("visual"):
            if has_solid:
                link.remove(visual)
            else:
                visual.tag = "collision"


def _hold_gripper(root: ET.Element) -> tuple[str, ...]:
    """Fix the joints beyond the place where an arm forks into shorter branches; their names."""
    joints = {joint.find("child").get("link"): joint for joint in root.findall("joint")}  # type: ignore[union-attr]
    carriers = {joint.find("parent").get("link") for joint in joints.values()}  # type: ignore[union-attr]
    chains = []
    for tip in [name for name in joints if name not in carriers]:
        chain, link = list[ET.Element](), tip
        while (joint := joints.get(link)) is not None and len(chain) <= len(joints):
            chain.insert(0, joint)
            link = joint.find("parent").get("link")  # type: ignore[union-attr]
        chains.append([joint for joint in chain if joint.get("type") not in ("fixed", None)])
    shared = [each[0] for each in zip(*chains, strict=False) if all(other is each[0] for other in each)]
    branches = [chain[len(shared) :] for chain in chains]
    moving = [branch for branch in branches if branch]
    if len(moving) < 2 or any(len(branch) >= len(shared) for branch in moving):
        return ()
    held = dict.fromkeys(joint for branch in moving for joint in branch)
    for joint in held:
        joint.set("type", "fixed")
        for mimic in joint.findall("mimic"):
            joint.remove(mimic)
    return tuple(joint.get("name", "") for joint in held)


def _add_world(root: ET.Element) -> None:
    """Fix the base to a world: MuJoCo takes a root link for the world itself, whose contacts it cannot leave out."""
    children = {child.get("link") for child in root.iter("child")}
    roots = [link for link in root.findall("link") if link.get("name") not in children]
    names = {link.get("name") for link in root.findall("link")}
    if len(roots) != 1 or roots[0].find("collision") is None:
        return
    world = _WORLD
    while world in names:
        world += "_"
    base = roots[0].get("name", "")
    ET.SubElement(root, "link", name=world)
    joint = ET.SubElement(root, "joint", name=f"{base}_to_{world}", type="fixed")
    ET.SubElement(joint, "parent", link=world)
    ET.SubElement(joint, "child", link=base)


def _found(path: Path, name: str) -> Path:
    """The file of a mesh."""
    tried = list(_places(path.resolve(), name))
    for file in tried:
        if file.is_file():
            return file
    raise LabError(f"{path}: mesh '{name}' is not there; looked for it as {', '.join(map(str, tried[:3]))}")


def _places(path: Path, name: str) -> Iterator[Path]:
    """Where a mesh may be, the most likely place first."""
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
    """A mesh as binary STL or OBJ."""
    content, ending = read_bytes(file, MESH_BYTES), file.suffix.lower()
    if ending == ".dae":
        return stl_of_collada(file, content)
    if ending == ".stl":
        return _binary_stl(file, content)
    if ending == ".obj":
        return content
    raise LabError(f"{file}: is neither STL, OBJ nor DAE; convert the mesh")


def _binary_stl(file: Path, content: bytes) -> bytes:
    """A binary STL as it is, one in text as binary."""
    count = int.from_bytes(content[80:84], "little")
    if len(content) >= 84 + 50 * count and not content.lstrip().startswith(b"solid "):
        return content
    if len(content) == 84 + 50 * count:  # a binary one may begin with the word, too
        return content
    try:
        corners = [line.split()[1:4] for line in content.decode("ascii").splitlines() if line.split()[:1] == ["vertex"]]
        return stl_of_triangles(np.array(corners, dtype=np.float64).reshape(-1, 3, 3))
    except ValueError as error:
        raise LabError(f"{file}: not a readable STL ({error}); export the mesh again") from error
