"""Measure with cameras: places of corners of boards in pictures, taken by the arm or of it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from lab.calibration.identification import Identification
from lab.calibration.sensor import SensorTerms
from lab.calibration.weights import Noise
from lab.core import se3
from lab.core.errors import LabError, counted, option_name
from lab.core.limits import positive
from lab.core.measurements import FIXTURE, Measurements, evenly
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.diagnosis.hypothesis import Hypothesis
from lab.extensions.cameras.board_observation import Pixels
from lab.extensions.cameras.camera_simulation import simulated_corners
from lab.extensions.cameras.detection import detected, picture_of
from lab.extensions.cameras.picture_mistakes import Pictures, picture_mistakes, placed_pictures
from lab.extensions.cameras.picture_planning import PlannedPictures
from lab.extensions.cameras.rig import PX, Rig, read_rig, usual_rig
from lab.formats.measurement_csv import ObservedColumns
from lab.kinematics.model import Model, RigidArm
from lab.kinematics.serial.axes_to_dh import Truth
from lab.kinematics.serial.serial_arm import SerialArm
from lab.sensors.sensor_options import CameraOptions, FitInputs, VirtualSetup
from lab.sensors.size import PRINTED, stated_size_u
from lab.sensors.virtual_sensor import SimulatedReadings, VirtualSensor
from lab.simulation.effects import TrueEffects
from lab.simulation.robot_model import RobotModel
from lab.simulation.tracking import VirtualMeasurement, target_rotations
from lab.simulation.true_robot import TrueRobot

__all__ = ["PixelSensor"]

_TEXTS = ("camera", "board", "corner", "image")
_NUMBERS = ("u_px", "v_px", "sigma_px")
_NEAR_ROWS = 400
_MOST_NAMED = 5  # pictures in a warning


def _without_board(pictures: list[str], count: int) -> list[str]:
    """Warn of pictures without a board, of so many."""
    named = ", ".join(pictures[:_MOST_NAMED])
    return [f"no board is found in {len(pictures)} of {count} pictures ({named})"] if pictures else []


@dataclass(frozen=True)
class PixelSensor(VirtualSensor):
    """Corners of boards in pictures.

    Attributes:
        rig: cameras and boards.
        noise_px: noise of a coordinate (1 sigma); None to estimate it from the residuals.
    """

    name: ClassVar[str] = "pixels"
    terms: ClassVar[SensorTerms] = SensorTerms(
        measured="corners of boards in pictures",
        reading="corner in a picture",
        error="error across the line of sight",
        placed="cameras and boards",
        names_targets=False,
        unit=PX,
    )
    columns: ClassVar[ObservedColumns] = ObservedColumns(
        positions=False, numbers=_NUMBERS, texts=_TEXTS, observed="pixels"
    )
    flags: ClassVar[type[Any] | None] = CameraOptions
    in_instrument_frame: ClassVar[bool] = False
    several_a_pose: ClassVar[bool] = True

    rig: Rig = field(default_factory=usual_rig)
    noise_px: float | None = None

    @classmethod
    def configured(cls, options: CameraOptions, fit: FitInputs) -> Self:
        """Return the sensor of the cameras and boards of a file; without one, of one camera in the hand and one board.

        Raises:
            LabError: the file makes no sense, a noise is not above zero, an uncertainty is below, or an option of
                points is given.
        """
        fit.refuse_those_of_points(cls.name)
        if fit.noise_mm is not None:
            raise LabError(f"{option_name('noise_mm')} is of lengths; give {option_name('noise_px')}, or leave it out")
        if options.noise_px is not None:
            positive(option_name("noise_px"), options.noise_px)
        rig = usual_rig() if options.cameras is None else read_rig(options.cameras)
        stated_size_u(options.size_u_percent, PRINTED)
        return cls(rig.of_size(options.size_u_percent), options.noise_px)

    def targets(self, data: Measurements) -> tuple[str, ...]:
        """Return the targets of the tips that carry cameras and boards."""
        return self.rig.targets

    def with_files(self, data: Measurements, folder: Path) -> Measurements:
        """Return the corners that OpenCV finds in the pictures of a column ``image``, a row each.

        Raises:
            LabError: a picture cannot be read, no board is found in any, or OpenCV is not installed.
        """
        if "image" not in data.other or "u_px" in data.conditions:
            return data
        pictures = data.other["image"]
        wanted = [i for i, name in enumerate(pictures) if name and data.use[i] != "skip"]
        corners = list(self._corners_in(folder, pictures, wanted))
        if not corners:
            raise LabError(f"no board is found in any of {counted(len(wanted), 'picture')}: check the boards' kinds")
        # a row a corner, with its place in the picture
        rows, boards, numbers, places = zip(*corners, strict=True)
        part, corners_px = data[list(rows)], np.array(places)
        empty = [pictures[row] for row in wanted if row not in rows]
        return replace(
            part,
            ids=tuple(map(":".join, zip(part.ids, boards, numbers, strict=True))),
            other={**part.other, "board": boards, "corner": numbers},
            conditions={**part.conditions, "u_px": corners_px[:, 0], "v_px": corners_px[:, 1]},
            warnings=(*part.warnings, *_without_board(empty, len(wanted))),
        )

    def _corners_in(
        self, folder: Path, pictures: Sequence[str], rows: Sequence[int]
    ) -> Iterator[tuple[int, str, str, Array]]:
        """Yield row, board, number and place ``(2,)`` px of the corners in the pictures of some rows."""
        for row in rows:
            picture = picture_of(folder / pictures[row])
            for board in self.rig.boards:
                numbers, places = detected(picture, board)
                for number, place in zip(numbers.tolist(), places, strict=True):
                    yield row, board.name, str(number), place

    def noise(self, given: Noise) -> Noise:
        """Return the noise of a corner: the given one, else none, so that it is estimated."""
        sigma = None if self.noise_px is None else float(PX.to_si(self.noise_px))
        return replace(given, instrument=None, sigma_m=sigma)

    def rows(self, data: Measurements) -> NDArray[np.bool_]:
        """Return the rows ``(n,)`` with a place in a picture."""
        none = np.full(len(data), np.nan)
        return np.asarray(
            np.isfinite(data.conditions.get("u_px", none)) & np.isfinite(data.conditions.get("v_px", none))
        )

    def observation(self, arm: Model, data: Measurements, nominal: Array) -> tuple[Model, Measurements]:
        """Return the model of the cameras and boards that the rows see, and these rows.

        Raises:
            LabError: a column is missing, or a cell names no camera, board or corner.
        """
        for column in ("u_px", "v_px"):
            if column not in data.conditions:
                raise LabError(f"column {column} is missing: {option_name('observe')} pixels needs u_px and v_px")
        rows = np.flatnonzero(self.rows(data) & data.used)
        if not len(rows):
            raise LabError("no row has a place in a picture: fill in u_px and v_px")
        part = data[rows]
        number = self._numbers(part)
        places = PX.to_si(np.column_stack([part.conditions["u_px"], part.conditions["v_px"]]))
        sigma = part.sigma_m
        if "sigma_px" in part.conditions:
            sigma = np.asarray(PX.to_si(part.conditions["sigma_px"]))
            if (bad := np.flatnonzero(sigma <= 0)).size:
                raise LabError(f"{part.where(int(bad[0]))}, column sigma_px: not above zero; give the noise")
        order = np.argsort(_pose_numbers(part.joints), kind="stable")
        some = evenly(len(rows), _NEAR_ROWS)
        observed = replace(
            part,
            targets=("corner",),
            points=places[:, None],
            sigma_m=sigma,
            conditions={**part.conditions, FIXTURE: number.astype(np.float64)},
        )[order]
        camera, board, _ = self.rig.parts(number)
        seen = tuple(np.unique(camera).tolist()), tuple(np.unique(board).tolist())
        whole = Pixels(arm, self.rig, seen, np.empty((0, 0)))
        inputs = observed.inputs(whole.conditions)
        near = rng_for(0, "structure").permutation(inputs)
        near = near if some is None else near[: len(some)]
        return replace(whole, near=near), observed

    def _numbers(self, data: Measurements) -> NDArray[np.int_]:
        """Return the number ``(n,)`` of each row's corner in the rig.

        Raises:
            LabError: a column is missing where there are several, or a cell names none of them.
        """
        names = dict[str, NDArray[np.int_]]()
        for column, parts in (("camera", self.rig.cameras), ("board", self.rig.boards)):
            names[column] = _named(data, column, [part.name for part in parts])
        if "corner" not in data.other:
            raise LabError(f"column corner is missing: {option_name('observe')} pixels needs the number of each corner")
        number = np.zeros(len(data), dtype=np.int_)
        for row, text in enumerate(data.other["corner"]):
            board = self.rig.boards[names["board"][row]]
            if not (text.isascii() and text.isdigit() and len(text) < 7 and int(text) < len(board)):
                raise LabError(
                    f"{data.where(row)}, column corner: '{text}' is no corner of board {board.name}; give a whole "
                    f"number from 0 to {len(board) - 1}"
                )
            number[row] = self.rig.number(int(names["camera"][row]), int(names["board"][row]), int(text))
        return number

    def pictures(self, data: Measurements) -> Pictures:
        """Return the pictures in measurements, as they were first read: joint positions do not change them.

        Raises:
            LabError: a column is missing, or a cell names no camera, board or corner.
        """
        numbers = tuple(data.conditions.get(name) for name in ("u_px", "v_px"))
        texts = tuple(data.other.get(name) for name in ("camera", "board", "corner"))
        return _pictures_of(self.rig, _Places(data, (*numbers, *texts)))

    def misses(self, arm: Model, data: Measurements, nominal: Array) -> Array:
        """Return how far ``(n,)`` the nominal arm misses each picture (m), in its first row; NaN in the others."""
        pictures = self.pictures(data)
        misses = np.full(len(data), np.nan)
        misses[pictures.first] = placed_pictures(self.rig, pictures, arm, data, nominal).misses
        return misses

    def mistakes(self, arm: RigidArm, data: Measurements) -> tuple[Hypothesis, ...]:
        """Return what may be wrong with pictures, cameras and boards."""
        placed = placed_pictures(self.rig, self.pictures(data), arm, data, arm.nominal())
        return tuple(picture_mistakes(self, placed, data))

    def simulate(self, poses: VirtualMeasurement, setup: VirtualSetup) -> SimulatedReadings:
        """Take pictures in as many poses as are given, which are new ones that see a board."""
        return simulated_corners(self.rig, poses)

    def planned(self, robot: RobotModel) -> PlannedPictures:
        """Return the pictures that the nominal arm takes, with cameras and boards where their file places them."""
        return PlannedPictures.of(self.rig, robot)

    def observed_truth(
        self, truth: Truth, found: Identification, real: TrueRobot, placed: Mapping[str, Array]
    ) -> Truth | None:
        """Return the truth with the base at the origin, and cameras and boards there or in the last frame.

        None for a mechanism, and where the size of a board is unknown, so that the arm's size is.
        """
        model = found.model
        assert isinstance(model, Pixels)
        if not isinstance(truth.arm, SerialArm) or model.unsized:
            return None
        T_base_world = se3.inverse(truth.arm.T_tracker_frame0(truth.values))
        known = self.placed_truth(model, truth, real, placed, T_base_world)
        values = truth.values.copy()
        values[:6] = 0.0
        return replace(truth, values=values, effects={**truth.effects, **known})

    def placed_truth(
        self, model: Model, truth: Truth, real: TrueRobot, placed: Mapping[str, Array], T_frame_instrument: Array
    ) -> dict[str, float]:
        """Return cameras and boards: of the world in the frame of the parameters, of a tip in the arm's last frame."""
        assert isinstance(model, Pixels) and isinstance(truth.arm, SerialArm)
        known, rest = dict[str, float](), np.zeros((1, real.robot.chain.size))
        still = real.with_effects(TrueEffects.none(real.robot.chain.size))
        last = truth.arm.flange(rest, truth.values)[0]
        for kind, parts in (("camera", model.cameras), ("board", model.boards)):
            for part in parts:
                own = placed[f"{kind}.{part.what.name}"].copy()
                T_reference = T_frame_instrument
                if part.mount is not None:
                    target = model.arm.targets[part.mount]
                    turn = target_rotations(still, rest, target)[0]
                    T_reference = se3.inverse(last) @ se3.pose(turn, still.points(rest, (target,))[0, 0])
                T = T_reference @ se3.pose(se3.exp(own[3:6]), own[:3])
                own[:6] = [*T[:3, 3], *se3.log(T[:3, :3])]
                names = model.names[part.first : part.first + 6 + part.more]
                known |= dict(zip(names, own[: len(names)].tolist(), strict=True))
        return known


