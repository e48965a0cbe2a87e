"""What is not geometry: named groups of parameters that move joints away from their readings.

An effect is a plain function of readings, conditions and its own parameters, with its derivative;
all its parameters are zero on the drawing. To add one, write such a function and an ``Effect``.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lab.core.errors import LabError
from lab.core.measurements import SESSION
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Kind, Parameter, joint_parameter, placed_parameters

Offsets = Callable[[Array, Array, Array], tuple[Array, Array]]
NEWTON_STEPS = 2  # the first leaves about 1e-11 rad of a sag of 1 mrad
HOUR_S = 3600.0
TYPICAL_COMPLIANCE = 1e-5  # rad/Nm
TYPICAL_BACKLASH = 1e-3  # rad, m of a slide
MASS_SCALE_KG = 10.0


@dataclass(frozen=True)
class SessionInfo:
    """How a campaign went: its sessions in their order, and when its clock was started (s)."""

    sessions: tuple[str, ...] = ()
    start_s: float = 0.0


@dataclass(frozen=True)
class Effect:
    """A group of parameters.

    Attributes:
        name: of the group, e.g. ``compliance``.
        parameters: what they are, e.g. ``joint2.compliance``.
        offsets: readings ``(n, joints)``, conditions ``(n, c)`` and parameters ``(p,)`` to how far the
            joints stand from their readings ``(n, joints)`` (rad, m of a slide), and the derivatives
            ``(n, joints, p)``. An effect that moves the frame gives seven numbers instead: by which
            the measured points p are shifted v, turned r and stretched s: (1 + s) exp(r) (p + v).
        conditions: columns of ``Measurements.conditions`` that it asks for.
        moves: the joints, or the frame in which points are measured.
        typical: values at which the rank is decided, where the drawing's zeros would hide a parameter.
    """

    name: str
    parameters: tuple[Parameter, ...]
    offsets: Offsets
    conditions: tuple[str, ...] = ()
    moves: Literal["joints", "frame"] = "joints"
    typical: tuple[float, ...] = ()


def gear(chain: JointSpec) -> Effect:
    """Gear ratios that are off: joint i stands at (1 + e_i) q_i."""
    parameters = tuple(joint_parameter("gear", i, "gear", "ratio") for i in range(chain.size))

    def offsets(joints: Array, _: Array, values: Array) -> tuple[Array, Array]:
        derivative = np.zeros((*joints.shape, chain.size))
        derivative[:, range(chain.size), range(chain.size)] = joints
        return joints * values, derivative

    return Effect("gear", parameters, offsets)


def harmonics(chain: JointSpec, order: int = 1) -> Effect:
    """Runout of gear or encoder: joint i stands at q_i + s_i sin(k q_i) + c_i cos(k q_i), k the order."""
    turning = _turning(chain)
    group = "harmonics" if order == 1 else f"harmonics{order}"
    parameters = tuple(joint_parameter(group, i, f"{wave}{order}") for i in turning for wave in ("sin", "cos"))

    def offsets(joints: Array, _: Array, values: Array) -> tuple[Array, Array]:
        derivative = np.zeros((*joints.shape, len(parameters)))
        for k, i in enumerate(turning):
            derivative[:, i, 2 * k] = np.sin(order * joints[:, i])
            derivative[:, i, 2 * k + 1] = np.cos(order * joints[:, i])
        return derivative @ values, derivative

    return Effect(group, parameters, offsets)


def coupling(chain: JointSpec) -> Effect:
    """Axes that their neighbours drag along: joint i stands at q_i + k_ij q_j, and the last one also by j = i - 2."""
    last, turning = chain.size - 1, _turning(chain)
    pairs = [*((i, i - 1) for i in range(1, chain.size)), *([(last, last - 2)] if last >= 2 else [])]
    pairs = [(i, j) for i, j in pairs if i in turning and j in turning]
    parameters = tuple(joint_parameter("coupling", i, f"coupling{j + 1}", "ratio") for i, j in pairs)

    def offsets(joints: Array, _: Array, values: Array) -> tuple[Array, Array]:
        derivative = np.zeros((*joints.shape, len(pairs)))
        for k, (i, j) in enumerate(pairs):
            derivative[:, i, k] = joints[:, j]
        return derivative @ values, derivative

    return Effect("coupling", parameters, offsets)


def backlash(chain: JointSpec) -> Effect:
    """Play of full width b_i: joint i stands at q_i + a_i b_i / 2, where a_i, its direction of approach, is 1 or -1."""
    kinds: list[Kind] = ["length" if slides else "angle" for slides in chain.prismatic]
    parameters = tuple(
        joint_parameter("backlash", i, "backlash", kind, scale=TYPICAL_BACKLASH) for i, kind in enumerate(kinds)
    )

    def offsets(joints: Array, approach: Array, values: Array) -> tuple[Array, Array]:
        derivative = np.zeros((*joints.shape, chain.size))
        derivative[:, range(chain.size), range(chain.size)] = approach / 2
        return approach * values / 2, derivative

    return Effect("backlash", parameters, offsets, tuple(f"approach_{name}" for name in chain.joint_names))


def compliance(loads: Loads, payload: bool = False) -> Effect:
    """Joints that give way to gravity: joint i stands at q_i + c_i g_i(q + offset), by the drawing's masses.

    The equilibrium is solved by Newton's method, with c the compliances (rad/Nm) of the joints that
    bear the arm's weight and g their torques (``Loads``). With ``payload``, an unknown mass at the
    last frame's origin is fitted too, beside the rows' own ``payload_kg``.
    """
    bearing = loads.bearing(rng_for(0, "structure"))
    group, slides = "payload" if payload else "compliance", loads.chain.prismatic
    units = ["m/N" if slides[i] else "rad/Nm" for i in bearing]
    parameters = tuple(
        joint_parameter(group, i, "compliance", "compliance", unit=unit) for i, unit in zip(bearing, units, strict=True)
    )
    if payload:
        parameters += (Parameter("payload", "mass", group, "mass", "kg", MASS_SCALE_KG),)

    def offsets(joints: Array, conditions: Array, values: Array) -> tuple[Array, Array]:
        soft: Array = np.zeros(loads.chain.size, dtype=np.result_type(values, float))
        soft[list(bearing)] = values[: len(bearing)]
        mass = conditions[:, 0] + (values[-1] if payload else 0.0)
        rest = loads.equilibrium(joints, soft, mass, NEWTON_STEPS)
        pushed = np.zeros((*joints.shape, len(parameters)), dtype=soft.dtype)
        for k, i in enumerate(bearing):
            pushed[:, i, k] = rest.force[:, i]
        if payload:
            pushed[..., -1] = soft * (loads.forces(joints + rest.offset, mass + 1.0)[0] - rest.force)
        rate_of: Array = np.asarray(np.linalg.solve(rest.equations, pushed), dtype=soft.dtype)
        return rest.offset, rate_of

    if payload:
        return Effect(group, parameters, offsets, ("payload_kg",), typical=(*[TYPICAL_COMPLIANCE] * len(bearing), 0.0))
    return Effect(group, parameters, offsets, ("payload_kg",))


def drift(start_s: float = 0.0) -> Effect:
    """A tracker that creeps, or a frame that grows: what is measured moves in proportion to the time from a start."""
    axes = ("x", "y", "z", "rx", "ry", "rz", "scale")
    parameters = placed_parameters("drift", "drift", axes, rate=True, scaled=True)

    def offsets(_: Array, time_s: Array, values: Array) -> tuple[Array, Array]:
        hours = (time_s - start_s) / HOUR_S  # (n, 1)
        return hours * values, hours[:, :, None] * np.eye(7)

    return Effect("drift", parameters, offsets, ("time_s",), "frame")


def sessions(names: Sequence[str]) -> Effect:
    """A tracker, or a foot, that was bumped: every session after the first has a frame moved by a little."""
    axes = ("x", "y", "z", "rx", "ry", "rz")
    moved = [placed_parameters(f"session.{name}", "sessions", axes, scaled=True) for name in names[1:]]
    parameters = tuple(itertools.chain.from_iterable(moved))

    def offsets(_: Array, within: Array, values: Array) -> tuple[Array, Array]:
        derivative = np.zeros((len(within), 7, len(parameters)))
        for k in range(len(names) - 1):
            derivative[:, :6, 6 * k : 6 * k + 6] = within[:, k, None, None] * np.eye(6)
        return derivative @ values, derivative

    return Effect("sessions", parameters, offsets, tuple(SESSION + name for name in names[1:]), "frame")


GROUPS = ("compliance", "payload", "harmonics", "harmonics2", "gear", "coupling", "backlash", "drift", "sessions")
CAMPAIGN_SPECIFIC = ("drift", "sessions")  # groups that say nothing of another day


def effect(name: str, chain: JointSpec, loads: Loads | None, course: SessionInfo = SessionInfo()) -> Effect:
    """The group of that name for an arm; a LabError where there is none, or no masses or sessions for it."""
    if name not in GROUPS:
        raise LabError(f"--model {name}: no such group; there are geometric, auto, {', '.join(GROUPS)}")
    if name in ("compliance", "payload"):
        if loads is None:
            raise LabError(f"--model {name}: robot {chain.name} is a table without masses; give it as MJCF or URDF")
        return compliance(loads, payload=name == "payload")
    if name == "sessions":
        if len(course.sessions) < 2:
            raise LabError(
                f"--model {name}: all rows are of one session; say in a column session which belong together"
            )
        return sessions(course.sessions)
    made: dict[str, Callable[[], Effect]] = {
        "harmonics": lambda: harmonics(chain),
        "harmonics2": lambda: harmonics(chain, 2),
        "gear": lambda: gear(chain),
        "coupling": lambda: coupling(chain),
        "backlash": lambda: backlash(chain),
        "drift": lambda: drift(course.start_s),
    }
    found = made[name]()
    if not found.parameters:
        raise LabError(f"--model {name}: robot {chain.name} has no joint that could have it; leave it out")
    return found


def _turning(chain: JointSpec) -> tuple[int, ...]:
    return tuple(i for i in range(chain.size) if not chain.prismatic[i])
