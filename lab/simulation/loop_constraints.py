"""Where a closed model stands: Newton's method on MuJoCo's own constraints, which shares no line with ours.

The rows of ``mjData.efc_pos`` are what closes: a tendon's length less the rod's (m), or, of a pin, one end less the
other along the world's axes, which are the base's; ``efc_J`` are their derivatives by ``qvel``. Both are made by
``mj_makeConstraint`` after kinematics, ``mj_comPos`` and ``mj_tendon``; limits and friction would add rows.
"""

import copy
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.closed.configuration import Dimensions
from lab.kinematics.closed.loop_closure import CONTRACTED, FIRST_STEP, LEAST_STEP, MOST_CORRECTIONS, ROUNDING_M
from lab.kinematics.closed.mechanism import Mechanism
from lab.simulation.model import update_constants

__all__ = ["closed_qpos"]

_SETTLED_M = 1e-9  # after a correction of less, the next would be below rounding, as they shrink quadratically
_FAR_RAD = 0.5  # turns that a correction changes by more may be wound up, or be past another mode
_ADDS_ROWS = mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS


def closed_qpos(
    model: mujoco.MjModel, mechanism: Mechanism, values: Array, joints: Array, passive: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Where a model of ``closed_spec`` stands at joint positions ``(n, joints)``, from passive values ``(z, n)``.

    Meant is the assembly mode of the start. Newton's method keeps to it where no turn changes by
    more than ``_FAR_RAD``, later corrections are at most a quarter of the first (Deuflhard 2004, section 5.1; as in
    ``assembly``), and the determinant of the closures' derivatives keeps its sign. Where it may not, the gaps of the
    start are closed little by little, by steps in which it does; a way that ends is a jump.

    Args:
        values: parameters ``(p,)`` of the model; lengths of rods are taken from here, pose by pose.

    Returns:
        ``qpos (n, nq)``; and ``(n,)`` where it is NaN: the loops do not close, or perhaps in another mode alone.
    """
    loops = _Loops(_quiet(model), mechanism, mechanism.dimensions(values))
    qpos = np.full((len(joints), model.nq), np.nan)
    with np.errstate(all="ignore"):  # on the way to nowhere numbers may grow
        for i, (row, start) in enumerate(zip(joints, passive.T, strict=True)):
            if (found := loops.settled(row, start)) is not None:
                qpos[i] = found
    return qpos, np.asarray(np.isnan(qpos).any(axis=1))


def _quiet(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy that has equalities for constraints, dense derivatives, and lengths at rest of the bodies as they are."""
    model = copy.deepcopy(model)
    model.opt.disableflags |= _ADDS_ROWS
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    update_constants(model)
    return model


@dataclass(frozen=True)
class _Loops:
    """The closures of a model as equations for its passive values, at one pose after another."""

    model: mujoco.MjModel
    mechanism: Mechanism
    dimensions: Dimensions

    @cached_property
    def data(self) -> mujoco.MjData:
        """What is worked on."""
        return mujoco.MjData(self.model)

    @cached_property
    def measured(self) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Measured joints: which of the robot's, and where in ``qpos``, which is the joint position."""
        steps = [step.joint for frame in self.mechanism.tree.frames for step in frame.path if step.joint is not None]
        addresses = [int(self.model.joint(self.mechanism.joint_names[i]).qposadr[0]) for i in steps]
        return np.array(steps, dtype=int), np.array(addresses, dtype=int)

    @cached_property
    def passive(self) -> NDArray[np.int_]:
        """Where in ``qpos``, and in ``qvel``, the passive values are: hinges and slides have one number in each."""
        names = [self.mechanism.tree.name_of(f, s) for f, s in self.mechanism.tree.passive]
        return np.array([int(self.model.joint(name).qposadr[0]) for name in names], dtype=int)

    @cached_property
    def rotational(self) -> NDArray[np.bool_]:
        """Which passive values are angles."""
        tree = self.mechanism.tree
        return np.array([tree.step(f, s).is_turn for f, s in tree.passive])

    @cached_property
    def rods(self) -> tuple[NDArray[np.int_], Array, Array]:
        """Rods' equalities, what those add to a tendon at rest (m), and that per joint position ``(rods, joints)``."""
        rods = self.mechanism.tree.rods
        at_rest = self.model.tendon_length0[[self.model.tendon(rod.name).id for rod in rods]]
        by_joint = np.zeros((len(rods), self.mechanism.size))
        for i, rod in enumerate(rods):
            if rod.joint is not None:
                by_joint[i, rod.joint] = self.dimensions.scale[rod.joint]
        equalities = np.array([self.model.equality(rod.name).id for rod in rods], dtype=int)
        return equalities, self.dimensions.lengths - at_rest, by_joint

    @cached_property
    def rows(self) -> NDArray[np.int_]:
        """The constraints' rows that close: one of a rod, of a pin those along its axes. Equalities come first."""
        kinds = self.model.eq_type
        sizes = np.where(kinds == mujoco.mjtEq.mjEQ_CONNECT, 3, 1)
        first = np.cumsum(sizes) - sizes
        tree = self.mechanism.tree
        rods = [first[self.model.equality(rod.name).id] for rod in tree.rods]
        pins = [first[self.model.equality(pin.name).id] + axis for pin in tree.pins for axis in pin.axes]
        return np.array([*rods, *pins], dtype=int)

    @cached_property
    def entries(self) -> NDArray[np.int_]:
        """Where in ``efc_J`` the derivatives by the passive values are, ``(z, z)``."""
        return np.asarray(self.rows[:, None] * self.model.nv + self.passive)

    def settled(self, row: Array, start: Array) -> Array | None:
        """The ``qpos`` at one row ``(joints,)``, from passive values ``(z,)``; None where no way leads there."""
        which, addresses = self.measured
        equalities, added, by_joint = self.rods
        self.data.qpos[addresses] = row[which]
        self.model.eq_data[equalities, 0] = added + by_joint @ row
        if len(start):
            passive = self._corrected(start, np.zeros(len(start)))
            passive = self._followed(start) if passive is None else passive
            if passive is None:
                return None
            self.data.qpos[self.passive] = passive
        return np.array(self.data.qpos)

    def _followed(self, start: Array) -> Array | None:
        """Passive values that close the loops, from others, where the gaps between can be closed little by little."""
        gaps = self._closures(start)[0]
        passive, left, step = start, 1.0, FIRST_STEP
        while left > 0:
            found = self._corrected(passive, max(left - step, 0.0) * gaps)
            if found is not None:
                passive, left, step = found, max(left - step, 0.0), 2 * step
            elif (step := step / 2) < LEAST_STEP:
                return None
        return passive

    def _corrected(self, passive: Array, left: Array) -> Array | None:
        """Newton's method to where the closures are open by ``left`` (m); None where it may not stay on its way.

        The loop is its own: it follows a way, so that a step which is not much shorter than the first ends it, and so
        does a change of the assembly mode.
        """
        side = allowed = 0.0
        for correction in range(MOST_CORRECTIONS):
            gaps, matrix = self._closures(passive)
            try:
                moved = np.linalg.solve(matrix, gaps - left)
            except np.linalg.LinAlgError:
                return None
            size = float(np.linalg.norm(self.mechanism.levers * moved))
            if correction == 0:
                if np.abs(moved[self.rotational]).max(initial=0.0) > _FAR_RAD:
                    return None
                side, allowed = float(np.linalg.det(matrix)), max(CONTRACTED * size, ROUNDING_M)
            elif not size <= allowed:  # nor if that is not a number
                return None
            passive = passive - moved
            if size < _SETTLED_M:
                return passive if side * np.linalg.det(matrix) > 0 else None
        return None

    def _closures(self, passive: Array) -> tuple[Array, Array]:
        """How far the loops are open ``(z,)`` (m), and the derivatives ``(z, z)`` by the passive values."""
        self.data.qpos[self.passive] = passive
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_tendon(self.model, self.data)
        mujoco.mj_makeConstraint(self.model, self.data)
        return self.data.efc_pos[self.rows], self.data.efc_J[self.entries]
