"""Cameras on virtual arms: exact without noise, and intervals against the truth, over many whole campaigns.

Each campaign has an arm, cameras, boards, poses and noise of its own: corners are projected in MuJoCo's cell, with
whatever is hidden or out of the picture left out, and the arm is identified from nominal dimensions, by Gauss-Newton to
convergence, with the noise estimated. Each 95 % interval holds the truth or does not.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from shared import Answer, Document, Flag, Section, named_values, paragraphs, run_script

from lab.calibration.identify import IdentifyOptions, identify
from lab.calibration.validation import compare_with_truth
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import Robot, load_virtual
from lab.campaign.virtual_robot import truth_of
from lab.commands.calibrate.run import measurement_session
from lab.core.errors import LabError

_BOARD = "columns = 5\nrows = 4\nsquare_mm = 30.0\n"
CASES: Mapping[str, tuple[str, str, int]] = {  # of each case: the sensors, the cameras and boards, and how many poses
    "hand": ("pixels", f'[[camera]]\nfixed_to = "hand"\n[[board]]\nfixed_to = "world"\n{_BOARD}', 15),
    "world": ("pixels", f'[[camera]]\nfixed_to = "world"\n[[board]]\nfixed_to = "hand"\n{_BOARD}', 15),
    "two": (
        "pixels",
        '[[camera]]\nname = "wrist"\nfixed_to = "hand"\n[[camera]]\nname = "wall"\nfixed_to = "world"\n'
        f'[[board]]\nname = "table"\nfixed_to = "world"\n{_BOARD}'
        f'[[board]]\nname = "plate"\nfixed_to = "hand"\n{_BOARD}',
        24,
    ),
    "intrinsics": (
        "pixels",
        '[[camera]]\nfixed_to = "hand"\nintrinsics = "free"\ndistortion = [-0.2, 0.05, 0.001, -0.001, 0.0]\n'
        f'[[board]]\nfixed_to = "world"\n{_BOARD}',
        20,
    ),
    "tracker": ("points+pixels", f'[[camera]]\nfixed_to = "hand"\n[[board]]\nfixed_to = "world"\n{_BOARD}', 15),
}
_INSTRUMENT = "uniform-8um"  # of the points beside the pictures
_REQUEST = IdentifyOptions()


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    campaigns: int = 200
    """Campaigns of each case."""
    first: int = 0
    """Seed of the first."""
    robot: str = "irb120"
    """Which arm."""
    cases: tuple[str, ...] = tuple(CASES)
    """Cases: hand, world, two, intrinsics, tracker."""
    exact: int = 20
    """Campaigns without noise of each case."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class _Campaign:
    """Errors of one identification in standard deviations, and in SI units.

    Attributes:
        inside: ``(f,)`` which intervals hold the truth.
    """

    inside: NDArray[np.bool_]
    nees: float
    error: float
    sigma: float


def campaign(robot: Robot, options: VirtualCampaign) -> _Campaign:
    """Simulate a campaign and identify the arm.

    Raises:
        LabError: it did not converge, or there is no single truth.
    """
    day, placed = measurement_session(options, robot)
    kind, arm = options.kind(), robot.arm(options.targets)
    nominal = arm.nominal(robot.tool)
    model, data = kind.observation(arm, day.measurements, nominal)
    model = kind.balanced(model, data, nominal, _REQUEST)
    found = identify(model, data, nominal, request=_REQUEST)
    known = truth_of(day.true_robot, arm)
    truth = None if known is None else kind.observed_truth(known, found, day.true_robot, placed)
    if truth is None or found.status != "converged":
        raise LabError(f"seed {options.seed}: {found.status}")
    compared = compare_with_truth(found, truth)
    inside = np.abs(compared.z) <= found.half_width_95
    return _Campaign(inside, compared.nees_per_parameter, float(np.abs(compared.error).max()), found.sigma_m)


def study(options: Options, name: str) -> dict[str, float]:
    """One case over all campaigns."""
    observe, rig, poses = CASES[name]
    robot = load_virtual(options.robot)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "cameras.toml"
        file.write_text(rig, encoding="utf-8")

        def of(seed: int, instrument: str) -> VirtualCampaign:
            return VirtualCampaign(
                options.robot, observe=observe, cameras=file, poses=poses, seed=seed, instrument=instrument
            )

        seeds = range(options.first, options.first + options.campaigns)
        found, failed = list[_Campaign](), 0
        for seed in seeds:
            try:
                found.append(campaign(robot, of(seed, _INSTRUMENT)))
            except LabError:
                failed += 1
        exact = [campaign(robot, of(seed, "exact")).error for seed in range(options.exact)]
    held = np.array([each.inside.mean() for each in found])
    each = np.mean([row.inside for row in found], axis=0) if len({len(row.inside) for row in found}) == 1 else held
    return {
        "campaigns": float(len(found)),
        "failed": float(failed),
        "parameters": float(len(found[0].inside)),
        "noise_free_error_largest": max(exact, default=float("nan")),
        "coverage_mean": float(held.mean()),
        "coverage_standard_error": float(held.std() / np.sqrt(len(held))),
        "coverage_least": float(each.min()),
        "coverage_largest": float(each.max()),
        "nees_per_parameter": float(np.mean([row.nees for row in found])),
    }


def answer(options: Options) -> Answer:
    """All cases, one after another.

    Raises:
        LabError: a case is unknown.
    """
    if unknown := [name for name in options.cases if name not in CASES]:
        raise LabError(f"--cases {unknown[0]}: unknown; give some of {', '.join(CASES)}")
    results = {name: study(options, name) for name in options.cases}
    sections = (Section(name, paragraphs(named_values(result))) for name, result in results.items())
    return Answer(results, Document("Cameras on virtual arms", tuple(sections)))


if __name__ == "__main__":
    run_script("camera_coverage")
