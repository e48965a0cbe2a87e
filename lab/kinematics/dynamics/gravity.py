"""What gravity does to an arm's joints: the generalized forces of link masses and a payload, in closed form."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.serial.chain import Chain

__all__ = ["LinkFrames", "Loads"]

BEARS = 0.1  # of the largest root mean square torque (force of slides): joints above bear the arm's weight
LEAST_FORCE = 1e-9  # Nm or N: rounding
_POSES = 200


@dataclass(frozen=True)
class LinkFrames:
    """Where the links of an arm are at n poses, in frame 0.

    Attributes:
        axes, anchors: ``(n, joints, 3)``, of each joint; a hinge's anchor is where its link begins.
        rotations: ``(n, joints, 3, 3)`` of each link, as ``dynamics.beam`` has its axes: z is the joint's axis of the
            table, x the common normal that is fixed to the link.
        centres: ``(n, joints, 3)`` m, of each link's mass.
        payload: ``(n, 3)`` m, of a payload's mass.
        end: ``(n, 3)`` m, the last frame's origin.
    """

    axes: Array
    anchors: Array
    rotations: Array
    centres: Array
    payload: Array
    end: Array


@dataclass(frozen=True)
class Equilibrium:
    """Where joints that give way come to rest.

    Attributes:
        offset: ``(n, joints)`` how far they have given way, rad or m.
        force: ``(n, joints)`` Nm (N of a slide), gravity's and what is beside it, before the last step.
        equations: ``(n, joints, joints)`` 1 - C dg/dq there, which any further force is solved by.
    """

    offset: Array
    force: Array
    equations: Array


@dataclass(frozen=True)
class Loads:
    """Masses on the links of a nominal arm, and which way is down.

    Attributes:
        mass_kg: ``(n,)``, of what turns with each joint.
        centre_m: ``(n, 3)``, their centres in the frames of the table that turn with them.
        gravity: ``(3,)`` m/s^2 in frame 0.
        payload_at_m: ``(3,)``, a payload's centre of mass in the last frame.
        link_paths: by link (from 0), its line as a beam (``dynamics.sections.LinkSections``); others are straight.
    """

    chain: Chain
    mass_kg: Array
    centre_m: Array
    gravity: Array
    payload_at_m: Array = field(default_factory=lambda: np.zeros(3))
    link_paths: Mapping[int, Array] = field(default_factory=dict)

    def forces(self, joints: Array, payload_kg: Array) -> tuple[Array, Array]:
        """Gravity's generalized forces and their derivatives by the joints.

        With z_j and o_j the axis of joint j, M_j the mass beyond it and S_j the first moment of that
        about o_j, the torque is g . F_j with F_j = z_j x S_j (M_j z_j of a slide), and turning joint
        i <= j by dq turns F_j: d(g . F_j) / dq_i = g . (z_i x F_j).

        Args:
            joints: joint positions ``(n, joints)``.
            payload_kg: ``(n,)`` at ``payload_at_m``.

        Returns:
            ``(n, joints)`` Nm (N of a slide), positive where gravity pushes the joint position up; and the
            symmetric ``(n, joints, joints)``.
        """
        placed = self.frames(joints)
        axes, slides = placed.axes, np.array(self.chain.prismatic)
        masses = np.tile(self.mass_kg, (len(joints), 1)).astype(np.result_type(payload_kg, float))
        moments = masses[:, :, None] * placed.centres
        moments[:, -1] += payload_kg[:, None] * placed.payload
        masses[:, -1] += payload_kg
        weight, moment = (np.cumsum(each[:, ::-1], axis=1)[:, ::-1] for each in (masses, moments))  # beyond each joint
        weight = weight[:, :, None]
        first_moments = np.where(slides[:, None], weight * axes, np.cross(axes, moment - weight * placed.anchors))
        force = first_moments @ self.gravity
        across = np.where(slides[:, None], 0.0, np.cross(self.gravity, axes))  # g . (z x F) = (g x z) . F
        below = np.triu(across @ first_moments.swapaxes(1, 2))
        rate = below + np.triu(below, 1).swapaxes(1, 2)
        return force, rate

    def equilibrium(
        self, joints: Array, compliance: Array, payload_kg: Array, steps: int, beside: Array | None = None
    ) -> Equilibrium:
        """Solve offset = C (g(q + offset) + h) by Newton's method.

        A fixed number of steps, and not the loop of ``lab.core.newton``: the derivatives need what the last step was
        solved by, and complex compliances pass, for derivatives by complex steps.

        Args:
            joints: q ``(n, joints)``.
            compliance: C ``(joints,)`` rad/Nm (m/N of a slide), zero of joints that do not give way.
            payload_kg: ``(n,)`` at ``payload_at_m``.
            steps: how many, one at least.
            beside: h ``(n, joints)`` Nm (N of a slide) beside gravity's; none at rest.
        """
        offset: Array = np.zeros_like(joints, dtype=np.result_type(joints, compliance))
        for _ in range(steps if np.any(compliance) else 1):  # what is stiff is at rest where it was
            force, rate = self.forces(joints + offset, payload_kg)
            force = force if beside is None else force + beside
            equations: Array = np.eye(len(compliance)) - compliance[:, None] * rate
            off = (compliance * force - offset)[..., None]
            offset = offset + np.asarray(np.linalg.solve(equations, off), dtype=offset.dtype)[..., 0]
        return Equilibrium(offset, force, equations)

    def bearing(self, rng: np.random.Generator) -> tuple[int, ...]:
        """The joints (from 0) that bear the arm's weight anywhere within its limits: hinges and slides apart."""
        force, _ = self.forces(self.chain.random_joints(_POSES, rng), np.zeros(_POSES))
        size = np.sqrt((force**2).mean(axis=0))
        slides = np.array(self.chain.prismatic)
        largest = np.where(slides, size.max(where=slides, initial=0.0), size.max(where=~slides, initial=0.0))
        return tuple(int(j) for j in np.flatnonzero(size > np.maximum(BEARS * largest, LEAST_FORCE)))

    def frames(self, joints: Array) -> LinkFrames:
        """Where the links are at joint positions ``(n, joints)``."""
        count, kind = len(joints), np.result_type(joints, float)
        turned = tuple(np.broadcast_to(row, (count, 3)).astype(kind) for row in np.eye(3))  # the axes of the frame
        position = np.zeros((count, 3), dtype=kind)
        axes, anchors, rotations, centres = [], [], [], []
        distal, sign = self.chain.convention == "distal", self.chain.sign
        for i, (theta, d, a, alpha, beta) in enumerate(self.chain.table):
            reading = sign[i] * joints[:, i]
            angle, slide = (theta, d + reading) if self.chain.prismatic[i] else (theta + reading, d)
            if not distal:
                turned = _about(0, alpha, turned)
                position, turned = position + a * turned[0], _about(1, beta, turned)
            axes.append(sign[i] * turned[2])
            anchors.append(position)
            position = position + np.reshape(slide, (-1, 1)) * turned[2]
            turned = _about(2, angle, turned)
            rotations.append(np.stack(turned, axis=2))
            if distal:
                position = position + a * turned[0]
                turned = _about(1, beta, _about(0, alpha, turned))
            centres.append(position + _along(turned, self.centre_m[i]))
        payload = position + _along(turned, self.payload_at_m)
        return LinkFrames(
            np.stack(axes, 1), np.stack(anchors, 1), np.stack(rotations, 1), np.stack(centres, 1), payload, position
        )


_Axes = tuple[Array, ...]  # a frame's x, y and z, ``(n, 3)`` each


def _about(axis: int, angle: Array, turned: _Axes) -> _Axes:
    """A frame's axes after a turn about one of its own, by an angle ``()`` or ``(n,)``."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    c, s = (np.reshape(function(angle), (-1, 1)) for function in (np.cos, np.sin))
    after = list(turned)
    after[j], after[k] = c * turned[j] + s * turned[k], c * turned[k] - s * turned[j]
    return tuple(after)


def _along(turned: _Axes, vector: Array) -> Array:
    """A vector ``(3,)`` of a frame, in the frame that its axes are given in."""
    return np.asarray(vector[0] * turned[0] + vector[1] * turned[1] + vector[2] * turned[2])
