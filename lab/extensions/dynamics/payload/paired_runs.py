"""A loaded and an unloaded run, filtered alike and thinned: what is compared, and what it is compared with."""

from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.dynamics.filtering import SETTLING_S, Band, Filter, band_of
from lab.extensions.dynamics.load_samples import PayloadSamples
from lab.kinematics.dynamics.rigid_body import Dynamics, torque_regressor
from lab.kinematics.serial.arm import SerialArm

__all__ = ["PairedRuns", "SharedFilter", "diagonal", "pair_runs", "refuse_apart", "same_step"]

_MOST_APART = 0.01  # rad or m root mean square: the weight of an arm's own links changes by half a Nm over that
_SAME_STEP = 0.01  # of a time step
_ROUNDING = 1e-9  # of a root mean square of some thousand readings
_PASSED = 1e-2  # of the power at rest: frequencies of which a filter has left less are not used


@dataclass(frozen=True)
class SharedFilter:
    """The one filter that torques and regressor pass.

    Attributes:
        came_through: what the torques had passed before they were recorded; all else passes its like here.
        whiten: ``(k, k)`` that makes noise white which has passed both, where there was such a filter.
        gain: standard deviation of a kept sample where that of a reading is one.
    """

    band: Band
    gain: float
    came_through: Filter | None = None
    whiten: Array | None = None

    def recorded(self, torques: Array, lead_s: float = 0.0) -> Array:
        """Torques ``(n, ...)`` as recorded, thinned; ``lead_s`` later than the rows' times."""
        return self._thinned(torques, lead_s, 0)

    def __call__(self, values: Array, order: int = 0) -> Array:
        """Anything computed from the positions ``(n, ...)``, thinned, or its derivative in time."""
        if self.came_through:
            values = self.came_through(values - values[0]) + values[0]
        return self._thinned(values, 0.0, order)

    def _thinned(self, values: Array, lead_s: float, order: int) -> Array:
        cut = round(SETTLING_S / self.band.step_s) if self.came_through else 0
        thin = self.band.kept(values[cut : len(values) - cut], lead_s, order)
        if self.whiten is None:
            return thin
        white: Array = np.tensordot(self.whiten, thin, axes=1)
        return white


