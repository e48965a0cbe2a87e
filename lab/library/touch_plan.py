"""Propose the configurations of a daily check: those at the sockets of a file in which causes are told apart best."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.core.errors import LabError, counted
from lab.core.measurements import Measurements, measured
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.measurement_csv import write_measurements
from lab.kinematics.model import RigidArm
from lab.library.load_run import CalibrationRun
from lab.library.result import Result, joint_values
from lab.options.command_options import VerifyOptions
from lab.sensors.contact import without_gaps
from lab.simulation.collisions import collides
from lab.verification.socket_checks import LEAST_CONFIGURATIONS, best_configurations

__all__ = ["TouchPlan", "ball_columns", "placed_by", "planned", "sockets_of"]

_CHOICES = 60  # configurations to choose from at each socket
_DRAWN, _ROUNDS = 120, 30
_TOUCHING_M = 1e-9
_APART_M = 20e-3  # touches of one socket, by the run's own tool
_DISTINCT = 2.0  # times the distance within which a check takes two configurations for the same


@dataclass(frozen=True, repr=False, eq=False)
class TouchPlan(Result):
    """Configurations that a daily check proposes.

    Attributes:
        calibrated: the run that calibrated the arm.
        joints: ``(m, joints)`` rad or m, with the ball in the socket.
        sockets: name of the socket of each, "" where the file names none.
        own_share: share of the least distinct cause's pattern that no other cause explains.
    """

    command = "verify"
    robot_at = "calibrated.robot"

    options: VerifyOptions
    calibrated: CalibrationRun
    joints: Array
    sockets: tuple[str, ...]
    own_share: float
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints and ``result.json`` holds: joint positions in degrees or mm."""
        return {
            "run": str(self.calibrated.folder),
            "robot": self.calibrated.robot.name,
            "serial": self.calibrated.serial or self.options.serial,
            "configurations": len(self.joints),
            "own_share": self.own_share,
            "plan": [
                {"socket": socket, "joints": [round(value, 9) for value in row]}
                for socket, row in zip(self.sockets, self._shown.tolist(), strict=True)
            ],
            "warnings": list(self.warnings),
        }

    @property
    def _shown(self) -> Array:
        return joint_values(self.calibrated.robot.chain.prismatic, self.joints)

    def columns(self) -> Mapping[str, Sequence[Any] | Array]:
        """The configurations by ``socket`` and the joint positions."""
        chain = self.calibrated.robot.chain
        named = {f"{name}_{chain.unit(i).name}": self._shown[:, i] for i, name in enumerate(chain.joint_names)}
        return {"socket": list(self.sockets), **named}

    def write_files(self, folder: Path) -> None:
        """Write ``plan.csv``: a row each, to which the day is added in ``session`` when it is touched."""
        chain = self.calibrated.robot.chain
        table = measured(chain.joint_names, self.joints, (), np.empty((len(self.joints), 0, 3)))
        if any(self.sockets):
            parts = [socket.partition(".") for socket in self.sockets]
            table = replace(table, other={"location": tuple(p[0] for p in parts), "socket": tuple(p[2] for p in parts)})
        write_measurements(folder / "plan.csv", table, chain.prismatic)


def sockets_of(rows: Measurements, at: Sequence[int]) -> tuple[str, ...]:
    """Return the name of the socket of some rows, "" where the file names none."""
    none = ("",) * len(rows)
    cells = [rows.other.get(column, none) for column in ("location", "socket")]
    return tuple(".".join(filter(None, (column[row] for column in cells))) for row in at)


def placed_by(arm: RigidArm, values: Array, joints: Array, sockets: Sequence[str]) -> tuple[Array, dict[str, Array]]:
    """Place ball and sockets by touches: return the parameters with the ball, and the centre ``(3,)`` m of each socket.

    Args:
        values: ``(p,)`` the calibrated arm's.
        joints: ``(m, joints)`` of the touches.
        sockets: ``(m,)`` name of the socket of each.
    """
    values, at_ball = values.copy(), ball_columns(arm)
    points, jacobian = arm.observe(joints, values)
    names, m = list(dict.fromkeys(sockets)), len(joints)
    placing = np.zeros((m, 3, 3 + 3 * len(names)))
    placing[:, :, :3] = jacobian[:, 0][..., at_ball]
    for row, name in enumerate(sockets):
        placing[row, :, 3 + 3 * names.index(name) :][:, :3] = -np.eye(3)
    placed = -np.linalg.lstsq(placing.reshape(3 * m, -1), points[:, 0].ravel())[0]  # the ball's move, the sockets
    values[at_ball] += placed[:3]
    return values, dict(zip(names, placed[3:].reshape(-1, 3), strict=True))


