"""Read and write MJCF and URDF models.

Sizes, finite numbers and files are checked before MuJoCo reads a model: MuJoCo takes any size of a texture, of a height
field and of replicated parts, and writes a log into the working folder if a number is not finite.
"""

import itertools
import stat
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path

import mujoco
import numpy as np

from lab.core import se3
from lab.core.errors import LabError, option_name
from lab.core.limits import COPIES, JOINTS, MESH_BYTES, NESTED_ELEMENTS, PIXELS, TEXT_BYTES
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.formats.description import DescriptionFormat, IdentifiedRobot
from lab.formats.link_tree import free_name, last_axis_frame
from lab.formats.structured import read_bytes, read_text
from lab.formats.urdf import (
    UrdfSource,
    identified_urdf,
    is_from_xacro,
    is_urdf,
    mesh_files,
    read_urdf,
    with_origins,
    xacro_properties,
)
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.dynamics.rigid_body import khalil_chain, load_in_frame, load_of
from lab.kinematics.joints import JointSpec
from lab.kinematics.serial.axes_to_dh import chain_from_axes
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import DEFAULT_TOOL, SerialArm
from lab.kinematics.tree import TreeArm, tip_of, tree_chain
from lab.simulation.build_serial import add_rods
from lab.simulation.collisions import touching_bodies
from lab.simulation.robot_model import (
    FLANGE,
    TRACKER,
    OpenModel,
    SerialModel,
    TreeModel,
    add_targets,
    add_tracker,
    allow_massless,
    at_pose,
    at_zero,
    body_pose,
    compiled,
    coordinates,
    flange_body,
    joint_axes,
    joint_of,
    last_frame,
    site_pose,
)

__all__ = [
    "MJCF",
    "TREE_MJCF",
    "URDF",
    "XACRO",
    "bodies_of_links",
    "calibrated_mjcf",
    "link_inertias",
    "load_model",
    "loads_of",
    "model_files",
    "refuse_unbounded_model",
    "set_vectors",
    "write_in_full",
]

_AREAS = {"texture": ("width", "height"), "hfield": ("nrow", "ncol"), "replicate": ("count",), "composite": ("count",)}
_AREAS |= {"flexcomp": ("count",)}
_NOT_FINITE = frozenset(("nan", "inf", "infinity"))
_TEXTS = frozenset(("name", "file", "filename", "class", "childclass", "model", "link", "joint", "body", "site"))


def refuse_unbounded_model(path: Path) -> None:
    """Refuse a model beyond the limits; MuJoCo reports other errors.

    Raises:
        LabError: it is too large, nests too deeply, names no regular file, or has a number that is not finite.
    """
    joints, sizes = 0, dict[Path, int]()
    folders = {path.parent}
    for element, depth in _elements(path):
        NESTED_ELEMENTS(path, depth)
        _refuse_numbers(path, element)
        if element.tag in _AREAS:
            most = PIXELS if len(_AREAS[element.tag]) == 2 else COPIES
            most(f"{path}: {element.tag}", _product(element, _AREAS[element.tag]))
        folders |= _folders(path, element)
        joints += element.tag == "joint" and element.get("type") != "fixed"
        sizes |= _sizes(path, folders, element.get("file") or element.get("filename"))
    JOINTS(path, joints)
    MESH_BYTES(path, sum(sizes.values()))


def model_files(path: Path) -> set[Path]:
    """Return the existing files that a model names: meshes, pictures, included models.

    Raises:
        LabError: it cannot be read.
    """
    if is_urdf(path):
        return set(mesh_files(path))
    elements = [element for element, _ in _elements(path)]
    folders = {path.parent}.union(*(_folders(path, each) for each in elements))
    named = [each.get("file") for each in elements]
    return {folder / name for folder in folders for name in named if name is not None and (folder / name).is_file()}


def _folders(path: Path, element: ET.Element) -> set[Path]:
    return {path.parent / element.get(each, "") for each in ("meshdir", "texturedir", "assetdir")}


def _elements(path: Path) -> Iterator[tuple[ET.Element, int]]:
    """Yield every element with its depth, including those of included files."""
    waiting, read = [path], set[Path]()
    while waiting:
        file = waiting.pop()
        if file in read or not file.exists():
            continue
        read.add(file)
        root = _root(file)
        left = [(root, 1)]
        while left:
            element, depth = left.pop()
            yield element, depth
            left.extend((child, depth + 1) for child in element)
            if element.tag == "include" and (name := element.get("file")):
                waiting.append(path.parent / name)


def _root(file: Path) -> ET.Element:
    """Return the outermost element; refuse a file that this parser cannot read, as MuJoCo's might, unchecked."""
    content = read_bytes(file, TEXT_BYTES)
    try:
        root = ET.fromstring(content)
    except (ET.ParseError, LookupError, ValueError) as error:  # the last two: an unknown encoding
        text = error if content.strip() else "an empty file"
        raise LabError(f"{file}: not a readable MJCF or URDF, mend it there: {text}") from error
    try:
        content.decode("utf-8")
    except UnicodeDecodeError as error:  # MuJoCo takes names as bytes
        if any(not value.isascii() for element in root.iter() for value in element.attrib.values()):
            raise LabError(f"{file}: has names that are not in UTF-8; save it as UTF-8") from error
    return root