@dataclass(frozen=True, eq=False)
class _Places:
    """Places in pictures: alike where the same objects hold them, whatever the joint positions."""

    data: Measurements
    held: tuple[object, ...]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Places) and all(a is b for a, b in zip(self.held, other.held, strict=True))

    def __hash__(self) -> int:
        return hash(tuple(map(id, self.held)))


@lru_cache(maxsize=8)
def _pictures_of(rig: Rig, places: _Places) -> Pictures:
    sensor, data = PixelSensor(rig), places.data
    seen = sensor.rows(data)
    rows = np.flatnonzero(seen)
    if not len(rows):
        raise LabError("no row has a place in a picture: fill in u_px and v_px")
    numbers = np.zeros(len(data), dtype=np.int_)
    numbers[rows] = sensor._numbers(data[rows])
    return Pictures.of(rig, data, numbers, seen)


def _named(data: Measurements, column: str, names: list[str]) -> NDArray[np.int_]:
    """Return which camera or board ``(n,)`` each row names; the only one where the column is missing.

    Raises:
        LabError: there are several and the column is missing, or a cell names none.
    """
    if column not in data.other:
        if len(names) == 1:
            return np.zeros(len(data), dtype=np.int_)
        raise LabError(f"column {column} is missing: there are {counted(len(names), column)}, {', '.join(names)}")
    at = {name: i for i, name in enumerate(names)}
    for row, name in enumerate(data.other[column]):
        if name not in at:
            raise LabError(
                f"{data.where(row)}, column {column}: '{name}' is unknown; there are {', '.join(names)} "
                "(a file of cameras and boards describes others)"
            )
    return np.array([at[name] for name in data.other[column]], dtype=np.int_)


def _pose_numbers(joints: Array) -> NDArray[np.int_]:
    """Return the number ``(n,)`` of each row's pose, in the order of their first rows."""
    _, first, pose = np.unique(joints, axis=0, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first, kind="stable"), kind="stable")[pose]
