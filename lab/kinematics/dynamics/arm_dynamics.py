"""The joints' torques of a serial arm: linear in the standard dynamic parameters of its links, drives and joints.

Link j has the ten inertial parameters of a body about the origin and in the axes of frame j of Khalil and Kleinfinger
(1986), which lies on joint j's axis and moves with it: ``XX YY ZZ XY XZ YZ MX MY MZ M``, with ``XY`` the tensor's
element. Drive j has the inertia ``Ia`` of what turns at the motor and a constant ``off``; joint j has Coulomb and
viscous friction, ``Fc`` and ``Fv``. A drive that moves by a sum of joints has friction ``Fcm`` and ``Fvm`` of its own.

Torques are those of the drives, as the joints feel them: with s = C q what the drives turn (``couplings`` C) and tau
the joints' torques, tau = C' f (Khalil & Dombre 2002, section 9.4; of a coupled wrist Gautier, Janot & Vandanjon
2013).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.dynamics.rigid_body import LOAD, elements, symmetric, torque_regressor
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain

__all__ = ["INERTIAL", "ArmDynamics", "directions", "flange_in_last_link", "khalil_chain", "load_in_frame"]

INERTIAL = ("M", "MX", "MY", "MZ", "XX", "YY", "ZZ", "XY", "XZ", "YZ")  # of a link, in the order of ``LOAD``
STANDSTILL = 1e-6  # rad/s or m/s: a joint that is slower has friction of no known direction
_COUPLED = 1e-12  # of a row of C: what is beside its one joint


def khalil_chain(chain: Chain) -> Chain:
    """The same joints with frames on their axes (Craig's convention): where the links' parameters are expressed.

    A distal table's links begin with their joint's motion, Rz Tz, and end with Tx Rx Ry; here the latter begin the
    next one. What the last link of a distal table has behind its joint is left out (``flange_in_last_link``).
    """
    if chain.convention == "craig":
        return chain
    theta, d, a, alpha, beta = chain.table.T
    moved = (np.concatenate([[0.0], each[:-1]]) for each in (a, alpha, beta))
    parallel = (True, *chain.parallel[:-1])
    return replace(chain, convention="craig", table=np.stack([theta, d, *moved], axis=1), parallel=parallel)


def flange_in_last_link(chain: Chain) -> Array:
    """Pose ``(4, 4)`` of the table's last frame in the frame of the last link."""
    still = np.zeros((1, chain.size))
    last, flange = (SerialArm(each) for each in (khalil_chain(chain), chain))
    T_0_last, T_0_flange = (arm.flange(still, arm.nominal())[0] for arm in (last, flange))
    pose: Array = se3.inverse(T_0_last) @ T_0_flange
    return pose


def load_in_frame(T_link_load: Array) -> Array:
    """The matrix ``(10, 10)`` that takes a body's parameters phi (as ``LOAD``) from its frame to another frame."""
    rotation, shift = T_link_load[:3, :3], T_link_load[:3, 3]
    columns = []
    for phi in np.eye(len(LOAD)):
        mass, moment = phi[0], rotation @ phi[1:4]
        inertia = rotation @ symmetric(phi[4:]) @ rotation.T
        cross = shift @ moment * np.eye(3) * 2 - np.outer(shift, moment) - np.outer(moment, shift)
        inertia = inertia + cross + mass * (shift @ shift * np.eye(3) - np.outer(shift, shift))
        columns.append(np.concatenate([[mass], moment + mass * shift, elements(inertia)]))
    return np.stack(columns, axis=1)


@dataclass(frozen=True)
class ArmDynamics:
    """The inverse dynamic model of an arm, f = W(q, q', q'') X.

    Attributes:
        chain: in Craig's convention (``khalil_chain``).
        gravity: ``(3,)`` m/s^2 in frame 0.
        couplings: C ``(J, J)``, what each drive turns by the joints' positions, as the joints see it: one on the
            diagonal, and one at (5, 4) where the last drive of six also turns with joint 5.
        motor_inertia, friction, offsets: whether these parameters are part of the model.
    """

    chain: Chain
    gravity: Array
    couplings: Array
    motor_inertia: bool = True
    friction: bool = True
    offsets: bool = True

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
        """The whole model of any chain; by default each drive turns its own joint."""
        return cls(khalil_chain(chain), gravity, np.eye(chain.size) if couplings is None else couplings)

    @cached_property
    def coupled(self) -> tuple[int, ...]:
        """The drives (from 0) that turn with more than one joint."""
        beside = np.abs(self.couplings - np.diag(np.diag(self.couplings))).max(axis=1)
        return tuple(np.flatnonzero(beside > _COUPLED).tolist())

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The standard parameters: the links' ten each, then what drives and joints have."""
        numbers = range(1, self.chain.size + 1)
        names = [f"{kind}{j}" for j in numbers for kind in INERTIAL]
        names += [f"Ia{j}" for j in numbers if self.motor_inertia]
        if self.friction:
            names += [f"{kind}{j}" for kind in ("Fc", "Fv") for j in numbers]
            names += [f"{kind}{j + 1}" for kind in ("Fcm", "Fvm") for j in self.coupled]
        return (*names, *(f"off{j}" for j in numbers if self.offsets))

    def units(self, names: Sequence[str]) -> tuple[str, ...]:
        """Of parameters, in SI."""
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
        """W ``(n, J, p)`` at joint positions, speeds and accelerations ``(n, J)``, rad or m."""
        size = self.chain.size
        turned, rates = speeds @ self.couplings.T, accelerations @ self.couplings.T
        blocks = [self._of_drives(self.link_regressor(joints, speeds, accelerations))]
        if self.motor_inertia:
            blocks.append(_diagonal(rates))
        if self.friction:
            own = list(self.coupled)
            blocks += [self._of_drives(_diagonal(at_joint)) for at_joint in (directions(speeds), speeds)]
            blocks += [_diagonal(at_drive)[:, :, own] for at_drive in (directions(turned), turned)]
        if self.offsets:
            blocks.append(np.broadcast_to(np.eye(size), (len(joints), size, size)))
        return np.concatenate(blocks, axis=2)

    def _of_drives(self, torques: Array) -> Array:
        """The drives' torques ``(n, J, ...)`` that give those of the joints, f = C'^-1 tau."""
        return np.linalg.inv(self.couplings.T) @ torques if self.coupled else torques

    def link_regressor(self, joints: Array, speeds: Array, accelerations: Array) -> Array:
        """What the links alone ask of the joints, ``(n, J, 10 J)``: each as a load at the end of the chain up to it."""
        size = self.chain.size
        regressor = np.zeros((len(joints), size, len(INERTIAL) * size))
        for j in range(1, size + 1):
            part = SerialArm(self.chain.first(j))
            own = torque_regressor(
                part, part.nominal(), joints[:, :j], speeds[:, :j], accelerations[:, :j], self.gravity
            )
            regressor[:, :j, len(INERTIAL) * (j - 1) : len(INERTIAL) * j] = own
        return regressor

    def standard(self, links: Array, others: dict[str, float]) -> Array:
        """The vector of standard parameters ``(p,)``.

        Args:
            links: ``(J, 10)`` phi of each link, as ``LOAD``, about and along its frame.
            others: the rest by name; zero where it is not named.
        """
        values = np.zeros(len(self.names))
        values[: links.size] = links.ravel()
        for name, value in others.items():
            values[self.names.index(name)] = value
        return values

    def bodies(self) -> NDArray[np.int_]:
        """Indices ``(J, 10)`` of the links' inertial parameters among the standard ones."""
        return np.arange(len(INERTIAL) * self.chain.size).reshape(self.chain.size, -1)


def directions(speeds: Array) -> Array:
    """The signs of speeds; zero at rest, where friction may have either."""
    return np.where(np.abs(speeds) < STANDSTILL, 0.0, np.sign(speeds))


def _diagonal(values: Array) -> Array:
    """``(n, J)`` as diagonal matrices ``(n, J, J)``."""
    diagonal: Array = values[:, :, None] * np.eye(values.shape[1])
    return diagonal
