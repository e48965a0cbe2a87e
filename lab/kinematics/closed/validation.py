"""What no mechanism can be, by its structure: each refused in one line."""

import numpy as np

from lab.core.errors import LabError
from lab.kinematics.closed.structure import Rod, Tree
from lab.kinematics.joints import JointSpec

__all__ = ["refuse_unsound"]


def refuse_unsound(joints: JointSpec, tree: Tree) -> None:
    """A LabError where joints, passive values and closures do not go together."""
    _refuse_misnamed(joints, tree)
    missing = len(tree.passive) - tree.equations
    if missing:
        counted = f"passive values: {len(tree.passive)}, equations of rods and pins: {tree.equations}"
        raise LabError(
            f"robot '{joints.name}': its mobility is {joints.size + missing}, its measured joints are {joints.size} "
            f"({counted}); " + ("add rods or pins" if missing > 0 else "take rods or pins out, or make steps passive")
        )
    _refuse_idle(joints, tree)
    for rod in tree.rods:
        if rod.joint is not None:
            _refuse_short(joints, rod, rod.joint)


def _refuse_misnamed(joints: JointSpec, tree: Tree) -> None:
    """Each joint moves one thing."""
    movers = [step.joint for frame in tree.frames for step in frame.path] + [rod.joint for rod in tree.rods]
    for i, name in enumerate(joints.joint_names):
        if movers.count(i) != 1:
            times = f"{movers.count(i)} steps or rods" if movers.count(i) else "nothing"
            raise LabError(f"robot '{joints.name}', joint {name}: moves {times}; let one step or rod name it")


def _refuse_idle(joints: JointSpec, tree: Tree) -> None:
    """Passive values move closures; joints move these or the platform, which moves."""
    carrying = tree.ancestry(tree.platform)
    ends = [end for rod in tree.rods for end in rod.ends] + [end for pin in tree.pins for end in pin.ends]
    closing = {step for end in ends for step in tree.ancestry(end)}
    for f, frame in enumerate(tree.frames):
        for s, step in enumerate(frame.path):
            if step.passive and (f, s) not in closing:
                raise LabError(
                    f"robot '{joints.name}', frame {frame.name}: no rod or pin holds its passive {step.kind}; join one"
                )
            if step.joint is not None and (f, s) not in closing and (f, s) not in carrying:
                raise LabError(
                    f"robot '{joints.name}', joint {joints.joint_names[step.joint]}: moves frame {frame.name}, which "
                    "neither closes a loop nor carries the platform; join a rod or a pin to it"
                )
    if not any(tree.step(*step).passive or tree.step(*step).joint is not None for step in carrying):
        name = tree.frames[tree.platform].name
        raise LabError(f"robot '{joints.name}': nothing moves {name}, its platform; name a frame that moves")


def _refuse_short(joints: JointSpec, rod: Rod, joint: int) -> None:
    """A leg has a length wherever its joint stands."""
    ends = rod.length_m + joints.sign[joint] * np.array([joints.lower[joint], joints.upper[joint]])
    if ends.min() <= 0:
        raise LabError(
            f"robot '{joints.name}', rod {rod.name}: within the limits of joint {joints.joint_names[joint]} its length "
            f"goes from {1e3 * ends.min():.6g} to {1e3 * ends.max():.6g} mm; keep it above zero"
        )
