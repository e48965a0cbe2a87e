"""A platform on legs solved by other means than the lab's: every assembly mode from scratch, and one way followed.

Hexapod, 3-RRR and 3-PRR alike: points b of the platform are held at distances from points a that joint positions move,
or whose distances they are. The lab follows passive values of a tree of frames by closures; here the platform is a
rotation matrix and a place, moved by the rows (u, R b x u) of the legs' directions u, and the planar robots' modes are
the roots of the polynomial of degree six that eliminating the place leaves (e.g. Merlet, Parallel Robots, 2006).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.core.se3 import Array
from lab.kinematics.closed.mechanism import Mechanism

__all__ = ["Platform", "platform_of"]

SHUT_M = 1e-12
_LEAST_STEP = 1e-4  # of a way
_SMALL = 0.02  # m and rad: a longer correction is no small step along a way


@dataclass(frozen=True)
class Platform:
    """Legs of a robot with certain dimensions.

    Attributes:
        kind: "hexapod", "rrr3" or "prr3".
        p: its dimensions by the lab's names, m and rad.
    """

    kind: str
    p: dict[str, float]

    @property
    def planar(self) -> bool:
        return self.kind != "hexapod"

    @property
    def b(self) -> Array:
        """The legs' ends on the platform ``(k, 3)``."""
        legs = range(1, 4 if self.planar else 7)
        return np.array([[self.p[f"B{i}.x"], self.p[f"B{i}.y"], self.p.get(f"B{i}.z", 0.0)] for i in legs])

    def a(self, joints: Array) -> Array:
        """The legs' other ends ``(n, k, 3)``."""
        p, ends = self.p, []
        for i in range(joints.shape[1]):
            if self.kind == "hexapod":
                ends.append(np.tile([p[f"A{i + 1}.{axis}"] for axis in "xyz"], (len(joints), 1)))
                continue
            frame = f"A{i + 1}" if self.kind == "rrr3" else f"guide{i + 1}"
            angle = p[f"{frame}.rz"] + (joints[:, i] if self.kind == "rrr3" else 0.0)
            along = p[f"elbow{i + 1}.x"] if self.kind == "rrr3" else p[f"slide{i + 1}.x"] + joints[:, i]
            x, y = p[f"{frame}.x"] + along * np.cos(angle), p[f"{frame}.y"] + along * np.sin(angle)
            ends.append(np.stack([x, y, np.zeros(len(joints))], axis=1))
        return np.stack(ends, axis=1)

    def lengths(self, joints: Array) -> Array:
        """Of the legs ``(n, k)``."""
        if self.kind == "hexapod":
            return joints + [self.p[f"leg{i}.length"] for i in range(1, 7)]
        return np.tile([self.p[f"{'link' if self.kind == 'rrr3' else 'rod'}{i}.length"] for i in (1, 2, 3)],
                       (len(joints), 1))  # fmt: skip

    def opened(self, joints: Array, R: Array, t: Array) -> tuple[Array, Array]:
        """How far legs are from their lengths ``(n, k)`` m, and how that moves with the platform ``(n, k, f)``."""
        arms = np.einsum("nij,kj->nki", R, self.b)
        along = t[:, None] + arms - self.a(joints)
        long = np.linalg.norm(along, axis=2)
        u = along / long[..., None]
        rows = np.concatenate([u, np.cross(arms, u)], axis=2)
        return long - self.lengths(joints), rows[..., [0, 1, 5]] if self.planar else rows

    def determinant(self, joints: Array, R: Array, t: Array) -> Array:
        """``(n,)`` of how legs' lengths move with the platform: at parallel singularities alone it changes sign."""
        return np.linalg.det(self.opened(joints, R, t)[1])

    def step(self, R: Array, t: Array, moved: Array) -> tuple[Array, Array]:
        """Moved by velocity and rotation vectors ``(n, f)``."""
        if self.planar:
            moved = np.concatenate([moved[:, :2], np.zeros((len(moved), 3)), moved[:, 2:]], axis=1)
        return Rotation.from_rotvec(moved[:, 3:]).as_matrix() @ R, t + moved[:, :3]

    def newton(self, joints: Array, R: Array, t: Array, rounds: int = 30) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Of these places, each by itself; ``(n,)`` where it ended with all legs as long as they are."""
        for _ in range(rounds):
            gaps, rows = self.opened(joints, R, t)
            if np.abs(gaps).max() < SHUT_M:
                break
            moved = -np.einsum("nij,nj->ni", np.linalg.pinv(rows), gaps)
            most = np.linalg.norm(moved, axis=1, keepdims=True)
            R, t = self.step(R, t, moved * np.minimum(1.0, 0.5 / np.maximum(most, 1e-300)))
        return R, t, np.abs(self.opened(joints, R, t)[0]).max(axis=1) < SHUT_M

    def all_modes(self, joints: Array, rng: np.random.Generator, starts: int = 400) -> list[tuple[Array, Array]]:
        """Every way to assemble it at one pose ``(joints,)``: rotations ``(3, 3)`` with places ``(3,)``."""
        if self.planar:
            R, t = self._of_polynomial(joints)
        else:
            R = Rotation.random(starts, rng=rng).as_matrix()
            t = rng.uniform(-1.0, 1.0, (starts, 3))
        R, t, shut = self.newton(np.tile(joints, (len(R), 1)), R, t, 60)
        found = list[tuple[Array, Array]]()
        for one in zip(R[shut], t[shut], strict=True):
            if all(_apart(one, other) > 1e-7 for other in found):
                found.append(one)
        return found

    def _of_polynomial(self, joints: Array) -> tuple[Array, Array]:
        """Near the real roots: |t + R b - a|^2 = l^2 less its first row is linear in t; of Cramer's rule the rest."""
        a, lengths = self.a(joints[None])[0, :, :2], self.lengths(joints[None])[0]
        angles = 2 * np.pi * np.arange(16) / 16

        def places(angle: Array) -> tuple[Array, Array, Array]:
            c, s = np.cos(angle), np.sin(angle)
            turned = np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)
            w = np.einsum("nij,kj->nki", turned, self.b[:, :2]) - a
            M = 2 * (w[:, 1:] - w[:, :1])
            right = (lengths[1:] ** 2 - lengths[0] ** 2) - (w[:, 1:] ** 2).sum(2) + (w[:, :1] ** 2).sum(2)
            det = M[:, 0, 0] * M[:, 1, 1] - M[:, 0, 1] * M[:, 1, 0]
            over = np.stack([right[:, 0] * M[:, 1, 1] - M[:, 0, 1] * right[:, 1],
                             M[:, 0, 0] * right[:, 1] - right[:, 0] * M[:, 1, 0]], axis=1)  # fmt: skip
            return over, det, w[:, 0]

        over, det, w = places(angles)
        F = ((over + det[:, None] * w) ** 2).sum(1) - (det * lengths[0]) ** 2
        ordered = np.fft.fftshift(np.fft.fft(F) / 16)[2:-1]  # exponents -6 to 6, of which three at each end vanish
        roots = np.roots(ordered[::-1])
        near = np.angle(roots[np.abs(np.abs(roots) - 1) < 1e-3])
        over, det, _ = places(near)
        with np.errstate(all="ignore"):
            t = over / det[:, None]
        fine = np.isfinite(t).all(axis=1)
        return (Rotation.from_rotvec(near[fine, None] * [0, 0, 1]).as_matrix(),
                np.concatenate([t[fine], np.zeros((fine.sum(), 1))], axis=1))  # fmt: skip

    def followed(self, ways: Array, R: Array, t: Array) -> tuple[Array, Array, Array]:
        """From places known at one end of straight ways ``(n, 2, joints)`` to the other, NaN where a way ends.

        Each step is a tangent and corrections that stay small, else it is halved: a way that meets a singularity ends.
        """
        count = len(ways)
        done, step = np.zeros(count), np.full(count, 1 / 16)
        R, t = R.copy(), t.copy()
        while (rows := np.flatnonzero((done < 1) & (step > _LEAST_STEP))).size:
            to = np.minimum(done[rows] + step[rows], 1.0)
            at = ways[rows, 0] + to[:, None] * (ways[rows, 1] - ways[rows, 0])
            before = np.sign(self.determinant(ways[rows, 0] + done[rows, None] * (ways[rows, 1] - ways[rows, 0]),
                                              R[rows], t[rows]))  # fmt: skip
            Rs, ts = R[rows], t[rows]
            smooth = np.ones(len(rows), dtype=bool)
            for round_ in range(6):
                gaps, slopes = self.opened(at, Rs, ts)
                moved = -np.einsum("nij,nj->ni", np.linalg.pinv(slopes), gaps)
                most = _SMALL / 4**round_ + 1e-12
                smooth &= np.abs(moved).max(axis=1) < (5 * most if round_ == 0 else most)
                Rs, ts = self.step(Rs, ts, moved)
            smooth &= np.abs(self.opened(at, Rs, ts)[0]).max(axis=1) < SHUT_M
            smooth &= np.sign(self.determinant(at, Rs, ts)) == before
            there = rows[smooth]
            R[there], t[there], done[there] = Rs[smooth], ts[smooth], to[smooth]
            step[there] = np.minimum(2 * step[there], 1 / 8)
            step[rows[~smooth]] /= 2
        R[done < 1], t[done < 1] = np.nan, np.nan
        return R, t, done


def _apart(one: tuple[Array, Array], other: tuple[Array, Array]) -> float:
    return float(max(np.abs(one[0] - other[0]).max(), np.abs(one[1] - other[1]).max()))


def platform_of(mechanism: Mechanism, values: Array) -> Platform:
    """Of parameters ``(p,)`` in the order of the mechanism's names, or more that follow."""
    return Platform(mechanism.name, dict(zip(mechanism.names, values[: len(mechanism.names)], strict=True)))
