"""Inverse dynamics, linear in inertial parameters: of a load at the hand, and of a serial arm.

A load has ten parameters phi, in the order of ``LOAD``: mass (kg), mass times centre of mass (kg m), and inertia about
the flange's origin (kg m^2), in the axes of the last frame. ``Ixy`` is the tensor's element, the negative of the
integral of x y dm. Gravity is given in frame 0.

Link j has the ten inertial parameters of a body in frame j of Khalil and Kleinfinger (1986), which is on joint j's axis
and moves with it: ``XX YY ZZ XY XZ YZ MX MY MZ M``. Drive j has the inertia ``Ia`` of its motor and a constant ``off``;
joint j has Coulomb and viscous friction, ``Fc`` and ``Fv``. A drive that moves by a sum of joints has friction ``Fcm``
and ``Fvm``.

Torques are those of the drives at the joints: with s = C q the turns of the drives (``couplings`` C) and tau the
joints' torques, tau = C' f (Khalil & Dombre 2002, section 9.4; for a coupled wrist Gautier, Janot & Vandanjon 2013).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array, skew
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm
from lab.kinematics.serial.walk import ElementaryMotion, along

__all__ = [
    "LOAD",
    "ArmDynamics",
    "Dynamics",
    "HandMotion",
    "diagonal_matrices",
    "directions",
    "elements",
    "flange_in_last_link",
    "hand_jacobian",
    "hand_motion",
    "inertia_about_centre",
    "is_physical",
    "khalil_chain",
    "load_in_frame",
    "load_of",
    "pseudo_inertia",
    "sag_uncertainty",
    "symmetric",
    "torque_regressor",
    "wrench_regressor",
]

Dynamics = Callable[[Array, Array, Array], Array]
"""Joints, speeds and accelerations ``(n, J)`` to an arm's torques ``(n, J)``, Nm (N of a slide)."""

LOAD = ("mass", "mcx", "mcy", "mcz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")


@dataclass(frozen=True)
class HandMotion:
    """Motion of the last frame relative to frame 0; the vectors are expressed in the last frame.

    Attributes:
        rotation: ``(n, 3, 3)`` of the last frame in frame 0.
        omega: ``(n, 3)`` rad/s, angular velocity.
        alpha: ``(n, 3)`` rad/s^2, angular acceleration.
        acceleration: ``(n, 3)`` m/s^2 of the last frame's origin, without gravity.
    """

    rotation: Array
    omega: Array
    alpha: Array
    acceleration: Array


def hand_motion(arm: SerialArm, values: Array, joints: Array, speeds: Array, accelerations: Array) -> HandMotion:
    """Return the motion of the hand by the forward recursion of Newton and Euler (Luh, Walker & Paul 1980).

    Args:
        joints, speeds, accelerations: ``(n, joints)`` in rad or m, per s and s^2.
    """
    return _moved(arm, _hinges(arm, values, joints), speeds, accelerations)


def wrench_regressor(motion: HandMotion, gravity: Array) -> Array:
    """Return A ``(n, 6, 10)``: A phi is the force (N) and the moment (Nm) of the hand on the load.

    About the last frame's origin and in its axes. With a the acceleration less gravity (Atkeson, An & Hollerbach 1986),
    f = m a + ([alpha]x + [omega]x^2) mc and n = -[a]x mc + (L(alpha) + [omega]x L(omega)) I.

    Args:
        gravity: ``(3,)`` m/s^2 in frame 0, or ``(n, 3)``.
    """
    down = np.broadcast_to(gravity, motion.acceleration.shape)
    felt = motion.acceleration - np.einsum("nij,ni->nj", motion.rotation, down)
    turning = skew(motion.omega)
    regressor = np.zeros((len(felt), 6, len(LOAD)), dtype=felt.dtype)
    regressor[:, :3, 0] = felt
    regressor[:, :3, 1:4] = skew(motion.alpha) + turning @ turning
    regressor[:, 3:, 1:4] = -skew(felt)
    regressor[:, 3:, 4:] = _times(motion.alpha) + turning @ _times(motion.omega)
    return regressor


