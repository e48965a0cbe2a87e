"""Predict what pictures show of an arm: which poses show enough corners, and the derivatives of these."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError, option_name
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.cameras.board_observation import Pixels
from lab.extensions.cameras.camera_simulation import CameraArm, CameraScene, corner_noise_px, placed_scene
from lab.extensions.cameras.rig import PX, Board, Camera, Rig
from lab.kinematics.serial.serial_arm import SerialArm
from lab.sensors.tip import tip_frames
from lab.simulation.robot_model import RobotModel, SerialModel

__all__ = ["PlannedPictures"]

_BLOCK = 256  # poses whose derivatives are in memory at a time
_NEAR_ROWS = 400
_OF_PAIR = 6  # numbers that place a board before a camera


@dataclass(frozen=True)
class PlannedPictures:
    """Pictures of the nominal arm, with cameras and boards where their file places them.

    Attributes:
        scene: of the cameras and boards.
        arm: as they are placed by it.
        pixels: the model of all cameras and boards.
        values: its parameters ``(p,)`` there.
    """

    scene: CameraScene
    arm: CameraArm
    pixels: Pixels
    values: Array

    @classmethod
    def of(cls, rig: Rig, robot: RobotModel) -> Self:
        """Place cameras and boards as their file says.

        All boards count as exact: no pose changes what is known of a board's size.

        Raises:
            LabError: the robot has loops, or the file does not place all of them.
        """
        if not isinstance(robot, SerialModel):
            raise LabError(f"{option_name('observe')} pixels: a design needs a serial arm; measure points instead")
        parts: tuple[Camera | Board, ...] = (*rig.cameras, *rig.boards)
        for part in parts:
            if part.T_mount is None:
                kind = "camera" if isinstance(part, Camera) else "board"
                raise LabError(
                    f"{rig.source or option_name('observe') + ' pixels'}: {kind} {part.name} has no place, and a "
                    f"design needs one; give position_mm and rotation_deg in the file of {option_name('cameras')}"
                )
        rig = replace(rig, boards=tuple(replace(each, size_u_percent=0.0) for each in rig.boards))
        arm = CameraArm(robot, robot.T_world_tracker, rig.targets)
        scene = placed_scene(rig, arm)
        serial = SerialArm(robot.chain, arm.targets)
        everything = tuple(range(len(rig.cameras))), tuple(range(len(rig.boards)))
        pixels = Pixels(serial, rig, everything, np.empty((0, 0)))
        values = pixels.nominal(robot.values_before(serial, arm.T_world_instrument))
        rest = robot.chain.home[None]
        placings = (*zip(pixels.cameras, scene.cameras, strict=True), *zip(pixels.boards, scene.boards, strict=True))
        for own, T in placings:
            placed = T
            if own.mount is not None:
                origin, turn = tip_frames(serial, rest, values[: len(serial.names)], own.mount)[:2]
                placed = np.asarray(se3.inverse(se3.pose(turn[0], origin[0])) @ arm.tips(rest)[0, own.mount] @ T)
            values[own.pose] = [*placed[:3, 3], *se3.log(placed[:3, :3])]
        planned = cls(scene, arm, pixels, values)
        if not rig.pairs:
            raise LabError(
                f"{rig.source}: no camera moves against a board; fix one of them to hand, the other to world"
            )
        return planned

    @property
    def noise(self) -> str:
        """Noise of a corner in focus, in words."""
        return f"corners with {self.scene.rig.simulated.noise_px:g} px"

    def near(self, joints: Array) -> Pixels:
        """Return the model whose structure is decided near some poses ``(n, joints)`` in sight."""
        row, number, _ = self._visible(joints)
        some = rng_for(0, "structure").permutation(len(row))[:_NEAR_ROWS]
        return replace(self.pixels, near=np.column_stack([joints[row[some]], number[some]]))

    def sees(self, joints: Array) -> NDArray[np.bool_]:
        """Return whether a picture at poses ``(n, joints)`` shows enough corners of a board."""
        return self.counts(joints) > 0

    def counts(self, joints: Array) -> NDArray[np.int_]:
        """Return the number ``(n,)`` of corners that the pictures at poses ``(n, joints)`` show."""
        return np.bincount(self._visible(joints)[0], minlength=len(joints))

    def readings(self, joints: Array, retained: tuple[int, ...]) -> Array:
        """Return derivatives ``(n, r, f)`` of all corners in sight, in units of their noise, by f parameters.

        The corners of a board in a picture depend on no more than where it is before the camera, beside the lens and
        the board's size: r rows have the information of all corners.
        """
        found = np.zeros((len(joints), self._rows(len(retained)), len(retained)))
        for first in range(0, len(joints), _BLOCK):
            some = joints[first : first + _BLOCK]
            row, number, distance = self._visible(some)
            _, jacobian = self.pixels.observe(np.column_stack([some[row], number]), self.values)
            noise = PX.to_si(corner_noise_px(self.scene.rig.simulated, distance))
            whitened = jacobian[:, 0][..., list(retained)] / noise[:, None, None]
            for pose in np.unique(row).tolist():
                _, sizes, directions = np.linalg.svd(
                    whitened[row == pose].reshape(-1, len(retained)), full_matrices=False
                )
                rows = min(len(sizes), found.shape[1])
                found[first + pose, :rows] = sizes[:rows, None] * directions[:rows]
        return found

    def _rows(self, parameters: int) -> int:
        lens = sum(part.more for part in self.pixels.cameras)
        pairs = [(a, b) for a in self.pixels.cameras for b in self.pixels.boards]
        return min(parameters, sum(_OF_PAIR + b.more for _, b in pairs) + lens)

    def _visible(self, joints: Array) -> tuple[NDArray[np.int_], NDArray[np.int_], Array]:
        """Return each corner in sight, in the order of the poses: its pose, number, and distance (m)."""
        tips, need = self.arm.tips(joints), self.scene.rig.simulated.corners
        rows, numbers, distances = list[NDArray[np.int_]](), list[NDArray[np.int_]](), list[Array]()
        for camera, board in self.scene.rig.pairs:
            _, inside, corners, origins = self.scene.visible(camera, board, self.arm, joints, tips)
            inside &= (inside.sum(axis=1) >= need)[:, None]
            row, corner = np.nonzero(inside)
            rows.append(row)
            numbers.append(self.scene.rig.number(camera, board, 0) + corner)
            distances.append(np.linalg.norm(corners[row, corner] - origins[row], axis=1))
        row = np.concatenate(rows)
        order = np.argsort(row, kind="stable")
        return row[order], np.concatenate(numbers)[order], np.concatenate(distances)[order]
