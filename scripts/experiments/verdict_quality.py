"""How often is the verdict wrong? Virtual campaigns of known quality, judged as a user would have them judged.

Campaigns of an IRB 120 whose links are off by the usual tolerances: any number of poses in any part of the joints'
ranges, noise that is known or estimated, effects that the model lacks, and files that are not of this robot at all. The
verdict sees a hold-out set that was measured as the other poses were; the truth is the error at new poses in the same
part of the joints' ranges, where the verdict holds. A campaign is good where its true mean error is at most 1.1 times
the predicted one and below the gate. It is bad where that is above 1.5 times the gate, or where robot, units or signs
are wrong. One with a mistake of the session (the tracker moved or drifted, a joint's zero was lost) is never good.
Those between are counted apart, and so are those whose gate is below what the instrument shows of such an arm: the mean
length of true error and noise together.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from shared import Answer, Document, Flag, Section, Table, paragraphs, run_script

import lab
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.gauge import base_set
from lab.kinematics.parameter import TOLERANCE_M, TOLERANCE_RAD
from lab.phrases.phrase import phrases
from lab.prediction.validation import errors_at
from lab.prediction.workspace_prediction import MEAN_OF_RMS
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot
from lab.verdict.verdict import Verdict, Word

ROBOT = load_robot("irb120")
ARM = ROBOT.serial_arm(("p1",))
Quality = Literal["good", "not shown", "between", "bad"]
_QUALITIES: Final[tuple[Quality, ...]] = ("good", "not shown", "between", "bad")
_WORDS: Final[tuple[Word, ...]] = ("good", "doubtful", "bad", "not judged")
_LACKING, _KNOWN = 0.4, 0.7  # shares of the campaigns
_GATES_M = (0.05e-3, 2e-3)  # what users ask for
_HOLDOUT = 0.3
_CLEARLY_BAD, _AS_PREDICTED = 1.5, 1.1
_NEW_POSES = 200  # where the truth is taken


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    campaigns: int = 2000
    """Virtual campaigns."""
    wrong: float = 0.2
    """Share of them whose file is of another robot, in other units or signs, or where something moved."""
    seed: int = 0
    """Of all draws."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Campaign:
    """A campaign and what it really is.

    Attributes:
        kind: what is amiss, in words.
        quality: by the truth.
        found: the verdict; None where the input was refused.
    """

    kind: str
    quality: Quality
    found: Verdict | None

    @property
    def word(self) -> str:
        """The verdict's word; ``bad`` of an input that is refused."""
        return "bad" if self.found is None else self.found.word


def answer(options: Options) -> Answer:
    """The confusion of words and qualities."""
    found = [judged_campaign(number, options) for number in range(options.campaigns)]
    count = Counter((each.quality, each.word) for each in found)
    of = {quality: sum(each.quality == quality for each in found) for quality in _QUALITIES}
    false_good, false_alarm = count["bad", "good"] / max(of["bad"], 1), 1 - count["good", "good"] / max(of["good"], 1)
    values = {
        "campaigns": len(found),
        "confusion": {quality: {word: count[quality, word] for word in _WORDS} for quality in _QUALITIES},
        "false_good": false_good,
        "false_alarm": false_alarm,
        "alarms": Counter(_reason(each) for each in found if each.quality == "good" and each.word != "good"),
        "missed": Counter(each.kind for each in found if each.quality == "bad" and each.word == "good"),
    }
    rows = tuple((f"really {quality}", *(str(count[quality, word]) for word in _WORDS)) for quality in _QUALITIES)
    said = [
        f"False good: {100 * false_good:.2f} % of {of['bad']:,} bad campaigns.",
        f"False alarm: {100 * false_alarm:.2f} % of {of['good']:,} good campaigns.",
    ]
    blocks = (Table(("", *_WORDS), rows), *paragraphs(said))
    return Answer(values, Document("How often is the verdict wrong?", (Section("Confusion", blocks),)))


