"""What was read with and without a load at the hand: joint readings with torques, a wrist sensor's wrench, or both."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.copies import copied_rows, said_of_copies
from lab.core.errors import LabError
from lab.core.ranges import EARTH_GRAVITY
from lab.core.se3 import Array

__all__ = ["GRAVITY", "Mounting", "PayloadSamples"]

GRAVITY = 9.81  # m/s^2, where a file does not say
_TURNED = 1e-9  # of a rotation: how far from orthonormal


@dataclass(frozen=True)
class PayloadSamples:
    """Rows of a loaded and an unloaded run, in the order of the file.

    Attributes:
        time_s: ``(n,)``, evenly spaced within each run; None of static poses.
        joints: ``(n, J)`` readings, rad or m.
        torques: ``(n, J)`` of the joints, Nm (N of a slide), positive where they push the reading up; or None.
        wrench: ``(n, 6)`` as the sensor gives it, in its axes and about the last frame's origin, N and Nm; or None.
        loaded: ``(n,)`` whether the load was at the hand.
        currents: whether ``torques`` are the motors' currents, A.
        lines: of the file, as an editor counts them, one a row; empty where there is no file.
        warnings: what a reader should be told.
    """

    time_s: Array | None
    joints: Array
    torques: Array | None
    wrench: Array | None
    loaded: NDArray[np.bool_]
    lines: tuple[int, ...] = ()
    warnings: tuple[str, ...] = ()
    currents: bool = False

    def __post_init__(self) -> None:
        n, size = self.joints.shape
        assert self.torques is not None or self.wrench is not None
        assert self.loaded.shape == (n,) and self.loaded.dtype == np.bool_ and len(self.lines) in (0, n)
        for values, shape in ((self.time_s, (n,)), (self.torques, (n, size)), (self.wrench, (n, 6))):
            assert values is None or (values.shape == shape and np.isfinite(values).all())
        assert np.isfinite(self.joints).all()

    def __len__(self) -> int:
        return len(self.joints)

    @property
    def step_s(self) -> float | None:
        """The time step of the loaded run (of the other where it is missing); None of static poses."""
        if self.time_s is None:
            return None
        times = self.time_s[self.loaded] if self.loaded.any() else self.time_s
        return float((times[-1] - times[0]) / (len(times) - 1))

    def without_copies(self, source: object) -> "PayloadSamples":
        """Static rows that do not repeat an earlier one to the last digit, with a warning of the others.

        A copy would count as a measurement of its own, and make intervals too narrow.
        """
        if self.time_s is not None:
            return self
        measured = [each for each in (self.torques, self.wrench) if each is not None]
        copies = copied_rows(np.column_stack([self.joints, *measured, self.loaded]))
        if not copies:
            return self
        lines = self.lines or tuple(range(len(self)))
        said = said_of_copies(source, len(copies), *(f"line {lines[row]}" for row in copies[0]))
        kept = self.take(np.setdiff1d(np.arange(len(self)), [row for row, _ in copies]))
        return replace(kept, warnings=(*kept.warnings, f"{said}: left out"))

    def run(self, loaded: bool) -> "PayloadSamples":
        """The rows of one run."""
        return self.take(np.flatnonzero(self.loaded == loaded))

    def take(self, rows: NDArray[np.int_]) -> "PayloadSamples":
        """Some rows."""
        return replace(
            self,
            time_s=None if self.time_s is None else self.time_s[rows],
            joints=self.joints[rows],
            torques=None if self.torques is None else self.torques[rows],
            wrench=None if self.wrench is None else self.wrench[rows],
            loaded=self.loaded[rows],
            lines=tuple(self.lines[i] for i in rows.tolist()) if self.lines else (),
        )


@dataclass(frozen=True)
class Mounting:
    """How the arm and the wrist sensor are set up.

    Attributes:
        gravity: ``(3,)`` m/s^2 in frame 0.
        sign: +1 where the sensor reads what the hand does to the load, -1 where it reads what the load does to the
            hand, as most do.
        rotation: ``(3, 3)`` of the sensor's axes in the last frame; its origin is the last frame's.
    """

    gravity: Array
    sign: float = 1.0
    rotation: Array = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        size = float(np.linalg.norm(self.gravity))
        if self.gravity.shape != (3,) or size not in EARTH_GRAVITY:
            raise LabError(f"gravity is {size:.4g} m/s^2; give {EARTH_GRAVITY.shown} (not mm)")
        if self.sign not in (1.0, -1.0):
            raise LabError(f"the sensor's sign is {self.sign:g}; give 1 or -1")
        off = np.abs(self.rotation @ self.rotation.T - np.eye(3)).max() if self.rotation.shape == (3, 3) else np.inf
        if not off < _TURNED or np.linalg.det(self.rotation) < 0:
            raise LabError("the sensor's mounting is no rotation; give an orthonormal (3, 3) matrix")

    @classmethod
    def tilted(
        cls, tilt_rad: Array, gravity: float = GRAVITY, sign: float = 1.0, turn_rad: Array | None = None
    ) -> "Mounting":
        """An arm whose base is tilted, with its sensor turned.

        Args:
            tilt_rad: ``(2,)``, angles about x and y of frame 0, together one rotation vector: how frame 0 is turned
                out of where its z points up.
            gravity: m/s^2.
            turn_rad: ``(3,)``, a rotation vector from the last frame to the sensor.

        Raises:
            LabError: the gravity is not one that there is on Earth.
        """
        if gravity < 0:
            raise LabError(f"gravity is {gravity:g} m/s^2; give its size, {EARTH_GRAVITY.shown}")
        down = np.array([0.0, 0.0, -gravity])
        leaning = se3.exp(np.append(tilt_rad, 0.0))
        return cls(leaning.T @ down, sign, np.eye(3) if turn_rad is None else se3.exp(turn_rad))

    @property
    def tilt_rad(self) -> Array:
        """``(2,)``, the angles of ``tilted`` that give this gravity."""
        x, y, z = -self.gravity / np.linalg.norm(self.gravity)  # what is up, in frame 0: R'z with R = exp(tilt)
        sine = np.hypot(x, y)
        if sine == 0.0:
            return np.array([0.0 if z > 0 else np.pi, 0.0])
        tilt: Array = np.arctan2(sine, z) * np.array([y, -x]) / sine
        return tilt
