"""How far a run's fitted drift and sessions move the calibrated positions: groups of its own day, which end with it."""

from collections.abc import Iterator, Mapping

import numpy as np

from lab.calibration.estimate import EstimatedParameter
from lab.certification.quantities import FrameMotion
from lab.commands.calibrate.load_run import CalibrationRun
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.kinematics.effects.conditions import HOUR_S

__all__ = ["fitted_motions"]

_AXES = ("x", "y", "z", "rx", "ry", "rz", "scale")


def fitted_motions(calibrated: CalibrationRun, rows: Measurements, positions: Array) -> Iterator[FrameMotion]:
    """The displacement of positions ``(w, 3)`` m from the start of the campaign to its end, and to each session.

    The model takes the motion out of the fit; on another day nobody knows where the frame is.
    """
    if not calibrated.estimate.left_out:
        return
    parameters = calibrated.estimate.params
    source = "fitted with the parameters; a calibrated position is that at the start"
    if "drift" in calibrated.estimate.left_out and (offset := _size(parameters, "drift", positions) * _spans(rows)):
        yield FrameMotion("drift of base or instrument to the campaign's end", source, offset)
    sessions = dict.fromkeys(rows.sessions) if "sessions" in calibrated.estimate.left_out else ()
    sizes = {name: _size(parameters, f"session.{name}", positions) for name in sessions}
    if sizes and (offset := max(sizes.values())):
        name = max(sizes, key=sizes.__getitem__)
        yield FrameMotion(f"base or instrument moved to session {name}", source, offset)


def _spans(rows: Measurements) -> float:
    """Return the length of a drift in units of its rate: hours where the rows are timed, else one campaign."""
    times = rows.conditions.get("time_s")
    known = None if times is None else times[np.isfinite(times)]
    return 1.0 if known is None or not known.size else float(np.ptp(known)) / HOUR_S


def _size(parameters: Mapping[str, EstimatedParameter], group: str, positions: Array) -> float:
    """The root mean square displacement (m) of positions by a frame's motion."""
    names = [f"{group}.{axis}" for axis in _AXES]
    shift, turn, scale = np.split(
        np.array([parameters[name].exported if name in parameters else 0.0 for name in names]), (3, 6)
    )
    moved = shift + np.cross(turn, positions) + scale * positions
    return float(np.sqrt((moved**2).sum(axis=1).mean()))