def torque_regressor(
    arm: SerialArm, values: Array, joints: Array, speeds: Array, accelerations: Array, gravity: Array
) -> Array:
    """Return W = J'A ``(n, joints, 10)``: W phi are the joints' torques for the load (Nm; N of a slide).

    Args are those of ``hand_motion`` and ``wrench_regressor``.
    """
    hinges = _hinges(arm, values, joints)
    regressor = wrench_regressor(_moved(arm, hinges, speeds, accelerations), gravity)
    return np.asarray(np.swapaxes(_jacobian(arm, hinges), 1, 2) @ regressor)


def sag_uncertainty(
    arm: SerialArm, values: Array, compliance: Array, joints: Array, gravity: Array, covariance: Array, target: int = 0
) -> Array:
    """Return the root mean square displacement ``(n,)`` m of a target by the uncertainty of the load's mass and first
    moment.

    The joints deflect by C W (m, mc), with W the first four columns of the load's regressor at rest; to first order the
    target moves by J C W (m, mc).

    Args:
        compliance: C ``(joints,)`` rad/Nm (m/N of a slide).
        joints: readings ``(n, joints)``.
        gravity: ``(3,)`` m/s^2 in frame 0.
        covariance: ``(4, 4)`` of mass and first moment.
    """
    still = np.zeros_like(joints)
    static = torque_regressor(arm, values, joints, still, still, gravity)[:, :, :4]
    lever = arm.joint_jacobian(joints, values)[:, target]
    moved = lever @ (compliance[:, None] * static)
    return np.asarray(np.sqrt(np.einsum("nif,fg,nig->n", moved, covariance, moved)))


def hand_jacobian(arm: SerialArm, values: Array, joints: Array) -> Array:
    """Return the Jacobian ``(n, 6, J)`` of the last frame at its origin and in its axes."""
    return _jacobian(arm, _hinges(arm, values, joints))


def symmetric(elements: Array) -> Array:
    """Return the tensor ``(3, 3)`` of elements xx yy zz xy xz yz."""
    xx, yy, zz, xy, xz, yz = elements
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def elements(tensor: Array) -> Array:
    """Return the elements xx yy zz xy xz yz of a tensor ``(3, 3)``."""
    return np.asarray(tensor)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def inertia_about_centre(phi: Array) -> Array:
    """Return the tensor ``(3, 3)`` about the centre of mass, in the last frame's axes."""
    moment = phi[1:4]
    return np.asarray(symmetric(phi[4:]) - (moment @ moment * np.eye(3) - np.outer(moment, moment)) / phi[0])


def load_of(mass_kg: float, centre_m: Array, about_centre: Array) -> Array:
    """Return the parameters phi ``(10,)`` of a mass, its centre ``(3,)`` and its inertia ``(3, 3)`` about that."""
    centre = np.asarray(centre_m)
    about_origin = about_centre + mass_kg * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return np.concatenate([[mass_kg], mass_kg * centre, elements(about_origin)])


def pseudo_inertia(phi: Array) -> Array:
    """Return J ``(4, 4)`` = [[tr(I) / 2 1 - I, m c], [m c', m]], linear in phi (Wensing, Kim & Slotine 2018, eq. 5)."""
    inertia = symmetric(phi[4:])
    matrix = np.empty((4, 4))
    matrix[:3, :3] = np.trace(inertia) / 2 * np.eye(3) - inertia
    matrix[:3, 3] = matrix[3, :3] = phi[1:4]
    matrix[3, 3] = phi[0]
    return matrix


def is_physical(phi: Array) -> bool:
    """Check that the pseudo-inertia with unit diagonal is positive definite, as of a body."""
    matrix = pseudo_inertia(phi)
    diagonal = np.diag(matrix)
    if not (diagonal > 0).all():
        return False
    scale = 1 / np.sqrt(diagonal)
    return bool(np.linalg.eigvalsh(scale[:, None] * matrix * scale)[0] > 0)


@dataclass(frozen=True)
class _Hinges:
    """Motions of the joints in order, and the last frame: axes as columns ``(n, 3, 3)`` and origin ``(3, n)``."""

    motions: list[ElementaryMotion]
    rotation: Array
    origin: Array


