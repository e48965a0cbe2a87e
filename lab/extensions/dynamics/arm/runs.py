"""A run of an arm as few independent rows: torques, and the columns of its parameters, through one and the same filter.

The regressor is worked out at the file's own rate, from positions that are smoothed and differentiated there, and only
then filtered and thinned as the torques are (``payload_identification.filtering``): friction that changes its sign
between two kept rows passes the filter as the torque did. Long runs are worked out part by part.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.dynamics.arm.base_parameters import BaseParameters
from lab.extensions.dynamics.filtering import BAND_HZ, Band, band_of
from lab.extensions.dynamics.load_samples import PayloadSamples
from lab.kinematics.dynamics.arm_dynamics import ArmDynamics, flange_in_last_link, load_in_frame
from lab.kinematics.dynamics.rigid_body import LOAD
from lab.kinematics.serial.chain import Chain

__all__ = ["DynamicModel", "ThinnedRun", "thinned_run"]

_PART = 4000  # rows of a file that are worked out at a time
_STILL = 1e-3  # rad or m
_BETWEEN = 8  # kept rows between two parts of a run, so that no filter reaches from one into the other


@dataclass(frozen=True)
class DynamicModel:
    """What is fitted.

    Attributes:
        chain: as the robot's table has it; a load is about its last frame, the flange.
        arm: the inverse dynamic model.
        base: its base parameters.
    """

    chain: Chain
    arm: ArmDynamics
    base: BaseParameters

    @cached_property
    def _load(self) -> Array:
        """The parameters ``(10, 10)`` of the last link that a load at the flange is."""
        return load_in_frame(flange_in_last_link(self.chain))

    def columns(self, joints: Array, speeds: Array, accelerations: Array) -> Array:
        """``(n, J, 10 + b)``: of a load at the flange, and of the base parameters."""
        standard = self.arm.regressor(joints, speeds, accelerations)
        load = standard[..., self.arm.bodies()[-1]] @ self._load
        return np.concatenate([load, standard[..., self.base.kept]], axis=2)

    def torques(self, values: Array, motion: tuple[Array, Array, Array]) -> Array:
        """The drives' torques ``(n, J)`` by base parameters ``(b,)`` along a motion, part by part."""
        joints, speeds, accelerations = motion
        found = np.empty_like(joints)
        for first in range(0, len(joints), _PART):
            at = slice(first, first + _PART)
            regressor = self.arm.regressor(joints[at], speeds[at], accelerations[at])
            found[at] = regressor[..., self.base.kept] @ values
        return found


@dataclass(frozen=True)
class ThinnedRun:
    """One run.

    Attributes:
        loaded: whether it carried the load.
        band: how it was thinned.
        columns: ``(3, k, J, 10 + b)``, those of ``DynamicModel`` with their first two derivatives in time.
        torques: ``(n, J)`` as recorded, at the rows of ``motion``.
        speeds: ``(n, J)``.
        start_s: of the file's first row.
        first, last: of the kept rows, those that count.
    """

    loaded: bool
    band: Band
    columns: Array
    torques: Array
    speeds: Array
    start_s: float
    first: int = 0
    last: int | None = None

    def measured(self, late_s: float = 0.0) -> Array:
        """The torques ``(k, J)``, if they are so much later than the positions."""
        return self.band.kept(self.torques, late_s)[self.first : self.last]

    def rows(self, order: int = 0) -> Array:
        """The columns ``(k, J, 10 + b)``, or their derivative in time."""
        rows: Array = self.columns[order, self.first : self.last]
        return rows

    def times(self) -> Array:
        """``(k,)`` s, of the kept rows."""
        band, count = self.band, self.columns.shape[1]
        middle = band.margin + (len(band.impulse) - 1) / 2 + band.every * np.arange(count)
        return np.asarray(self.start_s + band.step_s * middle[self.first : self.last])

    def thinned(self, values: Array) -> Array:
        """Anything at the rows of ``motion`` ``(n, ...)``, thinned."""
        return self.band.kept(values)[self.first : self.last]

    def split(self, share: float) -> tuple["ThinnedRun", "ThinnedRun"]:
        """The beginning of the run, and the share of it at its end.

        Raises:
            LabError: one of them would have too few rows.
        """
        count = self.columns.shape[1]
        cut = round(count * (1 - share))
        if cut - _BETWEEN < 2 or count - cut < 2:
            raise LabError(f"a run of {count} independent rows cannot be held out by {share:g}: record a longer one")
        return replace(self, last=cut - _BETWEEN), replace(self, first=cut)


def thinned_run(model: DynamicModel, samples: PayloadSamples, loaded: bool, band_hz: float = BAND_HZ) -> ThinnedRun:
    """One of the runs of a file.

    Raises:
        LabError: there are no torques or times, nothing moves, or the run is too short.
    """
    run = samples.run(loaded)
    if run.torques is None or run.time_s is None:
        raise LabError("an arm is identified from torques along a motion: give time_s and the torques of every joint")
    if float(np.ptp(run.joints, axis=0).max()) < _STILL:
        raise LabError("the joints stand still: an arm's dynamics show in a motion alone")
    band = band_of(run.time_s, band_hz)
    motion = band.motion(run.joints)
    reach = len(band.impulse)
    count = 1 + (len(motion[0]) - reach) // band.every
    step, parts = max(1, _PART // band.every), []
    for first in range(0, count, step):
        last = min(first + step, count)
        at = slice(first * band.every, (last - 1) * band.every + reach)
        columns = model.columns(*(each[at] for each in motion))
        parts.append(np.array([band.kept(columns, order=order) for order in range(3)]))
    columns = np.concatenate(parts, axis=1)
    assert columns.shape[3] == len(LOAD) + model.base.size
    return ThinnedRun(loaded, band, columns, band.trimmed(run.torques), motion[1], float(run.time_s[0]))
