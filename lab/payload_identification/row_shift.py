"""By how many rows joint positions may stand beside what was measured with them, by cross-correlation.

What a payload and an arm's own links do is a function of where the joints are: of which way is up in the last frame,
and of cosines and sines of joint positions and of their sums. With an orthonormal basis of these, the share of what
was measured that the positions of s rows later explain is a sum of squared cross-correlations at the lag s, for all
lags at once by Fourier transforms (Oppenheim & Schafer 2010, section 8.7). It is highest where rows belong together.
"""

from collections.abc import Callable

import numpy as np

from lab.core.load_samples import PayloadSamples
from lab.core.se3 import Array

__all__ = ["Upward", "likely_shifts"]

Upward = Callable[[Array], Array]  # joint positions (n, joints) to (n, 3): which way is up in the last frame

_MOST = 0.25  # of a run's rows: the largest shift that is looked for
_ROWS_FOR_ONE = 4  # rows of a run for each function of the joint positions
_LEAST_SIZE = 1e-6  # of the largest singular value: less is a function of the others


def likely_shifts(samples: PayloadSamples, upward: Upward, count: int) -> tuple[int, ...]:
    """How many rows later joint positions may belong to what was measured; the likeliest first, zero not among them."""
    runs = [run for loaded in (True, False) if len(run := samples.run(loaded)) >= 2 * _ROWS_FOR_ONE]
    if not runs:
        return ()
    most = int(_MOST * min(map(len, runs)))
    lags = np.concatenate([np.arange(-most, 0), np.arange(1, most + 1)])
    shares = np.sum([_shares(run, upward)[lags] for run in runs], axis=0)
    return tuple(int(lags[i]) for i in np.argsort(-shares, kind="stable")[:count])


def _shares(run: PayloadSamples, upward: Upward) -> Array:
    """``(2 n,)`` the share of what was measured that the positions of so many rows later explain.

    From the end they are earlier. Each channel counts alike.
    """
    given = [each for each in (run.torques, run.wrench) if each is not None]
    channels = np.concatenate(given, axis=1)
    channels = channels - channels.mean(axis=0)
    sizes = np.linalg.norm(channels, axis=0)
    channels = channels[:, sizes > 0] / sizes[sizes > 0]
    basis, n = _basis(run.joints, upward), len(run)
    turned = np.fft.rfft(basis, 2 * n, axis=0)[:, :, None] * np.fft.rfft(channels, 2 * n, axis=0).conj()[:, None]
    together = np.fft.irfft(turned, 2 * n, axis=0)
    lag = np.minimum(np.arange(2 * n), np.arange(2 * n, 0, -1))
    return np.asarray((together**2).sum(axis=(1, 2)) * (n / np.maximum(n - lag, 1)))


def _basis(joints: Array, upward: Upward) -> Array:
    """Orthonormal functions ``(n, d)`` of joint positions, without their mean."""
    size = joints.shape[1]
    pairs = [joints[:, i] + sign * joints[:, i + 1] for i in range(size - 1) for sign in (1, -1)]
    angles = np.column_stack([joints, *pairs])
    functions = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(len(joints), -1)
    functions = np.column_stack([upward(joints), functions])[:, : max(len(joints) // _ROWS_FOR_ONE, 3)]
    u, sizes, _ = np.linalg.svd(functions - functions.mean(axis=0), full_matrices=False)
    return np.asarray(u[:, sizes > _LEAST_SIZE * sizes.max(initial=0.0)])