def _hinges(arm: SerialArm, values: Array, joints: Array) -> _Hinges:
    if joints.ndim != 2 or joints.shape[1] != arm.chain.size:
        raise LabError(
            f"joints of shape {joints.shape} do not fit robot '{arm.chain.name}': give (samples, {arm.chain.size})"
        )
    x, y, z = np.eye(3)[:, [0, 1, 2, 0, 1], None]
    motions, frame, origin = along(arm.chain, (x, y, z), np.zeros((5, 1)), arm.split(values)[1], joints.T)
    count = len(joints)
    rotation = np.stack([np.broadcast_to(axis[:3], (3, count)) for axis in frame], axis=-1).transpose(1, 0, 2)
    moving = [motion for motion in motions if motion.joint is not None]
    return _Hinges(moving, rotation, np.broadcast_to(origin[:3], (3, count)))


def _moved(arm: SerialArm, hinges: _Hinges, speeds: Array, accelerations: Array) -> HandMotion:
    """Return the hand's motion by the recursion in frame 0; ``acceleration`` is that of ``point`` on the current body.

    At a hinge the point moves onto the axis, which both bodies share; a slide adds its own and the Coriolis
    acceleration.
    """
    if not speeds.shape == accelerations.shape == (len(hinges.rotation), arm.chain.size):
        raise LabError(f"speeds {speeds.shape} and accelerations {accelerations.shape}: give both, a row a sample")
    kind = np.result_type(hinges.rotation, speeds, accelerations)
    omega, alpha, point, acceleration = (np.zeros(hinges.origin.shape, dtype=kind) for _ in range(4))
    for motion in hinges.motions:
        assert motion.joint is not None
        i = motion.joint
        axis = arm.chain.sign[i] * motion.axis[:3]
        turned = axis * speeds[:, i]
        if motion.origin is None:
            acceleration = acceleration + axis * accelerations[:, i] + 2 * _cross(omega, turned)
            continue
        acceleration = _carried(acceleration, omega, alpha, motion.origin[:3] - point)
        point = motion.origin[:3]
        alpha = alpha + axis * accelerations[:, i] + _cross(omega, turned)
        omega = omega + turned
    acceleration = _carried(acceleration, omega, alpha, hinges.origin - point)
    omega, alpha, acceleration = (
        np.einsum("nij,in->nj", hinges.rotation, vector) for vector in (omega, alpha, acceleration)
    )
    return HandMotion(hinges.rotation, omega, alpha, acceleration)


def _jacobian(arm: SerialArm, hinges: _Hinges) -> Array:
    jacobian = np.zeros((6, arm.chain.size, hinges.origin.shape[1]), dtype=hinges.rotation.dtype)
    for motion in hinges.motions:
        assert motion.joint is not None
        axis = arm.chain.sign[motion.joint] * motion.axis[:3]
        if motion.origin is None:
            jacobian[:3, motion.joint] = axis
            continue
        jacobian[:3, motion.joint] = _cross(axis, hinges.origin - motion.origin[:3])
        jacobian[3:, motion.joint] = axis
    halves = jacobian.reshape(2, 3, arm.chain.size, -1)
    turned: Array = np.einsum("nij,hikn->nhjk", hinges.rotation, halves)
    return turned.reshape(-1, 6, arm.chain.size)


def _carried(acceleration: Array, omega: Array, alpha: Array, lever: Array) -> Array:
    return acceleration + _cross(alpha, lever) + _cross(omega, _cross(omega, lever))


def _cross(a: Array, b: Array) -> Array:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _times(v: Array) -> Array:
    """Return L with L(v) I = I v, for I as xx yy zz xy xz yz; ``(n, 3)`` to ``(n, 3, 6)``."""
    x, y, z = v.T
    o = np.zeros_like(x)
    return np.stack([x, o, o, y, z, o, o, y, o, x, o, z, o, o, z, o, x, y], axis=-1).reshape(-1, 3, 6)


_INERTIAL = ("M", "MX", "MY", "MZ", "XX", "YY", "ZZ", "XY", "XZ", "YZ")  # of a link, in the order of ``LOAD``
_STANDSTILL = 1e-6  # rad/s or m/s: the direction of friction is unknown below
_COUPLED = 1e-12  # off-diagonal elements of C above couple joints


