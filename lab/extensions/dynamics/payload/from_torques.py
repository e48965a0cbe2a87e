"""A load from what it adds to the joints' torques: a loaded run less an unloaded one along nearly the same path."""

from collections.abc import Sequence

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.dynamics.filtering import BAND_HZ, Filter
from lab.extensions.dynamics.load_samples import PayloadSamples
from lab.extensions.dynamics.payload.estimate import LoadEstimate, estimate_of, excitation_advice
from lab.extensions.dynamics.payload.paired_runs import PairedRuns, diagonal, pair_runs, refuse_apart
from lab.extensions.dynamics.regression import BiasCandidate, ChannelSolution, Series, least_squares, verdict
from lab.kinematics.dynamics.rigid_body import LOAD, Dynamics, torque_regressor
from lab.kinematics.serial.arm import SerialArm

__all__ = ["from_torques"]

_ROUNDS, _SETTLED = 10, 1e-6  # of what is fitted along: seconds, and shares of a torque
_DELAY = "a delay between torques and positions; estimate it (delay)"
_FILTERED = "a filter that torques came through and positions did not; tell it (came_through), or record without"
_FRICTION = "friction that grows with the load; estimate it (friction)"
_PATHS = "the difference between the two runs' paths; subtract the arm's own dynamics, or better ones (own)"


def from_torques(
    arm: SerialArm,
    values: Array,
    records: PayloadSamples,
    gravity: Array,
    *,
    own: Dynamics | None = None,
    friction: bool = False,
    delay: bool = False,
    came_through: Filter | None = None,
    sigma: Array | None = None,
    band_hz: float = BAND_HZ,
) -> LoadEstimate:
    """The load from differences of torques, row by row of the two runs; four parameters where these are static poses.

    Args:
        gravity: ``(3,)`` m/s^2 in frame 0.
        own: subtracted from each run along its own path, so that paths may differ.
        friction: fit of each joint what share of a torque it loses to friction: (|loaded| - |unloaded|) sign(speed).
            Give ``own`` with it where the joints' friction without a load is not small beside what they bear.
        delay: fit how much later the torques are than the positions, the same of all joints.
        came_through: what filter the torques had passed when they were recorded; its like acts on all else.
        sigma: ``(J,)`` noise of one reading of each torque; else it is estimated.
        band_hz: of the filter in which a motion is compared.

    Raises:
        LabError: no torques, no or unequal runs, too few samples, paths too far apart for a run without ``own``.
    """
    loaded, unloaded = _runs(records)
    if records.time_s is None:
        if friction or delay or came_through:
            raise LabError(
                "static poses show no friction, delay or filter: leave these options out, or record a motion"
            )
        return _static(arm, values, loaded, unloaded, gravity, own, sigma)
    runs = pair_runs(arm, values, loaded, unloaded, gravity, own, came_through, band_hz)
    names = arm.chain.joint_names if friction else ()
    reading = np.sqrt(2) * runs.common.gain
    known = None if sigma is None else reading * np.asarray(sigma)
    solution, late, columns = _fitted(runs, names, delay, known)
    fitted = solution.values[: columns.shape[3]]
    suspects = [
        BiasCandidate((columns[2, ..., :10] @ fitted[:10])[..., None], _FILTERED),
        BiasCandidate(runs.apart, _PATHS),
    ]
    if not delay:
        suspects.append(BiasCandidate((columns[1] @ fitted)[..., None], _DELAY))
    if not friction:
        suspects.append(BiasCandidate(runs.rubbing(fitted[:10])[0], _FRICTION))
    nuisance = {name: (float(value), "") for name, value in zip(solution.names[10:], solution.values[10:], strict=True)}
    nuisance |= {"delay": (late, "s")} if delay else {}
    unidentified = excitation_advice(solution, True, arm, values, runs.joints)
    said = verdict(solution, suspects, [Series(0, len(runs.own), runs.common.band.hz)])
    return estimate_of("torque difference, moving", solution, nuisance, unidentified, said, reading)