def _refuse_numbers(path: Path, element: ET.Element) -> None:
    for name, text in element.items():
        if name not in _TEXTS and any(word.lower().lstrip("+-") in _NOT_FINITE for word in text.split()):
            raise LabError(f"{path}: {element.tag}: {name} is '{text}'; give finite numbers")


def _product(element: ET.Element, names: Sequence[str]) -> int:
    """Return the product of all numbers in some attributes; MuJoCo reports texts that are no numbers."""
    factors = [word for name in names for word in element.get(name, "1").split()]
    try:
        return prod(max(1, int(float(word))) for word in factors)
    except (ValueError, OverflowError):
        return 1


def _sizes(path: Path, folders: set[Path], name: str | None) -> dict[Path, int]:
    sizes = {}
    for file in () if name is None else {folder / name for folder in folders}:
        try:
            found = file.stat()
        except (OSError, ValueError):
            continue
        if not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):
            raise LabError(f"{path}: {name} is no regular file; give a file")
        sizes[file] = found.st_size
    return sizes


# an MJCF's <custom><numeric>, in joint order; mm for a slide
_SPEED_KEY, _ACCELERATION_KEY = "joint_speed_deg_per_s", "joint_acceleration_deg_per_s2"


def _joint_limits(path: Path, model: mujoco.MjModel, names: Sequence[str]) -> tuple[Array, Array, Array, Array]:
    """Return lower and upper limits, speeds and accelerations ``(n,)``, rad or m (per s, s^2); NaN if not given.

    Raises:
        LabError: a range is crossed, a slide has none, or the speeds are not one for each joint and above zero.
    """
    lower, upper, scale = np.empty(len(names)), np.empty(len(names)), np.empty(len(names))
    for i, name in enumerate(names):
        joint = model.joint(name)
        slides = joint.type[0] == mujoco.mjtJoint.mjJNT_SLIDE
        scale[i] = 1e-3 if slides else np.pi / 180
        if joint.range[0] > joint.range[1]:
            raise LabError(f"{path}: joint {name}: the range's lower limit is above the upper one; swap them")
        if joint.limited[0]:
            lower[i], upper[i] = joint.range
        elif slides:
            raise LabError(f"{path}: slide {name} has no range; give it one")
        else:
            lower[i], upper[i] = -np.pi, np.pi
    speed, acceleration = (_per_joint(path, model, key, names, scale) for key in (_SPEED_KEY, _ACCELERATION_KEY))
    return (
        lower,
        upper,
        _urdf_limits(path, names, "velocity") if speed is None else speed,
        _urdf_limits(path, names, "acceleration") if acceleration is None else acceleration,
    )


def _per_joint(path: Path, model: mujoco.MjModel, key: str, names: Sequence[str], scale: Array) -> Array | None:
    """Return a custom number of the model for each joint ``(n,)``, in rad or m; None without any."""
    found = [i for i in range(model.nnumeric) if model.numeric(i).name == key]
    if not found:
        return None
    numbers = np.array(model.numeric(found[0]).data, dtype=np.float64)
    if numbers.shape != scale.shape:
        raise LabError(f"{path}: {key} has {numbers.size} values for {len(names)} joints; give one each")
    if (still := np.flatnonzero(~(numbers > 0))).size:
        raise LabError(f"{path}: {key} of joint {names[still[0]]} is {numbers[still[0]]:g}; give more than zero")
    return np.asarray(numbers * scale)


def _urdf_limits(path: Path, names: Sequence[str], key: str) -> Array:
    """Return the ``velocity`` or ``acceleration`` ``(n,)`` of a URDF's ``<limit>``, which MuJoCo drops; NaN if none."""
    text = path.read_bytes()
    if b"<robot" not in text or b"<!" in text.replace(b"<!--", b""):  # no entities: they can be made to explode
        return np.full(len(names), np.nan)
    limits = {joint.get("name"): joint.find("limit") for joint in ET.fromstring(text).iter("joint")}
    found = np.full(len(names), np.nan)
    for i, name in enumerate(names):
        limit = limits.get(name)
        given = None if limit is None else limit.get(key)
        try:
            found[i] = float(given) if given else np.nan
        except ValueError as error:
            raise LabError(f"{path}: joint {name}: {key} is {given!r}; give a number") from error
    return np.where((found > 0) & np.isfinite(found), found, np.nan)


_LISTED = 12  # bodies in a message
_CHAIN_JOINTS = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
_POSES = 200  # at which overlaps by construction are searched