def judged_campaign(number: int, options: Options) -> Campaign:
    """One campaign of the study, judged."""
    rng = rng_for(options.seed, "robots", number)
    if rng.random() >= options.wrong:
        day = _MeasurementSession(rng)
        kind = "lacks an effect" if day.lacking_rad else "as the model says"
        return _judged(kind, day, ROBOT, lambda data: data, rng)
    spoilt_as = {**_WRONG, **_MISTAKES}
    kind = str(rng.choice(list(spoilt_as)))
    return _judged(
        kind, _MeasurementSession(rng), _OTHERS.get(kind, ROBOT), lambda data: spoilt_as[kind](data, rng), rng
    )


class _MeasurementSession:
    """A virtual arm, and where and how it is measured.

    Attributes:
        true: ``(p,)`` parameters of the arm.
        lacking_rad: amplitude of a periodic error of each joint, of which the model knows nothing; often zero.
        joints: ``(n, joints)`` the measured poses.
        sigma_m: noise of a coordinate.
        known: whether the identifier is told it.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        chain = ARM.chain
        self.true = ARM.nominal()
        self.true[:3] += rng.normal(size=3)
        scale = np.array([TOLERANCE_RAD if each.is_angle else TOLERANCE_M for each in ARM.parameters])
        links = [i for i in base_set(ARM, self.true).identifiable if ARM.parameters[i].is_link]
        self.true[links] += (scale * rng.normal(size=len(scale)))[links]
        self.lacking_rad = 10 ** rng.uniform(-5, -3) * (rng.random() < _LACKING)
        self.phases = rng.uniform(0, 2 * np.pi, (2, chain.size))
        count, self._share = int(rng.integers(15, 80)), rng.uniform(0.1, 1.0)
        free = (1 - self._share) * (ARM.chain.upper - ARM.chain.lower)
        self._middle = (ARM.chain.lower + ARM.chain.upper) / 2 + free * (rng.random(ARM.chain.size) - 0.5)
        self.joints = self.poses(count, rng)
        self.sigma_m = float(10 ** rng.uniform(-5.3, -4))
        self.known = bool(rng.random() < _KNOWN)

    def poses(self, count: int, rng: np.random.Generator) -> Array:
        """Draw poses ``(count, joints)`` in the part of each joint's range that is measured."""
        chain = ARM.chain
        joints: Array = self._middle + self._share * (chain.random_joints(count, rng) - (chain.lower + chain.upper) / 2)
        return joints

    def points(self, joints: Array) -> Array:
        """Where the target really is ``(n, 1, 3)`` m."""
        off = np.sin(joints + self.phases[0]) + 0.5 * np.sin(2 * joints + self.phases[1])
        return ARM.points(joints + self.lacking_rad * off, self.true)

    def measured(self, rng: np.random.Generator) -> Measurements:
        """What the instrument sees."""
        noise = self.sigma_m * rng.normal(size=(len(self.joints), 1, 3))
        return measured(ARM.chain.joint_names, self.joints, ARM.targets, self.points(self.joints) + noise)


def _judged(
    kind: str,
    day: _MeasurementSession,
    robot: Robot,
    spoilt: Callable[[Measurements], Measurements],
    rng: np.random.Generator,
) -> Campaign:
    """A campaign, judged as a user would have it judged: by a gate, and on a part of its own poses."""
    data = spoilt(day.measured(rng))
    new = day.poses(_NEW_POSES, rng)
    gate_m = float(np.exp(rng.uniform(*np.log(_GATES_M))))
    noise_mm = 1e3 * day.sigma_m if day.known else None
    try:
        result = lab.identify(data, robot=robot, noise_mm=noise_mm, holdout=_HOLDOUT, gate_mm=1e3 * gate_m)
    except LabError:
        return Campaign(kind, "bad" if kind in _WRONG else "between", None)
    found, judged = result.identification, result.verdict
    if kind in _WRONG:
        return Campaign(kind, "bad", judged)
    true_m = float(errors_at(found, new, day.points(new)).after.mean())
    if true_m > _CLEARLY_BAD * gate_m:
        return Campaign(kind, "bad", judged)
    measured_m = MEAN_OF_RMS * float(np.hypot(true_m / MEAN_OF_RMS, np.sqrt(3) * day.sigma_m))
    if true_m <= gate_m < measured_m:
        return Campaign(kind, "not shown", judged)
    as_good = true_m <= gate_m and true_m <= _AS_PREDICTED * MEAN_OF_RMS * judged.region.rms_m
    return Campaign(kind, "good" if as_good and kind not in _MISTAKES else "between", judged)


