"""What runs say of a robot's links and effects, so that runs of different days can be compared."""

from collections.abc import Sequence

from lab.commands.calibrate.load_run import Calibrated
from lab.core.errors import LabError
from lab.verification.difference import Estimates

__all__ = ["SETUP", "estimates_of", "refuse_other_parameters"]

SETUP = ("base", "tool")  # groups of parameters that another setup of the measurement moves


def estimates_of(run: Calibrated, without: Sequence[str] = SETUP) -> Estimates:
    """The identified parameters of a run, with the covariance that its residuals allow.

    Args:
        without: groups that are left out, by default those of the setup.
    """
    parameters = {each.name: each for each in run.arm.parameters}
    kept = [i for i, name in enumerate(run.identified) if parameters[name].group not in without]
    names = tuple(run.identified[i] for i in kept)
    _, larger, dof = run.lacking((run.result.noise_mm or 0.0) / 1e3)
    covariance = larger * run.covariance[kept][:, kept]
    angles = tuple(parameters[name].is_angle for name in names)
    return Estimates(names, run.estimates[kept], covariance, angles, dof)


def refuse_other_parameters(runs: Sequence[Calibrated], estimates: Sequence[Estimates]) -> None:
    """Refuse runs that are of another robot than the first, or identified other parameters.

    Raises:
        LabError: a run is, or did.
    """
    first = runs[0]
    for run, each in zip(runs[1:], estimates[1:], strict=True):
        if run.robot.sha256 != first.robot.sha256:
            raise LabError(f"{run.folder}: is of another robot than {first.folder}; compare runs of one robot")
        if other := set(each.names) ^ set(estimates[0].names):
            raise LabError(
                f"{run.folder}: {min(other)} was identified in it or in {first.folder}, but not in both: the others "
                "mean something else in each; identify both with the same --model, --fix and --free"
            )