def khalil_chain(chain: Chain) -> Chain:
    """Return the joints with frames on their axes (Craig's convention), for the links' parameters.

    A distal table's links begin with their joint's motion, Rz Tz, and end with Tx Rx Ry; here the latter begin the next
    one. The end of the last link is left out (``flange_in_last_link``).
    """
    if chain.convention == "craig":
        return chain
    theta, d, a, alpha, beta = chain.table.T
    moved = (np.concatenate([[0.0], each[:-1]]) for each in (a, alpha, beta))
    parallel = (True, *chain.parallel[:-1])
    return replace(chain, convention="craig", table=np.stack([theta, d, *moved], axis=1), parallel=parallel)


def flange_in_last_link(chain: Chain) -> Array:
    """Return the pose ``(4, 4)`` of the table's last frame in the frame of the last link."""
    still = np.zeros((1, chain.size))
    last, flange = (SerialArm(each) for each in (khalil_chain(chain), chain))
    T_0_last, T_0_flange = (arm.flange(still, arm.nominal())[0] for arm in (last, flange))
    return np.asarray(se3.inverse(T_0_last) @ T_0_flange)


def load_in_frame(T_link_load: Array) -> Array:
    """Return the matrix ``(10, 10)`` of a body's parameters phi from its frame to another frame."""
    rotation, shift = T_link_load[:3, :3], T_link_load[:3, 3]
    columns = []
    for phi in np.eye(len(LOAD)):
        mass, moment = phi[0], rotation @ phi[1:4]
        inertia = rotation @ symmetric(phi[4:]) @ rotation.T
        cross = shift @ moment * np.eye(3) * 2 - np.outer(shift, moment) - np.outer(moment, shift)
        inertia = inertia + cross + mass * (shift @ shift * np.eye(3) - np.outer(shift, shift))
        columns.append(np.concatenate([[mass], moment + mass * shift, elements(inertia)]))
    return np.stack(columns, axis=1)


_ACROSS = ("a", "alpha", "beta")  # what leads from one axis to the next