def _reason(campaign: Campaign) -> str:
    """The first words of the heaviest reason."""
    if campaign.found is None:
        return "refused"
    return " ".join([*phrases(campaign.found.reasons), campaign.word][0].split()[:3])


def _swapped(data: Measurements, rng: np.random.Generator) -> Measurements:
    first, second = rng.choice(data.joints.shape[1], 2, replace=False)
    joints = data.joints.copy()
    joints[:, [first, second]] = joints[:, [second, first]]
    return replace(data, joints=joints)


def _negated(data: Measurements, rng: np.random.Generator) -> Measurements:
    return replace(data, joints=data.joints * np.where(rng.permutation(data.joints.shape[1]) == 0, -1.0, 1.0))


def _shifted(data: Measurements, rng: np.random.Generator) -> Measurements:
    """A zero of joints 2 to 5 moved by a right angle: those of joints 1 and 6 are base and tool."""
    return replace(data, joints=data.joints + np.pi / 2 * (np.arange(data.joints.shape[1]) == rng.integers(1, 5)))


_WRONG: Final[Mapping[str, Callable[[Measurements, np.random.Generator], Measurements]]] = {
    "metres taken for millimetres": lambda data, _: replace(data, points=1e-3 * data.points),
    "inches taken for millimetres": lambda data, _: replace(data, points=data.points / 25.4),
    "radians taken for degrees": lambda data, _: replace(data, joints=np.deg2rad(data.joints)),
    "all joints negated": lambda data, _: replace(data, joints=-data.joints),
    "one joint negated": _negated,
    "two joints exchanged": _swapped,
    "a zero moved by a right angle": _shifted,
    "the rows of points shuffled": lambda data, rng: replace(data, points=rng.permutation(data.points)),
    "one axis mirrored": lambda data, _: replace(data, points=data.points * [1.0, 1.0, -1.0]),
    "nothing but zeros": lambda data, _: replace(data, points=0 * data.points),
    "another robot of like size (scemi)": lambda data, _: data,
    "another robot of like size (tx40)": lambda data, _: data,
}
_OTHERS: Final = {kind: load_robot(kind[-6:-1].lstrip("(")) for kind in _WRONG if kind.startswith("another")}


def _after_half(data: Measurements) -> Array:
    return np.asarray((np.arange(len(data)) >= len(data) // 2)[:, None, None] * 1.0)


def _shift(rng: np.random.Generator) -> Array:
    """A shift of a size that happens (m): from 20 µm to 3 mm."""
    vector = rng.normal(size=3)
    return np.asarray(10 ** rng.uniform(-4.7, -2.5) * vector / np.linalg.norm(vector))


def _zero_lost(data: Measurements, rng: np.random.Generator) -> Measurements:
    off = _after_half(data)[..., 0] * (np.arange(data.joints.shape[1]) == rng.integers(1, 5))
    return replace(data, joints=data.joints + 2 * np.linalg.norm(_shift(rng)) * off)


_MISTAKES: Final[Mapping[str, Callable[[Measurements, np.random.Generator], Measurements]]] = {
    "the tracker moved half way": lambda data, rng: replace(data, points=data.points + _after_half(data) * _shift(rng)),
    "the tracker drifted": lambda data, rng: replace(
        data, points=data.points + np.linspace(0, 1, len(data))[:, None, None] * _shift(rng)
    ),
    "a joint's zero was lost half way": _zero_lost,
}


if __name__ == "__main__":
    run_script("verdict_quality")