def load_model(path: Path, tips: Sequence[str] = (), base: str = "") -> SerialModel | TreeModel:
    """Load an MJCF or a URDF of hinges and slides: one serial chain, or the chains to several tips.

    Sites on the last body or beyond it are its targets, except one named ``flange``, which
    places the last frame (of a URDF a link ``tool0`` or ``flange``). Missing targets of the default tool are added,
    a tracker if there is no site ``tracker``, and rods for links if there are no shapes.
    Meshes that cannot be read are left out, with a message.

    Args:
        tips: bodies or sites that are the last frames; a tip ``left`` is also the site ``left.flange``. Joints that
            move none of them are held at zero. By default the end of the only chain, or every site named so.
        base: the body below the first joint; joints that move it are held at zero. By default the world.

    Raises:
        LabError: the file is malformed, has no such tip or base, or no chain, several without tips, or loops.
    """
    if not path.is_file():
        raise LabError(f"{path}: no such file; give a robot's MJCF, URDF or TOML table")
    refuse_unbounded_model(path)
    urdf = read_urdf(path, gripper=not tips) if is_urdf(path) else None
    spec, model, missing = _built(path, urdf)
    named = tips or _flange_sites(spec)
    held = () if urdf is None else urdf.fixed_joints
    if tips or base:
        held, model = _hold(path, spec, model, named, base)
    _refuse_unserial(path, model)
    ends = [_named_end(path, model, name) for name in named] if named else [_only_end(path, model)]
    branches = [_branch(path, model, end) for end in ends]
    if len(branches) == 1:
        return _serial_model(path, spec, branches[0], missing, held)
    return _tree_model(path, spec, named, branches, missing, held)


