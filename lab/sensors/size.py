"""Give artefacts of known dimensions an uncertain size: one factor of all their lengths, with a prior.

All lengths of a board, a plate, a bar, a cube or of pairs of sockets are larger than stated by one share, the
parameter ``scale`` of the artefact. Printer, calibration and temperature are errors of that kind. Its prior is a normal
distribution about zero; where the arm knows its own size better than the artefact, the fit corrects the artefact.

Standard uncertainties (1 sigma, shares) where none is stated:

- a printed board: 0.5 %, of printers that feed paper or scale a page;
- a machined cube, plate or bar: 0.005 %, steel (11.5e-6 / K, ISO 3650:1998) some 4 K from 20 degrees Celsius (ISO
  1:2022), beside which the uncertainty of a calibration is small;
- the distance of two sockets: 0.1 %, the tolerance of a drawing (ISO 2768-1:1989, class f: +-0.1 mm at 30 to 120 mm).
"""

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.se3 import Array
from lab.kinematics.parameter import SIZE, Parameter, placed_parameters

__all__ = [
    "LEAST_NOISE",
    "MACHINED",
    "PRINTED",
    "SOCKET_DISTANCE",
    "checked_size_u",
    "drawn_size",
    "size_parameters",
    "size_residuals",
    "stated_size_u",
]

PRINTED, MACHINED, SOCKET_DISTANCE = 5e-3, 5e-5, 1e-3
LEAST_NOISE = 1e-6  # m, or thousands of pixels: priors weigh by it until the residuals show a noise
_PERCENT = 1e-2
_MOST_PERCENT = 100.0


def checked_size_u(key: str, percent: float | None, usual: float) -> float:
    """Return the standard uncertainty of a size as a share: the stated one, else the usual one.

    Args:
        key: name of the option or entry.
        percent: stated; 0 for an exact size, infinite for an unknown one, None where nothing is stated.

    Raises:
        LabError: it is negative, no number, or above 100.
    """
    if percent is None:
        return usual
    if not (0 <= percent <= _MOST_PERCENT or percent == np.inf):
        raise LabError(f"{key} {percent:g}: give percent (1σ) from 0, an exact size, to {_MOST_PERCENT:g}, or inf")
    return percent * _PERCENT


def stated_size_u(percent: float | None, usual: float) -> float:
    """Return ``checked_size_u`` of the command line's option."""
    return checked_size_u(option_name("size_u_percent"), percent, usual)


def size_parameters(owner: str, u: float) -> tuple[Parameter, ...]:
    """Return the share by which an artefact's lengths are larger than stated; none where its size is exact."""
    return placed_parameters(owner, SIZE, ("scale",), scale=u) if u else ()


def drawn_size(u: float, rng: np.random.Generator) -> float:
    """Draw the share by which a simulated artefact is larger than stated; 0 of an exact or an unknown size."""
    return u * float(rng.spawn(1)[0].standard_normal()) if np.isfinite(u) else 0.0


def size_residuals(parameters: tuple[Parameter, ...], values: Array, sigma: float) -> tuple[Array, Array]:
    """Return the priors of sizes, as residuals ``(r,)`` with derivatives ``(r, p)`` that weigh by the noise ``sigma``.

    Args:
        parameters: of a model; those of sizes have a prior, unless their uncertainty is infinite.
        values: ``(p,)``.
    """
    columns = [i for i, each in enumerate(parameters) if each.group == SIZE and np.isfinite(each.scale)]
    weights = sigma / np.array([parameters[i].scale for i in columns])
    rows = np.zeros((len(columns), len(parameters)))
    rows[np.arange(len(columns)), columns] = weights
    return -weights * values[columns], rows