def _fitted(
    runs: PairedRuns, joint_names: Sequence[str], delay: bool, sigma: Array | None
) -> tuple[ChannelSolution, float, Array]:
    """Gauss-Newton in the delay, while the columns of friction follow the load that is found.

    With y(t + late) = X(t) p, where X holds the regressor and the friction's columns, a step of the delay has the
    column -X' p.

    Returns:
        The last step's solution, in which the delay's own value is that step; the delay (s); and X with its first two
        derivatives in time, ``(3, k, J, c)``.
    """
    labels = [*LOAD, *(f"friction.{name}" for name in joint_names), *(["delay"] if delay else [])]
    columns, late = runs.thinned, 0.0
    solution = least_squares(LOAD, columns[0], runs.seen(late), [0] * runs.own.shape[1], sigma)
    fitted = np.concatenate([solution.values, np.zeros(len(joint_names))])
    for _ in range(_ROUNDS if len(labels) > len(LOAD) else 0):
        if joint_names:
            columns = np.concatenate([runs.thinned, runs.rubbing(fitted[:10])], axis=3)
        step = [-(columns[1] @ fitted)[..., None]] if delay else []
        design = np.concatenate([columns[0], *step], axis=2)
        solution = least_squares(labels, design, runs.seen(late), [0] * runs.own.shape[1], sigma)
        before, fitted = fitted, solution.values[: len(fitted)]
        moved = np.abs(fitted - before)[10:].max(initial=0.0)
        if delay:
            late += float(solution.values[-1])
            moved = max(moved, abs(float(solution.values[-1])))
        if moved < _SETTLED:
            break
    if abs(late) > runs.common.band.every * runs.common.band.step_s:
        raise LabError(f"a delay of {1e3 * late:.3g} ms is too long: align torques and positions first")
    return solution, late, columns


def _static(
    arm: SerialArm,
    values: Array,
    loaded: PayloadSamples,
    unloaded: PayloadSamples,
    gravity: Array,
    own: Dynamics | None,
    sigma: Array | None,
) -> LoadEstimate:  # fmt: skip
    assert loaded.torques is not None and unloaded.torques is not None
    if len(loaded) != len(unloaded):
        raise LabError(
            f"{len(loaded)} loaded static poses and {len(unloaded)} unloaded ones: give both at each pose, in one order"
        )
    still = np.zeros_like(loaded.joints)
    refuse_apart(arm, loaded.joints - unloaded.joints, own)
    regressor = torque_regressor(arm, values, loaded.joints, still, still, gravity)
    seen = loaded.torques - unloaded.torques
    if own:
        seen = seen - (own(loaded.joints, still, still) - own(unloaded.joints, still, still))
    known = None if sigma is None else np.sqrt(2) * np.asarray(sigma)
    solution = least_squares(LOAD, regressor, seen, [0] * seen.shape[1], known)
    steady = np.broadcast_to(np.eye(seen.shape[1]), (*seen.shape, seen.shape[1]))
    suspects = [
        BiasCandidate(steady, "a steady torque of each joint, as stiction leaves; approach each pose from both sides"),
        BiasCandidate(diagonal(regressor @ solution.values), "gains of the joints' torques"),
    ]
    unidentified = excitation_advice(solution, False, arm, values, loaded.joints)
    said = verdict(solution, suspects)
    return estimate_of("torque difference, static", solution, {}, unidentified, said, float(np.sqrt(2)))


def _runs(records: PayloadSamples) -> tuple[PayloadSamples, PayloadSamples]:
    if records.torques is None:
        raise LabError("there are no torques: give those of every joint, or identify from the wrench")
    loaded, unloaded = records.run(True), records.run(False)
    for run, name in ((loaded, "loaded"), (unloaded, "unloaded")):
        if not len(run):
            raise LabError(f"there is no {name} run: torques are compared with and without the load; record both")
    return loaded, unloaded