def _flange_sites(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Return the tips that sites ``<tip>.flange`` name."""
    suffix = f".{FLANGE}"
    return tuple(site.name.removesuffix(suffix) for site in spec.sites if site.name.endswith(suffix))


def _robot_name(path: Path) -> str:
    return path.resolve().parent.name if path.stem in ("robot", "scene") else path.stem


@dataclass(frozen=True)
class _End:
    """The end of a chain.

    Attributes:
        bodies: the jointed bodies that move it, base outward.
        carrier: the body that carries its last frame.
        T_world_flange: pose ``(4, 4)`` (m), joint positions zero.
        name: by which it was named; "" for the only one.
    """

    bodies: tuple[str, ...]
    carrier: str
    T_world_flange: Array
    name: str


@dataclass(frozen=True, eq=False)
class _ModelBranch:
    """A chain to an end of a model; its frame 0 is at ``T_world_frame0`` ``(4, 4)`` (m)."""

    end: _End
    chain: Chain
    T_world_frame0: Array

    @property
    def T_world_last(self) -> Array:
        """Pose ``(4, 4)`` (m) of the last frame, joint positions zero."""
        return last_frame(self.chain, self.T_world_frame0)


def _branch(path: Path, model: mujoco.MjModel, end: _End) -> _ModelBranch:
    """Return the chain to an end of a model, by the axes of its joints."""
    data, joints = at_zero(model), [joint_of(model, body) for body in end.bodies]
    names = [str(joint.name) for joint in joints]
    chain, T_world_frame0 = chain_from_axes(
        _robot_name(path),
        tuple(names),
        tuple(bool(joint.type[0] == mujoco.mjtJoint.mjJNT_SLIDE) for joint in joints),
        joint_axes(model, data, names, ()),
        _base_pose(model, data, end.bodies),
        end.T_world_flange,
        _joint_limits(path, model, names),
    )
    return _ModelBranch(end, chain, T_world_frame0)


def _only_end(path: Path, model: mujoco.MjModel) -> _End:
    bodies = _serial_bodies(path, model)
    return _End(bodies, flange_body(model, bodies), _flange_pose(model, at_zero(model), bodies), "")


def _named_end(path: Path, model: mujoco.MjModel, name: str) -> _End:
    """Return the end at a site ``<name>.flange``, a body or a site of this name.

    Raises:
        LabError: there is none, or no joint moves it.
    """
    sites = [model.site(i).name for i in range(model.nsite)]
    bodies = {model.body(i).name: i for i in range(1, model.nbody)}
    data, flange = at_zero(model), f"{name}.{FLANGE}"
    if flange in sites or (name in sites and name not in bodies):
        site = flange if flange in sites else name
        body, T = int(model.site(site).bodyid[0]), site_pose(model, data, site)
    elif name in bodies:
        body, T = bodies[name], body_pose(data, bodies[name])
    else:
        last = ", ".join(list(bodies)[-_LISTED:])
        raise LabError(f"{path}: tip '{name}' is no body, link or site of it; the last of its bodies are {last}")
    jointed = _jointed(model)
    moving = tuple(model.body(b).name for b in reversed(_ancestors(model, body)) if b in jointed)
    if not moving:
        raise LabError(f"{path}: no joint moves tip '{name}'; name a body beyond a joint")
    return _End(moving, str(model.body(body).name), T, name)


def _hold(
    path: Path, spec: mujoco.MjSpec, model: mujoco.MjModel, tips: Sequence[str], base: str
) -> tuple[tuple[str, ...], mujoco.MjModel]:
    """Hold the joints at zero that move the base, or no tip; return their names, and the model without them."""
    held = _held_joints(path, spec, model, tips, base)
    gone = {joint.name for joint in held}
    for equality in [each for each in spec.equalities if {each.name1, each.name2} & gone]:
        spec.delete(equality)
    for joint in held:
        spec.delete(joint)
    return tuple(sorted(gone)), compiled(path, spec) if gone else model


def _held_joints(
    path: Path, spec: mujoco.MjSpec, model: mujoco.MjModel, tips: Sequence[str], base: str
) -> list[mujoco.MjsJoint]:
    """Return the joints that move the base, or no tip."""
    names = {model.body(i).name: i for i in range(1, model.nbody)}
    if base and base not in names:
        raise LabError(f"{path}: base '{base}' is no body or link of it; it has {', '.join(list(names)[:_LISTED])}")
    ends = [_named_end(path, model, tip) for tip in tips]
    # Joints stay that move a tip, and not the base.
    kept = set[str]().union(*(end.bodies for end in ends)) if tips else set(names)
    if base:
        _refuse_beside(path, model, base, ends)
        kept -= {str(model.body(b).name) for b in _ancestors(model, names[base])}
    joints = spec.joints if model.njnt else []
    return [joint for joint in joints if model.body(model.joint(joint.name).bodyid[0]).name not in kept]


def _refuse_beside(path: Path, model: mujoco.MjModel, base: str, ends: Sequence[_End]) -> None:
    """Refuse tips that the base does not carry, with a LabError."""
    for end in ends:
        if model.body(base).id not in _ancestors(model, model.body(end.carrier).id):
            raise LabError(f"{path}: base '{base}' does not carry tip '{end.name}'; name a body below it")


def _base_pose(model: mujoco.MjModel, data: mujoco.MjData, bodies: Sequence[str]) -> Array:
    parent = int(model.body(bodies[0]).parentid[0])
    return body_pose(data, parent) if parent else np.eye(4)


def _serial_model(
    path: Path, spec: mujoco.MjSpec, branch: _ModelBranch, missing: str, held: tuple[str, ...]
) -> SerialModel:
    """Build the model of a serial arm."""
    end, model = branch.end, compiled(path, spec)
    _rename_targets(spec, model, end)
    model = compiled(path, spec)
    tool = _own_targets(model, at_zero(model), end.bodies, branch.T_world_last)
    sites = {model.site(site).name for site in range(model.nsite)}
    spare = {name: np.array(place) for name, place in DEFAULT_TOOL.items() if name not in sites}
    _add_spare_targets(spec, model, branch, spare)
    made = _completed(path, spec, model, branch.chain, {branch: tool | spare}, missing)
    return SerialModel(
        path=path, spec=spec, model=made.model, chain=branch.chain, T_world_frame0=branch.T_world_frame0,
        bodies=end.bodies, base_body=made.base_body, tool=tool | spare, shapes_assumed=made.shapeless,
        masses_assumed=made.weighted, missing=missing, overlapping=made.overlapping, fixed_joints=held,
        named_carrier=end.carrier if end.name else "",
    )  # fmt: skip


def _rename_targets(spec: mujoco.MjSpec, model: mujoco.MjModel, end: _End) -> None:
    """Leave out the tip in the names of a named tip's targets, as it is the only one."""
    beyond, taken = _beyond(model, end.bodies[-1]), {site.name for site in spec.sites}
    for i in range(model.nsite):
        name = str(model.site(i).name)
        point = name.removeprefix(f"{end.name}.")
        if int(model.site_bodyid[i]) in beyond and point not in (name, FLANGE, *taken):
            spec.site(name).name = point


def _tree_model(
    path: Path,
    spec: mujoco.MjSpec,
    tips: Sequence[str],
    branches: Sequence[_ModelBranch],
    missing: str,
    held: tuple[str, ...],
) -> TreeModel:
    """Build the model of a robot with several tips, whose targets are ``<tip>.<point>``."""
    model = compiled(path, spec)
    chains, frames = [each.chain for each in branches], [each.T_world_frame0 for each in branches]
    tree = tree_chain(_robot_name(path), tips, chains, frames)
    tool = _tree_targets(spec, model, tips, branches)
    tools = {
        branch: {name: place for name, place in tool.items() if tip_of(name) == tip}
        for tip, branch in zip(tips, branches, strict=True)
    }
    made = _completed(path, spec, model, tree, tools, missing)
    return TreeModel(
        path=path, spec=spec, model=made.model, chain=tree, T_world_frame0=frames[0],
        bodies=tuple(dict.fromkeys(body for each in branches for body in each.end.bodies)), base_body=made.base_body,
        tool=tool, shapes_assumed=made.shapeless, masses_assumed=made.weighted, missing=missing,
        overlapping=made.overlapping, fixed_joints=held, tip_carriers=tuple(each.end.carrier for each in branches),
    )  # fmt: skip


def _tree_targets(
    spec: mujoco.MjSpec, model: mujoco.MjModel, tips: Sequence[str], branches: Sequence[_ModelBranch]
) -> dict[str, Array]:
    """Name the targets of all tips; add the default tool's where a tip has none. Return their places (m)."""
    tool, last_bodies = dict[str, Array](), [each.end.bodies[-1] for each in branches]
    for tip, branch in zip(tips, branches, strict=True):
        others = () if last_bodies.count(branch.end.bodies[-1]) > 1 else tips
        tool |= _tip_targets(spec, model, tip, branch, others, tool)
        if not any(name.startswith(f"{tip}.") for name in tool):
            spare = {f"{tip}.{name}": np.array(place) for name, place in DEFAULT_TOOL.items()}
            _add_spare_targets(spec, model, branch, spare)
            tool |= spare
    return tool


def _tip_targets(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    tip: str,
    branch: _ModelBranch,
    tips: Sequence[str],
    taken: Mapping[str, Array],
) -> dict[str, Array]:
    """Name the sites that a tip's last joint moves after the tip; return their places ``(3,)`` m in its last frame.

    Args:
        tips: of the robot; none where several share that joint, so that only sites of this tip's name are its own.
        taken: targets of the tips before.
    """
    data, T_last_world = at_zero(model), se3.inverse(branch.T_world_last)
    moved, targets = _moving_with(model, branch.end.bodies[-1]), dict[str, Array]()
    for site in range(model.nsite):
        name = str(model.site(site).name)
        target = _target_name(name, tip, tips)
        if target and target not in {*taken, *targets} and int(model.site_bodyid[site]) in moved:
            spec.site(name).name = target
            targets[target] = se3.transform(T_last_world, data.site_xpos[site : site + 1])[0]
    return targets


def _target_name(site: str, tip: str, tips: Sequence[str]) -> str:
    """Return the name of a site as a target of a tip, ``<tip>.<point>``; "" if it is none."""
    point = site.rpartition(".")[2]
    if point in (FLANGE, TRACKER):
        return ""
    if site.startswith(f"{tip}."):
        return site
    return f"{tip}.{point}" if tips and site not in tips else ""


def _add_spare_targets(
    spec: mujoco.MjSpec, model: mujoco.MjModel, branch: _ModelBranch, targets: Mapping[str, Array]
) -> None:
    carrier = model.body(branch.end.carrier)
    T_body_last = se3.inverse(body_pose(at_zero(model), carrier.id)) @ branch.T_world_last
    add_targets(spec.body(carrier.name), T_body_last, targets)


@dataclass(frozen=True)
class _Completed:
    """A model with what its file lacks, and what that is, as in ``RobotModel``."""

    model: mujoco.MjModel
    base_body: str
    shapeless: bool
    weighted: bool
    overlapping: tuple[tuple[str, str], ...]


def _completed(
    path: Path,
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    chain: JointSpec,
    tools: Mapping[_ModelBranch, Mapping[str, Array]],
    missing: str,
) -> _Completed:
    """Add a tracker, rods where there are no shapes, and exclusions of contacts by construction.

    Args:
        model: the spec compiled before this.
        tools: places (m) of each branch's targets.
        missing: why shapes were left out; rods do not stand for those.
    """
    if TRACKER not in {site.name for site in spec.sites}:
        add_tracker(spec)
    # Rods for links.
    shapeless, weighted = not missing and not _have_shapes(model, [branch.end for branch in tools]), False
    for branch, tool in tools.items() if shapeless else ():
        weighted |= add_rods(path, spec, branch.chain, branch.T_world_frame0, branch.end.bodies, tool)
    # The first links and what carries them.
    model = compiled(path, spec)
    pairs = {(_carrier_of(model, branch.end.bodies[0]), branch.end.bodies[0]) for branch in tools}
    overlapping = _exclude_overlaps(spec, model, chain, pairs)
    carriers = {carrier for carrier, _ in pairs}
    base = carriers.pop() if len(carriers) == 1 else ""
    return _Completed(compiled(path, spec) if overlapping else model, base, shapeless, weighted, overlapping)


def _have_shapes(model: mujoco.MjModel, ends: Sequence[_End]) -> bool:
    """Decide whether a body of these chains has a solid shape."""
    solid = model.geom_bodyid[(model.geom_contype | model.geom_conaffinity) != 0]
    return any(bool(np.isin(solid, _beyond(model, end.bodies[0])).any()) for end in ends)


def _carrier_of(model: mujoco.MjModel, body: str) -> str:
    """Return the name of the body that carries another; "" for the world."""
    parent = int(model.body(body).parentid[0])
    return str(model.body(parent).name) if parent else ""


def _moving_with(model: mujoco.MjModel, body: str) -> set[int]:
    """Return the bodies that the joint of a body moves, and no joint beyond it."""
    at = model.body(body).id
    return {b for b in _beyond(model, body) if next(a for a in _ancestors(model, b) if model.body_jntnum[a]) == at}


def _exclude_overlaps(
    spec: mujoco.MjSpec, model: mujoco.MjModel, chain: JointSpec, bases: set[tuple[str, str]]
) -> tuple[tuple[str, str], ...]:
    """Exclude the contact of bodies that touch in all of many random poses; return their names.

    The contact of the base and the first link is excluded if they touch in some: MuJoCo checks no other neighbours.
    Contacts of the tracker's own body are kept: a tracker in the arm's way is an error of the scene.
    """
    stand = str(model.body(model.site(TRACKER).bodyid[0]).name)
    joints = chain.random_joints(_POSES, rng_for(0, "structure"))
    touching = [
        {(str(model.body(a).name), str(model.body(b).name)) for a, b in pairs if a}  # a = 0: the world
        for pairs in touching_bodies(model, coordinates(model, chain.joint_names, joints))
    ]
    always, sometimes = set.intersection(*touching), set.union(*touching)
    stands = {body for base in bases for body in base}
    names = sorted(pair for pair in always | (bases & sometimes) if stand in stands or stand not in pair)
    for first, second in names:
        spec.add_exclude(bodyname1=first, bodyname2=second)
    return tuple(names)


def _built(path: Path, urdf: UrdfSource | None) -> tuple[mujoco.MjSpec, mujoco.MjModel, str]:
    """Return the file as a spec and a model; without its meshes if they cannot be read, and the reason."""
    spec = _read(path, urdf)
    try:
        if urdf is not None and urdf.missing:
            raise LabError(urdf.missing)
        return spec, compiled(path, spec), ""
    except LabError as error:
        bare = _read(path, urdf)
        if not bare.meshes:
            raise
        _delete_meshes(bare)
        try:
            model = compiled(path, bare)
        except LabError:
            raise error from None
        return bare, model, f"{error}; meshes are left out"


def _delete_meshes(spec: mujoco.MjSpec) -> None:
    for geom in [geom for geom in spec.geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH]:
        spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    allow_massless(spec)


def _read(path: Path, urdf: UrdfSource | None) -> mujoco.MjSpec:
    """Read a file; name bodies without joints, and drop sites without names."""
    try:
        spec = (
            mujoco.MjSpec.from_file(str(path))
            if urdf is None
            else mujoco.MjSpec.from_string(urdf.text, assets=urdf.assets)
        )
    except ValueError as error:
        raise LabError(f"{path}: not a readable MJCF or URDF, mend it there: {' '.join(str(error).split())}") from error
    spec.compiler.fusestatic = False  # a fixed link places the flange
    if not spec.geoms:
        allow_massless(spec)  # until it gets rods
    for site in [site for site in spec.sites if not site.name]:
        spec.delete(site)
    _name_bodies(spec)
    return spec


def _name_bodies(spec: mujoco.MjSpec) -> None:
    """Name bodies without joints that have no name."""
    names = {body.name for body in spec.bodies}
    for i, body in enumerate(spec.bodies):
        if not body.name and not body.joints:
            body.name = next(name for n in itertools.count(i) if (name := f"body{n}") not in names)
            names.add(body.name)


def _refuse_unserial(path: Path, model: mujoco.MjModel) -> None:
    """Refuse a model without joints, or with joints that no chain has."""
    jointed = _jointed(model)
    if not jointed:
        raise LabError(f"{path}: no joints, so no chain; give a model with hinge or slide joints")
    for body in jointed:
        _refuse_joints(path, model, body)
    if model.neq:
        raise LabError(
            f"{path}: it has {model.neq} equality constraints (loops or mimic joints); remove "
            "them, or describe its loops in a mechanism's TOML"
        )


def _refuse_joints(path: Path, model: mujoco.MjModel, body: int) -> None:
    """Refuse a body with joints that no chain has, or without names."""
    first = int(model.body_jntadr[body])
    joints = [model.joint(i) for i in range(first, first + int(model.body_jntnum[body]))]
    names = [joint.name or "(unnamed)" for joint in joints]
    if {int(joint.type[0]) for joint in joints} - _CHAIN_JOINTS:
        raise LabError(f"{path}: joint {names[0]} is a ball or free joint; a chain has hinges and slides only")
    if len(names) > 1:
        raise LabError(f"{path}: body {model.body(body).name} has joints {', '.join(names)}; give each its own body")
    if not (model.body(body).name and joints[0].name.strip("()")):
        raise LabError(f"{path}: a jointed body or its joint has no name (body {body}); name both")


def _jointed(model: mujoco.MjModel) -> list[int]:
    return [b for b in range(1, model.nbody) if model.body_jntnum[b] > 0]


def _serial_bodies(path: Path, model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the jointed bodies of the only chain, base outward."""
    chains = _chains(model)
    if len(chains) > 1:
        listed = "; ".join(", ".join(str(joint_of(model, model.body(b).name).name) for b in chain) for chain in chains)
        ends = [f"{option_name('tip')} {model.body(chain[-1]).name}" for chain in chains]
        raise LabError(
            f"{path}: {len(chains)} candidate chains ({listed}); keep one ({ends[0]}), or name all ({' '.join(ends)})"
        )
    return tuple(model.body(b).name for b in chains[0])


def _chains(model: mujoco.MjModel) -> list[list[int]]:
    """Return the jointed bodies of each chain, base outward: to each one that carries no other."""
    jointed = _jointed(model)
    above = {b: _ancestors(model, b) for b in jointed}
    tips = [tip for tip in jointed if not any(tip in line[1:] for line in above.values())]
    return [[b for b in reversed(above[tip]) if b in jointed] for tip in tips]


def _ancestors(model: mujoco.MjModel, body: int) -> list[int]:
    line = []
    while body != 0:
        line.append(body)
        body = int(model.body_parentid[body])
    return line


def _beyond(model: mujoco.MjModel, body: str) -> list[int]:
    first = model.body(body).id
    return [b for b in range(model.nbody) if first in _ancestors(model, b)]


def _flange_pose(model: mujoco.MjModel, data: mujoco.MjData, bodies: tuple[str, ...]) -> Array:
    """Return the pose of the site ``flange``, else of a body with a usual flange name, else of the last jointed one."""
    beyond = _beyond(model, bodies[-1])
    for site in range(model.nsite):
        if model.site(site).name == FLANGE and int(model.site_bodyid[site]) in beyond:
            return site_pose(model, data, FLANGE)
    named = {model.body(body).name: body for body in beyond}
    at = [named[name] for name in ("tool0", FLANGE) if name in named]  # tool0 has z along the last axis
    return body_pose(data, [*at, model.body(bodies[-1]).id][0])


def _own_targets(
    model: mujoco.MjModel, data: mujoco.MjData, bodies: tuple[str, ...], T_world_last: Array
) -> dict[str, Array]:
    beyond = _beyond(model, bodies[-1])
    T_last_world = se3.inverse(T_world_last)
    return {
        model.site(site).name: se3.transform(T_last_world, data.site_xpos[site : site + 1])[0]
        for site in range(model.nsite)
        if not str(model.site(site).name).endswith(f".{FLANGE}")
        and model.site(site).name not in (FLANGE, TRACKER)
        and int(model.site_bodyid[site]) in beyond
    }


def calibrated_mjcf(robot: OpenModel, arm: SerialArm | TreeArm, values: Array) -> str:
    """Return the identified arm as MJCF, whose sites in the tracker's frame are the identified ones to rounding.

    Shells are left out, so that the file is complete; masses and collision shapes are kept.
    MuJoCo writes six digits, so every number of the kinematics is written here, in full.
    """
    spec = _without_shells(robot)
    # Sites of the measured points, by names that no other site has.
    others = {FLANGE, TRACKER, *(site.name for site in spec.sites if site.name not in robot.tool)}
    taken = [name for name in arm.targets if name in others]  # a measured point may be called so
    placed = replace(arm, targets=tuple(f"{name} as measured" if name in taken else name for name in arm.targets))
    for target in [name for name in placed.targets if name not in robot.tool]:
        spec.body(robot.carrier_of(target)).add_site(name=target)
    _add_flanges(spec, robot)
    # The identified dimensions.
    model = compiled(robot.path, spec)
    robot.place_bodies(model, placed, values)
    robot.place_tracker(model, robot.T_world_frame0 @ se3.inverse(arm.T_tracker_frame0(values)))
    # The file, with all digits and the names of the targets.
    root = ET.fromstring(spec.to_xml())
    write_in_full(root, model)
    names = {name: free_name(name, arm.targets) for name in taken}
    _rename_sites(root, names | dict(zip(placed.targets, arm.targets, strict=True)))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _rename_sites(root: ET.Element, names: Mapping[str, str]) -> None:
    for site in root.iter("site"):
        if (name := site.get("name", "")) in names:
            site.set("name", names[name])


MJCF: DescriptionFormat[SerialArm, SerialModel] = DescriptionFormat(
    "calibrated.xml", lambda identified: calibrated_mjcf(identified.model, identified.arm, identified.values)
)


TREE_MJCF: DescriptionFormat[TreeArm, TreeModel] = DescriptionFormat(
    "calibrated.xml", lambda identified: calibrated_mjcf(identified.model, identified.arm, identified.values)
)


def _add_flanges(spec: mujoco.MjSpec, robot: OpenModel) -> None:
    """Add the sites that name the tips of a robot with several, where they have other names."""
    if not isinstance(robot, TreeModel):
        return
    present = {site.name for site in spec.sites}
    data = at_zero(robot.model)
    for tip, T_world_last, carrier in zip(robot.chain.tips, robot.last_frames, robot.carriers, strict=True):
        if f"{tip}.{FLANGE}" not in present:
            T = se3.inverse(body_pose(data, robot.model.body(carrier).id)) @ T_world_last
            spec.body(carrier).add_site(name=f"{tip}.{FLANGE}", **at_pose(T))


def _without_shells(robot: OpenModel) -> mujoco.MjSpec:
    """Return a copy without meshes; a body whose mass came from one keeps it."""
    spec = robot.spec.copy()
    for geom in [geom for geom in spec.geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH]:
        body, built = geom.parent, robot.model.body(geom.parent.name)
        if built.mass[0] > 0 and not body.explicitinertial:
            body.explicitinertial, body.mass = True, built.mass[0]
            body.ipos, body.iquat, body.inertia = built.ipos, built.iquat, built.inertia
        spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    return spec


def write_in_full(root: ET.Element, model: mujoco.MjModel) -> None:
    """Replace numbers that MuJoCo rounded: poses of bodies, joints and sites."""
    world = root.find("worldbody")
    assert world is not None
    for element in world.iter("body"):
        body = model.body(element.get("name", ""))
        set_vectors(element, pos=body.pos, quat=body.quat)
        for joint_element in element.findall("joint"):
            joint = model.joint(joint_element.get("name", ""))
            set_vectors(joint_element, pos=joint.pos, axis=joint.axis)
    for element in world.iter("site"):
        site = model.site(element.get("name", ""))
        set_vectors(element, pos=site.pos, quat=site.quat)


def set_vectors(element: ET.Element, **vectors: Array) -> None:
    """Set an element's attributes in full, in place of their other forms."""
    for stale in ("euler", "axisangle", "xyaxes", "zaxis", "fromto"):
        element.attrib.pop(stale, None)
    for name, vector in vectors.items():
        element.set(name, " ".join(repr(float(value)) for value in vector))


def _source(model: SerialModel) -> str:
    return read_text(model.path, TEXT_BYTES) if model.path.is_file() and is_urdf(model.path) else ""


def _origins(identified: IdentifiedRobot[SerialArm, SerialModel]) -> dict[str, Array]:
    """Return poses ``(4, 4)`` (m) of the joints' frames in their parents', with the identified axes.

    A joint's frame is its nominal one, turned by the smallest rotation that aligns its axis and shifted across it. The
    last one moves with the frame on the last joint's axis, as in all formats; the last frame's motion beyond that axis
    belongs to the tool, which is not in the file.
    """
    model = identified.model
    arm, moved, last = (
        identified.arm,
        list(model.moved_bodies(identified.arm, identified.values)),
        model.model.body(model.bodies[-1]).id,
    )
    identified_at, nominal_at = (last_axis_frame(arm, values) for values in (identified.values, arm.nominal()))
    T_frame0_world = identified_at @ se3.inverse(model.T_world_frame0 @ nominal_at)
    moved[last] = model.T_world_frame0 @ T_frame0_world @ body_pose(at_zero(model.model), last)
    origins = {}
    for name in model.bodies:
        body = model.model.body(name).id
        parent = int(model.model.body_parentid[body])
        origins[str(joint_of(model.model, name).name)] = se3.inverse(moved[parent]) @ moved[body]
    return origins


def _urdf(identified: IdentifiedRobot[SerialArm, SerialModel]) -> str:
    text = _source(identified.model)
    return with_origins(text, _origins(identified)) if text else identified_urdf(identified)


def _xacro(identified: IdentifiedRobot[SerialArm, SerialModel]) -> str:
    """Return the origins as properties of xacro; "" if the URDF was not made from one."""
    return xacro_properties(_origins(identified)) if is_from_xacro(_source(identified.model)) else ""


URDF: DescriptionFormat[SerialArm, SerialModel] = DescriptionFormat("calibrated.urdf", _urdf)
XACRO: DescriptionFormat[SerialArm, SerialModel] = DescriptionFormat("calibrated_origins.xacro", _xacro)


def loads_of(robot: SerialModel) -> Loads:
    """Return the nominal loads of each joint: its body and all that is welded to it, later joints' aside."""
    model, chain = robot.model, robot.chain
    data = at_zero(model)
    mass, moment = np.zeros(chain.size), np.zeros((chain.size, 3))
    for link, bodies in enumerate(bodies_of_links(robot)):
        for body in bodies:
            mass[link] += model.body_mass[body]
            moment[link] += model.body_mass[body] * data.xipos[body]
    centre = moment / np.maximum(mass, 1e-300)[:, None]
    arm, zero = SerialArm(chain), np.zeros((1, chain.size))
    links = [arm.frame(zero, arm.nominal(), size)[0] for size in range(1, chain.size + 1)]
    placed = [
        se3.transform(se3.inverse(robot.T_world_frame0 @ T_frame0_link), centre[i : i + 1])[0]
        if mass[i]
        else np.zeros(3)
        for i, T_frame0_link in enumerate(links)
    ]
    gravity = robot.T_world_frame0[:3, :3].T @ model.opt.gravity
    paths = {} if robot.links is None else robot.links.paths
    return Loads(chain, mass, np.array(placed), gravity, link_paths=paths)


def link_inertias(robot: SerialModel) -> Array:
    """Return Phi ``(J, 10)`` of each joint's link (as ``rigid_body.LOAD``), in Khalil's frames (``khalil_chain``)."""
    model, chain = robot.model, khalil_chain(robot.chain)
    data, arm, zero = at_zero(model), SerialArm(chain), np.zeros((1, chain.size))
    inertias = np.zeros((chain.size, 10))
    for link, bodies in enumerate(bodies_of_links(robot)):
        T_world_link = robot.T_world_frame0 @ arm.frame(zero, arm.nominal(), link + 1)[0]
        for body in bodies:
            T_world_centre = se3.pose(data.ximat[body].reshape(3, 3), data.xipos[body])
            about_centre = load_of(float(model.body_mass[body]), np.zeros(3), np.diag(model.body_inertia[body]))
            inertias[link] += load_in_frame(se3.inverse(T_world_link) @ T_world_centre) @ about_centre
    return inertias


def bodies_of_links(robot: SerialModel) -> list[list[int]]:
    """List the bodies that turn with each joint and with no later one: its own first, then those welded to it."""
    model = robot.model
    jointed = [int(model.body(name).id) for name in robot.bodies]
    links: list[list[int]] = [[] for _ in jointed]
    for body in range(1, model.nbody):
        carrier = body
        while carrier and carrier not in jointed:
            carrier = int(model.body_parentid[carrier])
        if carrier:
            links[jointed.index(carrier)].append(body)
    return links