def ball_columns(arm: RigidArm) -> list[int]:
    """Return the indices of the ball's place on the tool: that of the first target."""
    return [arm.names.index(f"tool.{arm.targets[0]}.{axis}") for axis in "xyz"]


def planned(
    options: VerifyOptions, calibrated: CalibrationRun, rows: Measurements, near: Array, warnings: tuple[str, ...]
) -> TouchPlan:
    """Choose configurations at the sockets that the rows touch.

    Four touches or more place ball and sockets; with fewer the ball is where the run has its first target.

    Args:
        rows: touches of each socket, one at least.
        near: ``(joints,)`` distance (rad or m) within which two configurations are the same.

    Raises:
        LabError: the touches of a socket are not at one place, or the arm reaches it in too few configurations.
    """
    (arm, values), chain, count = calibrated.estimate.geometry, calibrated.robot.chain, options.plan
    assert count is not None
    labels, rng = sockets_of(rows, range(len(rows))), rng_for(0, "poses")
    points = arm.points(rows.joints, values)[:, 0]
    centres = {name: points[[each == name for each in labels]].mean(axis=0) for name in dict.fromkeys(labels)}
    if len(rows) >= LEAST_CONFIGURATIONS:
        values, centres = placed_by(arm, values, rows.joints, labels)
        points = arm.points(rows.joints, values)[:, 0]
    off = np.linalg.norm(points - np.array([centres[name] for name in labels]), axis=1)
    if off.max() > _APART_M:
        raise LabError(
            f"{rows.where(int(off.argmax()))}: {MM.of(off.max()):.0f} mm from where the other touches have socket "
            f"'{labels[int(off.argmax())]}'; name each socket in the column socket, or mend the row"
        )
    joints, names = list[Array](), list[str]()
    for name, centre in centres.items():
        found = _touching(calibrated, arm, values, centre, near)
        joints.append(found)
        names += [name] * len(found)
        if len(found) * len(centres) < count:
            raise LabError(
                f"the arm touches socket '{name}' in {counted(len(found), 'distinct configuration')} without a "
                f"collision, of {count} wanted: put it elsewhere, or give a smaller --plan"
            )
    every = np.concatenate(joints)
    by_joint = by_joint_positions(arm, every, values, chain.size)[:, 0]
    there, slopes = arm.observe(every, values)
    chosen, share = best_configurations(
        chain.joint_names, by_joint, slopes[:, 0][..., ball_columns(arm)], there[:, 0], count, rng, names
    )
    return TouchPlan(
        options, calibrated, every[chosen], tuple(names[i] for i in chosen), share, (*calibrated.warnings, *warnings)
    )


def _touching(calibrated: CalibrationRun, arm: RigidArm, values: Array, centre: Array, near: Array) -> Array:
    """Return distinct joint positions ``(n, joints)`` at a socket, within the limits and without a collision."""
    chain, model, rng = calibrated.robot.chain, calibrated.robot.model, rng_for(1, "poses")
    found = np.empty((0, chain.size))

    def gaps(joints: Array, _: NDArray[np.int_]) -> Array:
        return np.asarray(arm.points(joints, values)[:, 0] - centre)

    for _ in range(_ROUNDS):
        rows = np.arange(_DRAWN)
        tried = without_gaps(gaps, chain.random_joints(_DRAWN, rng), rows)
        good = (np.abs(gaps(tried, rows)).max(axis=1) < _TOUCHING_M) & ~chain.beyond_limits(tried, 0.0).any(axis=1)
        tried = tried[good]
        for row in tried[~collides(model, tried)]:
            if not len(found) or ((np.abs(found - row) / near).max(axis=1) > _DISTINCT).all():
                found = np.concatenate([found, row[None]])
        if len(found) >= _CHOICES:
            break
    return found[:_CHOICES]
