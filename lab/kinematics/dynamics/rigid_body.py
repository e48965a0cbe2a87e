"""What a rigid load at the hand asks of the hand and of the joints: linear in its ten inertial parameters.

The parameters phi, in the order of ``LOAD``: mass (kg), first moment mass times centre of mass (kg m), and the
inertia about the flange's origin (kg m^2), all in the axes of the last frame, which is the flange's. ``Ixy`` is the
tensor's element, the negative of the integral of x y dm. The arm's base in the tracker's frame plays no part: gravity
is given in frame 0.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array, skew
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.walk import Motion, along

__all__ = [
    "LOAD",
    "Dynamics",
    "HandMotion",
    "elements",
    "hand_jacobian",
    "hand_motion",
    "inertia_about_centre",
    "is_physical",
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
    """How the last frame moves against frame 0; the vectors are expressed in the last frame.

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
    """The motion of the hand: the forward recursion of Newton and Euler (Luh, Walker & Paul 1980), over n samples.

    Args:
        joints, speeds, accelerations: of the joint positions, ``(n, joints)`` in rad or m, per s and s^2.
    """
    return _moved(arm, _hinges(arm, values, joints), speeds, accelerations)


def wrench_regressor(motion: HandMotion, gravity: Array) -> Array:
    """A ``(n, 6, 10)``: A phi is the force (N) and the moment (Nm) that the hand exerts on the load.

    About the last frame's origin and in its axes. With a the acceleration less gravity (Atkeson, An & Hollerbach
    1986), f = m a + ([alpha]x + [omega]x^2) mc and n = -[a]x mc + (L(alpha) + [omega]x L(omega)) I.

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
    """W = J'A ``(n, joints, 10)``: W phi is what the joints exert to carry the load (Nm; N of a slide).

    Positive where it pushes the joint position up. Args are those of ``hand_motion`` and ``wrench_regressor``.
    """
    hinges = _hinges(arm, values, joints)
    regressor = wrench_regressor(_moved(arm, hinges, speeds, accelerations), gravity)
    joint_derivatives: Array = np.swapaxes(_jacobian(arm, hinges), 1, 2) @ regressor
    return joint_derivatives


def sag_uncertainty(
    arm: SerialArm, values: Array, compliance: Array, joints: Array, gravity: Array, covariance: Array, target: int = 0
) -> Array:
    """Root mean square displacement ``(n,)`` m of a target by the uncertainty of the load's mass and first moment.

    The joints give way by C W (m, mc), with W the first four columns of the load's regressor at rest, so the target
    moves by J C W (m, mc); to first order.

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
    """Jacobian ``(n, 6, J)`` of the last frame (velocity, angular velocity) at its origin and in its axes."""
    return _jacobian(arm, _hinges(arm, values, joints))


def symmetric(elements: Array) -> Array:
    """The tensor ``(3, 3)`` from its elements xx yy zz xy xz yz."""
    xx, yy, zz, xy, xz, yz = elements
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def elements(tensor: Array) -> Array:
    """The elements xx yy zz xy xz yz of a tensor ``(3, 3)``."""
    return np.asarray(tensor)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def inertia_about_centre(phi: Array) -> Array:
    """The tensor ``(3, 3)`` about the centre of mass, in the last frame's axes."""
    moment = phi[1:4]
    inner: Array = symmetric(phi[4:]) - (moment @ moment * np.eye(3) - np.outer(moment, moment)) / phi[0]
    return inner


def load_of(mass_kg: float, centre_m: Array, about_centre: Array) -> Array:
    """The parameters phi ``(10,)`` of a body: its mass, its centre ``(3,)`` and its inertia ``(3, 3)`` about that."""
    centre = np.asarray(centre_m)
    about_origin = about_centre + mass_kg * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return np.concatenate([[mass_kg], mass_kg * centre, elements(about_origin)])


def pseudo_inertia(phi: Array) -> Array:
    """J ``(4, 4)`` = [[tr(I) / 2 1 - I, m c], [m c', m]], linear in phi (Wensing, Kim & Slotine 2018, eq. 5)."""
    inertia = symmetric(phi[4:])
    matrix = np.empty((4, 4))
    matrix[:3, :3] = np.trace(inertia) / 2 * np.eye(3) - inertia
    matrix[:3, 3] = matrix[3, :3] = phi[1:4]
    matrix[3, 3] = phi[0]
    return matrix


def is_physical(phi: Array) -> bool:
    """Whether a body can have these parameters: its pseudo-inertia, scaled to a unit diagonal, is positive definite."""
    matrix = pseudo_inertia(phi)
    diagonal = np.diag(matrix)
    if not (diagonal > 0).all():
        return False
    scale = 1 / np.sqrt(diagonal)
    return bool(np.linalg.eigvalsh(scale[:, None] * matrix * scale)[0] > 0)


@dataclass(frozen=True)
class _Hinges:
    """The joints' motions in their order, and the last frame: axes as columns ``(n, 3, 3)`` and origin ``(3, n)``."""

    motions: list[Motion]
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
    """The recursion, in frame 0: ``point`` is a place on the body reached, and ``acceleration`` its acceleration there.

    At a hinge the point moves onto the axis, which both bodies share; a slide adds its own acceleration and Coriolis'.
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
    """The acceleration of a point of the same body a lever away, all ``(3, n)``."""
    return acceleration + _cross(alpha, lever) + _cross(omega, _cross(omega, lever))


def _cross(a: Array, b: Array) -> Array:
    """Products of vectors along the first axis, ``(3, n)``."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _times(v: Array) -> Array:
    """L with L(v) I = I v, for I as xx yy zz xy xz yz; ``(n, 3)`` to ``(n, 3, 6)``."""
    x, y, z = v.T
    o = np.zeros_like(x)
    return np.stack([x, o, o, y, z, o, o, y, o, x, o, z, o, o, z, o, x, y], axis=-1).reshape(-1, 3, 6)
