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
        axes, anchors, centres, ends = placed.axes, placed.anchors, placed.centres, placed.payload
        size, slides = self.chain.size, self.chain.prismatic
        weight = np.zeros(len(joints), dtype=centres.dtype)
        moment = np.zeros((len(joints), 3), dtype=centres.dtype)
        turned: list[Array] = [moment] * size
        for j in reversed(range(size)):
            weight = weight + self.mass_kg[j]
            moment = moment + self.mass_kg[j] * centres[:, j]
            if j == size - 1:
                weight, moment = weight + payload_kg, moment + payload_kg[:, None] * ends
            turned[j] = weight[:, None] * axes[:, j]
            if not slides[j]:
                turned[j] = np.cross(axes[:, j], moment - weight[:, None] * anchors[:, j])
        force = np.stack([each @ self.gravity for each in turned], axis=1)
        rate = np.zeros((len(joints), size, size), dtype=centres.dtype)
        for j in range(size):
            for i in range(j + 1):
                if not slides[i]:
                    rate[:, i, j] = rate[:, j, i] = np.cross(axes[:, i], turned[j]) @ self.gravity
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
        for _ in range(steps):
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
        rotation = np.broadcast_to(np.eye(3), (count, 3, 3)).astype(kind)
        position = np.zeros((count, 3), dtype=kind)
        axes, anchors, rotations, centres = [], [], [], []
        distal, sign = self.chain.convention == "distal", self.chain.sign
        for i, (theta, d, a, alpha, beta) in enumerate(self.chain.table):
            reading = sign[i] * joints[:, i]
            angle, slide = (theta + 0 * reading, d + reading) if self.chain.prismatic[i] else (theta + reading, d)
            if not distal:
                position = position + a * (rotation := rotation @ _about(0, alpha))[:, :, 0]
                rotation = rotation @ _about(1, beta)
            axes.append(sign[i] * rotation[:, :, 2])
            anchors.append(position)
            position = position + np.reshape(slide, (-1, 1)) * rotation[:, :, 2]
            rotation = rotation @ _about(2, angle)
            rotations.append(rotation)
            if distal:
                position = position + a * rotation[:, :, 0]
                rotation = rotation @ _about(0, alpha) @ _about(1, beta)
            centres.append(position + rotation @ self.centre_m[i])
        payload = position + rotation @ self.payload_at_m
        return LinkFrames(
            np.stack(axes, 1), np.stack(anchors, 1), np.stack(rotations, 1), np.stack(centres, 1), payload, position
        )


def _about(axis: int, angle: Array) -> Array:
    """Rotations ``(..., 3, 3)`` about a coordinate axis."""
    angle = np.asarray(angle)
    c, s = np.cos(angle), np.sin(angle)
    out = np.zeros((*angle.shape, 3, 3), dtype=np.result_type(angle, float))
    j, k = (axis + 1) % 3, (axis + 2) % 3
    out[..., axis, axis] = 1
    out[..., j, j], out[..., k, k], out[..., k, j], out[..., j, k] = c, c, s, -s
    return out