def _passed_hz(came_through: Filter, step_s: float) -> float:
    """The frequency from which on a filter leaves too little of noise and signal for either to be told."""
    impulse = np.zeros(2 * round(SETTLING_S / step_s) + 1)
    impulse[len(impulse) // 2] = 1.0
    power = np.abs(np.fft.rfft(came_through(impulse))) ** 2
    if not (np.isfinite(power).all() and power[0] > 0):
        raise LabError("came_through: the filter lets no steady torque pass; give a low-pass")
    weak = np.flatnonzero(power < _PASSED * power[0])
    return float(np.fft.rfftfreq(len(impulse), step_s)[weak[0] if weak.size else -1])


def _common_of(band: Band, rows: int, came_through: Filter | None) -> SharedFilter:
    """The filter for runs of so many rows (those of ``Band.motion``).

    Noise that has passed ``came_through`` and the band's own kernel, with the response g to an impulse, has the
    autocorrelation g * g at the steps that are kept; the inverse of its Cholesky factor whitens it.
    """
    if came_through is None:
        return SharedFilter(band, float(np.linalg.norm(band.impulse)))
    settled = round(SETTLING_S / band.step_s)
    if rows < 4 * settled:
        raise LabError(f"the run is too short to let the filter settle: give at least {5 * SETTLING_S:g} s")
    impulse = np.zeros(2 * settled + 1)
    impulse[settled] = 1.0
    passed = came_through(impulse)
    response = np.convolve(passed, band.impulse)
    gain = float(np.linalg.norm(response) / np.linalg.norm(passed))
    kept = len(band.kept(np.zeros(rows - 2 * settled)))
    lags = np.correlate(response, response, "full")[len(response) - 1 :: band.every][:kept]
    lags = np.pad(lags, (0, kept - len(lags))) / (response @ response)
    factor = np.linalg.cholesky(scipy.linalg.toeplitz(lags))
    return SharedFilter(band, gain, came_through, scipy.linalg.solve_triangular(factor, np.eye(kept), lower=True))


@dataclass(frozen=True)
class PairedRuns:
    """The two runs at the file's step, but for what is thinned (k rows) already.

    Attributes:
        joints, direction: ``(n, J)`` readings of the loaded run, and the signs of their speeds.
        torque: ``(n, J)`` loaded less unloaded, as recorded.
        unloaded: ``(n, J)`` what the joints bear without the load: by the arm's own dynamics, or else as recorded.
        own: ``(k, J)`` the arm's own dynamics, loaded less unloaded; zero without them.
        regressor: ``(n, J, 10)``.
        thinned: ``(3, k, J, 10)``, the regressor with its first two derivatives in time.
        apart: ``(k, J, 3 J)`` columns of the two paths' differences in reading, speed and acceleration.
    """

    common: SharedFilter
    joints: Array
    direction: Array
    torque: Array
    unloaded: Array
    own: Array
    regressor: Array
    thinned: Array
    apart: Array

    def seen(self, late_s: float) -> Array:
        """What the load adds to the torques ``(k, J)``, if these are so much later than the positions."""
        return self.common.recorded(self.torque, late_s) - self.own

    def rubbing(self, phi: Array) -> Array:
        """Columns ``(3, k, J, J)`` of friction that grows with what a joint bears, and derivatives as of ``thinned``.

        (|loaded| - |unloaded|) sign(speed), where loaded is unloaded plus what the load found, ``phi``, would add:
        as recorded, its noise would be that of the difference which the columns are to explain.
        """
        more = np.abs(self.unloaded + self.regressor @ phi) - np.abs(self.unloaded)
        return np.array([diagonal(self.common(more * self.direction, order)) for order in range(3)])


def pair_runs(
    arm: SerialArm,
    values: Array,
    loaded: PayloadSamples,
    unloaded: PayloadSamples,
    gravity: Array,
    own: Dynamics | None,
    came_through: Filter | None, band_hz: float,
) -> PairedRuns:  # fmt: skip
    """Bring two runs together, row by row from their beginnings."""
    assert loaded.torques is not None and unloaded.torques is not None and loaded.time_s is not None
    n = min(len(loaded), len(unloaded))
    if came_through:
        band_hz = min(band_hz, _passed_hz(came_through, loaded.step_s or 0.0))
    band = band_of(loaded.time_s[:n], band_hz)
    same_step(band, unloaded)
    common = _common_of(band, n - 2 * band.margin, came_through)
    motion, other = (band.motion(run.joints[:n]) for run in (loaded, unloaded))
    refuse_apart(arm, motion[0] - other[0], own)
    regressor = torque_regressor(arm, values, *motion, gravity)
    alone = own(*other) if own else band.smoothed(unloaded.torques[:n])
    more = own(*motion) - alone if own else np.zeros_like(motion[0])
    apart = np.concatenate([diagonal(common(a - b)) for a, b in zip(motion, other, strict=True)], axis=2)
    return PairedRuns(
        common, motion[0], np.sign(motion[1]), band.trimmed(loaded.torques[:n] - unloaded.torques[:n]), alone,
        common(more), regressor, np.array([common(regressor, order) for order in range(3)]), apart,
    )  # fmt: skip


def same_step(band: Band, unloaded: PayloadSamples) -> None:
    """A LabError where the unloaded run has another time step than the loaded one's."""
    step = unloaded.step_s or 0.0
    if abs(step / band.step_s - 1) > _SAME_STEP:
        raise LabError(f"time steps of {band.step_s:g} s loaded and {step:g} s unloaded: give the same")


def refuse_apart(arm: SerialArm, difference: Array, own: Dynamics | None) -> None:
    """A LabError where readings differ ``(n, J)`` between the runs by more than can pass without the own dynamics."""
    apart = np.sqrt((difference**2).mean(axis=0))
    j = int(np.argmax(apart >= (1 - _ROUNDING) * apart.max()))  # the first of joints that are equally far apart
    if own is None and apart[j] > _MOST_APART:
        raise LabError(
            f"the loaded and the unloaded path are {arm.chain.shown(j, apart[j])} apart at joint "
            f"{arm.chain.joint_names[j]} (root mean square; {arm.chain.shown(j, _MOST_APART)} at most): repeat the "
            "same path, or have the arm's own dynamics subtracted"
        )


def diagonal(values: Array) -> Array:
    """Of ``(n, J)`` a column for each joint, in its own rows only: ``(n, J, J)``."""
    return values[:, :, None] * np.eye(values.shape[1])
