"""Filter and decimate a run to nearly independent samples, and differentiate its positions twice.

Torques and every column of the regressor pass the same linear filter of zero phase: a root of a raised cosine (roll-off
one), with one output every half period of its band. Its autocorrelation is zero at multiples of that step (Nyquist
1928), so white noise stays white: the effective number of samples is the number of outputs.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to

from lab.core.errors import LabError
from lab.core.se3 import Array

__all__ = ["BAND_HZ", "Band", "band_of"]

BAND_HZ = 20.0  # half power there, nothing from twice that on; a quick arm's torques change below 10 Hz
_MAX_BAND = 1 / 8  # of the sampling rate
_SPAN = 4  # half the kernel's length in kept steps: neighbours correlate by 1e-3
_DEPTH_DB = 200.0  # of the low-pass before differentiation: speeds and accelerations to about 1e-9 of themselves
_FIRST = (5 / 6, -5 / 21, 5 / 84, -5 / 504, 1 / 1260)  # central differences of order ten, from the first neighbour on
_SECOND = (5 / 3, -5 / 21, 5 / 126, -5 / 1008, 1 / 3150)


@dataclass(frozen=True)
class Band:
    """Decimation filter of a run of evenly timed samples.

    Attributes:
        step_s: of the file.
        every: number of samples for each one retained.
    """

    step_s: float
    every: int

    @property
    def hz(self) -> float:
        """Bandwidth: half the rate of the retained samples, where the filter passes half the power."""
        return 0.5 / (self.every * self.step_s)

    @property
    def margin(self) -> int:
        """Number of samples that differentiation leaves out at each end."""
        return (len(self._smooth()) - 1) // 2 + len(_FIRST)

    @property
    def impulse(self) -> Array:
        """Impulse response of the filter, at the file's step."""
        return self._kernel(0.0)

    def motion(self, joints: Array) -> tuple[Array, Array, Array]:
        """Return low-passed readings ``(n, J)``, speeds and accelerations, ``margin`` rows fewer at each end.

        The low-pass is flat up to twice the band, above which ``decimated`` passes nothing; derivatives are central
        differences of order ten.
        """
        smooth, start = self._smooth(), joints.mean(axis=0)
        kernels = (
            np.pad(smooth, len(_FIRST)),
            np.convolve(smooth, [*_FIRST[::-1], 0.0, *(-f for f in _FIRST)]) / self.step_s,
            np.convolve(smooth, [*_SECOND[::-1], -2 * sum(_SECOND), *_SECOND]) / self.step_s**2,
        )
        q, speed, acceleration = (scipy.signal.oaconvolve(joints - start, k[:, None], "valid", axes=0) for k in kernels)
        return q + start, speed, acceleration

    def smoothed(self, values: Array) -> Array:
        """Return values ``(n, ...)`` after the low-pass of ``motion``, at the same rows."""
        kernel = np.pad(self._smooth(), len(_FIRST))
        smooth: Array = scipy.signal.oaconvolve(values, kernel.reshape(-1, *[1] * (values.ndim - 1)), "valid", axes=0)
        return smooth

    def times(self, count: int, cut: int | None = None) -> Array:
        """Return the times ``(count,)`` s of decimated rows after the run's first sample.

        Args:
            cut: number of samples left out at the beginning before they were decimated; ``margin`` if not given.
        """
        first = (self.margin if cut is None else cut) + (len(self.impulse) - 1) / 2
        return np.asarray(self.step_s * (first + self.every * np.arange(count)))

    def trimmed(self, values: Array) -> Array:
        """Return values ``(n, ...)`` at the rows of ``motion``."""
        return values[self.margin : len(values) - self.margin]

    def decimated(self, values: Array, lead_s: float = 0.0, order: int = 0) -> Array:
        """Return decimated values ``(n, ...)``, or their derivative in time.

        Args:
            lead_s: delay of the values after the rows' times.
        """
        h = 1e-3 * self.every * self.step_s
        kernel = self._kernel(lead_s)
        if order == 1:
            kernel = (self._kernel(lead_s + h) - self._kernel(lead_s - h)) / (2 * h)
        elif order == 2:
            kernel = (self._kernel(lead_s + h) - 2 * kernel + self._kernel(lead_s - h)) / h**2
        count = 1 + (len(values) - len(kernel)) // self.every
        columns = np.arange(len(kernel)) + self.every * np.arange(count)[:, None]
        rows = len(kernel) * np.arange(count + 1)
        weights = scipy.sparse.csr_array((np.tile(kernel, count), columns.ravel(), rows), shape=(count, len(values)))
        thinned: Array = (weights @ values.reshape(len(values), -1)).reshape(count, *values.shape[1:])
        return thinned

    def _kernel(self, lead_s: float) -> Array:
        """Return the root of a raised cosine, h(t) = cos(2 pi t) / (1 - 16 t^2) in kept steps, faded out smoothly."""
        reach = (_SPAN + 1) * self.every
        t = np.arange(-reach, reach + 1) / self.every - lead_s / (self.step_s * self.every)
        pole = np.abs(1 - 16 * t**2) < 1e-8
        shape = np.where(pole, np.pi / 4, np.cos(2 * np.pi * t) / np.where(pole, 1.0, 1 - 16 * t**2))
        kernel: Array = np.asarray(shape * np.clip(1 - (t / _SPAN) ** 2, 0.0, None) ** 2)
        return np.asarray(kernel / kernel.sum())

    def _smooth(self) -> Array:
        """Return a low-pass, flat to twice the band, closed from four times on (Kaiser 1974) or as the rate allows."""
        band = 0.5 / self.every  # per sample
        flat, closed = 2 * band, min(4 * band, 0.5)
        taps = int(np.ceil((_DEPTH_DB - 8) / (2.285 * 2 * np.pi * (closed - flat)))) // 2
        t = np.arange(-taps, taps + 1)
        kernel = np.sinc((flat + closed) * t) * np.kaiser(len(t), 0.1102 * (_DEPTH_DB - 8.7))
        return np.asarray(kernel / kernel.sum())


def band_of(time_s: Array, band_hz: float = BAND_HZ) -> Band:
    """Return the band of a run.

    Raises:
        LabError: the run is shorter than the filters, or a band other than the default is beyond half of the sampling
            rate.
    """
    step = float((time_s[-1] - time_s[0]) / max(len(time_s) - 1, 1))
    if not (step > 0 and band_hz > 0):
        raise LabError(f"a time step of {step:g} s and a band of {band_hz:g} Hz: both must be above zero")
    if band_hz > max(0.5 / step, BAND_HZ):
        raise LabError(
            f"a band of {band_hz:g} Hz is beyond half of the sampling rate: a run with a row every {step:.3g} s has "
            f"nothing above {0.5 / step:.4g} Hz; give less"
        )
    band = Band(step, max(round(0.5 / (step * band_hz)), round(0.5 / _MAX_BAND)))
    least = 2 * band.margin + 4 * (_SPAN + 1) * band.every
    if len(time_s) < least:
        raise LabError(
            f"the run of {len(time_s) * step:.3g} s is too short for a band of {0.5 / (step * band.every):.3g} Hz: "
            f"give at least {least * step:.3g} s"
        )
    return band