@dataclass(frozen=True)
class ArmDynamics:
    """Inverse dynamic model of an arm, f = W(q, q', q'') X.

    Attributes:
        chain: in Craig's convention (``khalil_chain``).
        gravity: ``(3,)`` m/s^2 in frame 0.
        couplings: C ``(J, J)``, turns of each drive by the joints' positions, as the joints feel it: unit diagonal, and
            one at (5, 4) if the last drive of six also turns with joint 5.
        motor_inertia, friction, offsets: parameters of the model.
        distal: whether the robot's own table is in the distal convention, where the a and α that lead to frame j are
            those of row j - 1.
    """

    chain: Chain
    gravity: Array
    couplings: Array
    motor_inertia: bool = True
    friction: bool = True
    offsets: bool = True
    distal: bool = False

    def __post_init__(self) -> None:
        size = self.chain.size
        if self.chain.convention != "craig":
            raise LabError(f"robot '{self.chain.name}': its links' parameters are about frames on its axes")
        if self.couplings.shape != (size, size) or not np.isfinite(self.couplings).all():
            raise LabError(f"couplings of shape {self.couplings.shape}: give ({size}, {size}) finite numbers")
        if abs(np.linalg.det(self.couplings)) < 1e-9:
            raise LabError("the couplings are singular: two drives would turn alike; give each drive its own joint")

    @classmethod
    def of(cls, chain: Chain, gravity: Array, couplings: Array | None = None) -> "ArmDynamics":
        """Return the whole model of any chain; by default each drive turns its own joint."""
        coupled = np.eye(chain.size) if couplings is None else couplings
        return cls(khalil_chain(chain), gravity, coupled, distal=chain.convention == "distal")

    def letter(self, symbol: str, j: int) -> str:
        """Return the name of a constant of frame j (from 1), by its row in the robot's own table: ``a2``, ``d4``."""
        return f"{symbol}{j - 1 if self.distal and symbol in _ACROSS else j}"

    @cached_property
    def coupled(self) -> tuple[int, ...]:
        """Drives (from 0) that turn with more than one joint."""
        beside = np.abs(self.couplings - np.diag(np.diag(self.couplings))).max(axis=1)
        return tuple(np.flatnonzero(beside > _COUPLED).tolist())

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the standard parameters: ten of each link, then those of drives and joints."""
        numbers = range(1, self.chain.size + 1)
        names = [f"{kind}{j}" for j in numbers for kind in _INERTIAL]
        if self.motor_inertia:
            names += [f"Ia{j}" for j in numbers]
        if self.friction:
            names += [f"{kind}{j}" for kind in ("Fc", "Fv") for j in numbers]
            names += [f"{kind}{j + 1}" for kind in ("Fcm", "Fvm") for j in self.coupled]
        if self.offsets:
            names += [f"off{j}" for j in numbers]
        return tuple(names)

    def units(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return the SI units of parameters."""
        return tuple(self._unit(name) for name in names)

    def _unit(self, name: str) -> str:
        kind = name.rstrip("0123456789")
        slides = self.chain.prismatic[int(name[len(kind) :]) - 1]
        if kind == "M":
            return "kg"
        if kind[0] in "FIo" and slides:
            return {"Ia": "kg", "Fc": "N", "Fcm": "N", "off": "N"}.get(kind, "N s/m")
        force = {"Fc": "Nm", "Fcm": "Nm", "off": "Nm", "Fv": "Nm s/rad", "Fvm": "Nm s/rad"}
        return force.get(kind, "kg m" if kind[0] == "M" else "kg m²")

    def regressor(self, joints: Array, speeds: Array, accelerations: Array) -> Array:
        """Return W ``(n, J, p)`` at joint positions, speeds and accelerations ``(n, J)``, rad or m."""
        size = self.chain.size
        turned, rates = speeds @ self.couplings.T, accelerations @ self.couplings.T
        blocks = [self._of_drives(self.link_regressor(joints, speeds, accelerations))]
        if self.motor_inertia:
            blocks.append(diagonal_matrices(rates))
        if self.friction:
            own = list(self.coupled)
            blocks += [self._of_drives(diagonal_matrices(at_joint)) for at_joint in (directions(speeds), speeds)]
            blocks += [diagonal_matrices(at_drive)[:, :, own] for at_drive in (directions(turned), turned)]
        if self.offsets:
            blocks.append(np.broadcast_to(np.eye(size), (len(joints), size, size)))
        return np.concatenate(blocks, axis=2)

    def _of_drives(self, torques: Array) -> Array:
        return np.linalg.inv(self.couplings.T) @ torques if self.coupled else torques

    def link_regressor(self, joints: Array, speeds: Array, accelerations: Array) -> Array:
        """Return the links' regressor ``(n, J, 10 J)``: each link as a load at the end of its part of the chain."""
        size = self.chain.size
        regressor = np.zeros((len(joints), size, len(_INERTIAL) * size))
        for j in range(1, size + 1):
            part = SerialArm(self.chain.first(j))
            own = torque_regressor(
                part, part.nominal(), joints[:, :j], speeds[:, :j], accelerations[:, :j], self.gravity
            )
            regressor[:, :j, len(_INERTIAL) * (j - 1) : len(_INERTIAL) * j] = own
        return regressor

    def standard(self, links: Array, others: dict[str, float]) -> Array:
        """Return the vector of standard parameters ``(p,)``.

        Args:
            links: ``(J, 10)`` phi of each link, as ``LOAD``, in its frame.
            others: the rest by name; zero by default.
        """
        values = np.zeros(len(self.names))
        values[: links.size] = links.ravel()
        for name, value in others.items():
            values[self.names.index(name)] = value
        return values

    def bodies(self) -> NDArray[np.int_]:
        """Return indices ``(J, 10)`` of the links' inertial parameters."""
        return np.arange(len(_INERTIAL) * self.chain.size).reshape(self.chain.size, -1)


def directions(speeds: Array) -> Array:
    """Return the signs of speeds; zero at rest."""
    return np.where(np.abs(speeds) < _STANDSTILL, 0.0, np.sign(speeds))


def diagonal_matrices(values: Array) -> Array:
    """Return ``(n, J)`` as diagonal matrices ``(n, J, J)``."""
    return np.asarray(values[:, :, None] * np.eye(values.shape[1]))
