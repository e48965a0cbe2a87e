"""Calculate the reference pairs of docs/reference/pairs with 50 correct digits, independently of the lab.

Each pair is a robot, joint positions and measured points with the least-squares answer: parameters, residuals, rank,
covariance and predicted points. Kinematics, derivatives and the fit are written here anew, in mpmath with 60 digits;
nothing of the lab is imported. ``docs/reference/reference_pairs.md`` has the formulas.

    python scripts/maintenance/reference_pairs.py                 # all sets, several minutes
    python scripts/maintenance/reference_pairs.py scara ppp       # some
"""

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

try:
    import mpmath
    from mpmath import mp, mpf
except ImportError as error:
    raise SystemExit("mpmath is missing: pip install mpmath") from error

__all__ = ["DIGITS", "FOLDER", "SETS", "calculate", "inputs", "observed", "radians", "read", "start_of"]

FOLDER = Path(__file__).parents[2] / "docs" / "reference" / "pairs"
Number = Any  # an mpf: mpmath has no types
Vector = list[Number]
Matrix = list[Vector]

DIGITS = 60  # of the arithmetic
PRINTED = 30  # of the results
LAST_STEP = mpf("1e-45")  # m or rad: a Gauss-Newton step below it ends the fit
RANK_TOLERANCE = mpf("1e-20")  # of what remains of a column of unit norm, in QR with column pivoting
ZERO = mpf("1e-52")  # m, rad, m^2: rounding of the arithmetic, printed as 0
DIFFERENCE = mpf("1e-25")  # of central differences, against which the derivatives are checked
_ANGLES = ("theta", "alpha", "beta", "rx", "ry", "rz")  # in degrees in the inputs
_MAX_STEPS = 400


# Pseudo-random numbers, rounded to decimals: the inputs of the sets


class Noise:
    """Knuth's linear congruential generator of 64 bits; the upper 53 of them make a number from 0 to 1."""

    def __init__(self, seed: int) -> None:
        self.state = seed

    def uniform(self) -> float:
        """Return the next number from 0 to 1."""
        self.state = (6364136223846793005 * self.state + 1442695040888963407) % 2**64
        return (self.state >> 11) / 2**53

    def between(self, low: float, high: float, digits: int) -> float:
        """Return a number from a range, rounded."""
        return round(low + (high - low) * self.uniform(), digits)

    def normal(self) -> float:
        """Return a nearly normal number of variance one: twelve uniform ones less six."""
        return sum(self.uniform() for _ in range(12)) - 6


@dataclass(frozen=True)
class Case:
    """Definition of a set, from which its inputs are generated.

    Attributes:
        tests: what the set tests.
        convention: ``distal`` or ``craig``; ``3-RPR`` and ``five-bar`` for closed chains.
        table: theta (deg), d (m), a (m), alpha (deg) of each joint.
        fixed: parameters that are not estimated; the others are.
        targets: points in the last frame (m).
        drawn: range of each joint (deg, m of a slide) at the measured poses; None for the range of the robot.
        base: what the base is, before measurements: x, y, z (m), rx, ry, rz (deg); the truth is near.
        sigma: standard deviation of a coordinate (m); a pair is the range of the rows'; None if not given.
        missing: share of the points that are not seen.
        still: joint (from 0) that has one position everywhere.
    """

    tests: str
    table: tuple[tuple[float, float, float, float], ...]
    fixed: tuple[str, ...]
    poses: int
    targets: Mapping[str, tuple[float, float, float]]
    convention: str = "distal"
    slides: tuple[int, ...] = ()
    parallel: tuple[int, ...] = ()
    limits: tuple[tuple[float, float], ...] = ()
    drawn: tuple[tuple[float, float], ...] | None = None
    base: tuple[float, ...] = (0.8, -0.4, 0.1, 3.0, -2.0, 25.0)
    sigma: float | tuple[float, float] | None = 1e-5
    exact: bool = False
    missing: float = 0.0
    still: int | None = None


_ONE = {"p1": (0.03, 0.02, 0.1)}
_THREE = {"p1": (0.03, 0.02, 0.1), "p2": (-0.025, 0.03, 0.08), "p3": (0.0, -0.04, 0.09)}
_IRB120 = ((0, 0.29, 0, -90), (-90, 0, 0.27, 0), (0, 0, 0.07, -90), (0, 0.302, 0, 90), (0, 0, 0, -90), (0, 0.072, 0, 0))
_UR = ((0, 0.09, 0, 90), (0, 0, -0.425, 0), (0, 0, -0.392, 0), (0, 0.109, 0, 90), (0, 0.095, 0, -90), (0, 0.082, 0, 0))
_SIX_LIMITS = ((-150, 150), (-90, 90), (-90, 60), (-150, 150), (-110, 110), (-170, 170))
_LAST = ("link6.theta", "link6.d", "link6.a", "link6.alpha")
_IRB120_FIXED = ("link1.theta", "link1.d", "link2.d", *_LAST)
_BASE = ("base.x", "base.y", "base.z", "base.rx", "base.ry", "base.rz")
_RPR = {
    "A1.x": -0.433, "A1.y": -0.25, "A2.x": 0.433, "A2.y": -0.25, "A3.x": 0.0, "A3.y": 0.5,
    "B1.x": 0.0, "B1.y": -0.12, "B2.x": 0.104, "B2.y": 0.06, "B3.x": -0.104, "B3.y": 0.06,
    "leg1.length": 0.0, "leg2.length": 0.0, "leg3.length": 0.0,
}  # fmt: skip


_FIVE_BAR = {
    "crank1.x": -0.15, "crank1.y": 0.0, "crank1.rz": 0.0, "crank2.x": 0.15, "crank2.y": 0.0, "crank2.rz": 0.0,
    "elbow1.x": 0.25, "elbow2.x": 0.25, "rod1.length": 0.4, "rod2.length": 0.4,
}  # fmt: skip
_MECHANISMS = {"3-RPR": _RPR, "five-bar": _FIVE_BAR}


def _six(tests: str, **options: Any) -> Case:
    given = {"table": _IRB120, "fixed": _IRB120_FIXED, "poses": 40, "targets": _ONE, "parallel": (1,)}
    return Case(tests, **{"limits": _SIX_LIMITS, **given, **options})


SETS: dict[str, Case] = {
    "planar-2r": Case(
        "A planar arm whose base, lengths and offset are estimated.",
        table=((0, 0, 0.4, 0), (0, 0, 0, 0)),
        fixed=("base.z", "base.rx", "base.ry", "link1.theta", "link1.d", "link1.alpha", "link1.beta", "link2.theta",
               "link2.d", "link2.a", "link2.alpha", "tool.p1.z"),
        poses=15, targets={"p1": (0.3, 0.0, 0.0)}, parallel=(0,), limits=((-150, 150), (-150, 150)),
        base=(0.2, -0.1, 0.0, 0.0, 0.0, 10.0),
    ),
    "scara": Case(
        "Four parallel axes, the third of a slide; the noise is not given, but estimated from the residuals.",
        table=((0, 0.4, 0.3, 0), (0, 0, 0.25, 180), (0, 0, 0, 0), (0, 0.1, 0, 0)),
        fixed=("link1.theta", "link1.d", "link2.d", "link2.a", "link3.theta", "link3.d", "link4.theta", "link4.d",
               "link4.a", "link4.alpha", "tool.p1.z"),
        poses=40, targets=_ONE, slides=(2,), parallel=(0, 1, 2), sigma=None,
        limits=((-130, 130), (-140, 140), (0, 0.3), (-170, 170)),
    ),
    "ppp": Case(
        "A gantry: three slides, whose directions alone are estimated.",
        table=((0, 0, 0, 90), (90, 0, 0, 90), (0, 0, 0, 0)),
        fixed=("link1.theta", "link1.d", "link1.a", "link2.d", "link2.a", "link3.theta", "link3.d", "link3.a",
               "link3.alpha", "tool.p1.x", "tool.p1.y", "tool.p1.z"),
        poses=20, targets=_ONE, slides=(0, 1, 2), limits=((0, 1.2), (0, 0.9), (0, 0.6)), sigma=2e-5,
    ),
    "rpr": Case(
        "A hinge, a slide and a hinge.",
        table=((0, 0.35, 0, 90), (0, 0.2, 0, 90), (0, 0.1, 0.15, 0)),
        fixed=("link1.theta", "link1.d", "link1.a", "link3.theta", "link3.d", "link3.a", "link3.alpha", "tool.p1.z"),
        poses=30, targets=_ONE, slides=(1,), limits=((-150, 150), (0, 0.4), (-150, 150)),
    ),
    "near-parallel": Case(
        "Craig's convention; axes 2 and 3, and 3 and 4, are parallel to a milliradian: Hayati's beta.",
        table=((0, 0.3, 0, 0), (0, 0, 0.05, 90), (0, 0, 0.4, 0), (0, 0.05, 0.3, 0)), convention="craig",
        fixed=("link1.theta", "link1.d", "link1.a", "link1.alpha", "link2.d", "link3.d", "link4.theta", "link4.d"),
        poses=40, targets=_ONE, parallel=(2, 3), limits=((-150, 150), (-90, 90), (-120, 120), (-150, 150)),
    ),
    "six-axes": _six("Six hinges with a spherical wrist, of the size of an IRB 120; one target."),
    "three-targets": _six("The same arm with three targets.", targets=_THREE, poses=25),
    "missing-points": _six("Three targets, of which three in ten were not seen.", targets=_THREE, missing=0.3),
    "weights": _six("Rows of standard deviations from 5 to 200 micrometres.", sigma=(5e-6, 2e-4)),
    "exact": _six(
        "Points without noise, to 40 digits: the truth must come out. Three parallel axes.", exact=True, table=_UR,
        fixed=("link1.theta", "link1.d", "link2.d", "link3.d", *_LAST), parallel=(1, 2),
    ),
    "rank-deficient": _six(
        "Every parameter of the table and of the base is free, though sums of them alone are determined.",
        fixed=("link2.d",),
    ),
    "still-joint": _six(
        "The fourth joint never moves; predictions are for that position.", fixed=("link2.d",), still=3, targets=_THREE,
        poses=25,
    ),
    "small-region": _six(
        "Ill-conditioned: each joint moves by 12 degrees at most.", poses=60,
        drawn=((-6, 6), (4, 16), (-26, -14), (34, 46), (44, 56), (-66, -54)),
    ),
    "tiny-region": _six(
        "More ill-conditioned: each joint moves by 4 degrees at most.", poses=60, sigma=1e-6,
        drawn=((-2, 2), (8, 12), (-22, -18), (38, 42), (48, 52), (-62, -58)),
    ),
    "planar-3rpr": Case(
        "A closed chain: the platform's pose solves three equations of legs of measured lengths.",
        table=(), convention="3-RPR", fixed=(*_BASE, "B1.x", "B1.y", "B2.y"), poses=30,
        targets={"p1": (0.0, 0.0, 0.05), "p2": (0.1, 0.0, 0.05)}, base=(0.0,) * 6,
        limits=((0.4, 0.55), (0.4, 0.55), (0.4, 0.55)), slides=(0, 1, 2),
    ),
    "five-bar": Case(
        "A closed chain of hinges: two cranks carry a point by two rods; one point in five was not seen.",
        table=(), convention="five-bar", fixed=(*_BASE, "tool.p1.x", "tool.p1.y"), poses=30,
        targets={"p1": (0.0, 0.0, 0.03)}, base=(0.0,) * 6, limits=((95, 135), (45, 85)), missing=0.2,
    ),
}  # fmt: skip


def by_hand() -> dict[str, Any]:
    """Return the inputs of the set whose answer is a fraction: lengths of a planar arm at multiples of 90 degrees."""
    found = _stated("planar-by-hand", SETS["planar-2r"], {name: mpf(0) for name in _BASE})
    found["tests"] = (
        "A linear problem with an answer in fractions: two lengths of a planar arm, joints at right angles."
    )
    found["nominal"] |= dict.fromkeys(_BASE, 0)
    found["free"] = ["link1.a", "tool.p1.x"]
    found["measurements"] = {
        "joints": [[0, 0], [90, 0], [0, 90], [90, 90], [180, -90], [-90, 180]],
        "points": [
            [[0.7002, 0, 0]],
            [[0.0001, 0.6999, 0]],
            [[0.4001, 0.3002, 0]],
            [[-0.3001, 0.4003, 0]],
            [[-0.4002, 0.2999, 0]],
            [[0, -0.1001, 0]],
        ],
        "sigma_m": None,
    }
    found["predict"] = [[0, 180], [45, 0], [30, 60]]
    return found


# Kinematics


def read(text: str) -> dict[str, Any]:
    """Read the inputs of a pair: its decimals exactly."""
    with mp.workdps(DIGITS):
        found: dict[str, Any] = json.loads(text, parse_float=mpf, parse_int=mpf)
    return found


def _rotation(axis: int, angle: Number) -> Matrix:
    c, s, i, j = mp.cos(angle), mp.sin(angle), (axis + 1) % 3, (axis + 2) % 3
    R = [[mpf(row == column) for column in range(3)] for row in range(3)]
    R[i][i], R[i][j], R[j][i], R[j][j] = c, -s, s, c
    return R


def _product(A: Matrix, B: Matrix) -> Matrix:
    columns = list(zip(*B, strict=True))
    return [[mp.fdot(zip(row, column, strict=True)) for column in columns] for row in A]


def _times(A: Matrix, v: Sequence[Number]) -> Vector:
    return [mp.fdot(zip(row, v, strict=True)) for row in A]


def _plus(a: Sequence[Number], b: Sequence[Number]) -> Vector:
    return [x + y for x, y in zip(a, b, strict=True)]


def _minus(a: Sequence[Number], b: Sequence[Number]) -> Vector:
    return [x - y for x, y in zip(a, b, strict=True)]


def _cross(a: Sequence[Number], b: Sequence[Number]) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _column(R: Matrix, axis: int) -> Vector:
    return [row[axis] for row in R]


def _of_vector(r: Vector) -> tuple[Matrix, Matrix]:
    """Return the rotation of a rotation vector, and its left Jacobian, by Rodrigues' formula."""
    size = mp.sqrt(mp.fdot(zip(r, r, strict=True)))
    K = [[mpf(0), -r[2], r[1]], [r[2], mpf(0), -r[0]], [-r[1], r[0], mpf(0)]]
    KK = _product(K, K)
    one = [[mpf(i == j) for j in range(3)] for i in range(3)]
    if size == 0:
        return one, one
    s, c = mp.sin(size) / size, (1 - mp.cos(size)) / size**2
    t = (1 - s) / size**2
    R, J = ([[one[i][j] + x * K[i][j] + y * KK[i][j] for j in range(3)] for i in range(3)] for x, y in ((s, c), (c, t)))
    return R, J


def _serial(robot: Mapping[str, Any], values: Mapping[str, Number], joints: Vector) -> Iterator[tuple[str, str, int]]:
    """Yield the parameters of the links in the order of their motions: name, kind and axis."""
    order = (
        ("theta", "d", "a", "alpha", "beta")
        if robot["convention"] == "distal"
        else ("alpha", "a", "beta", "theta", "d")
    )
    axes = {"theta": ("turn", 2), "d": ("shift", 2), "a": ("shift", 0), "alpha": ("turn", 0), "beta": ("turn", 1)}
    for i, joint in enumerate(robot["joints"]):
        for column in order:
            if column != "beta" or joint["beta"]:
                yield f"link{i + 1}.{column}", *axes[column]


def observed(
    pair: Mapping[str, Any], values: Mapping[str, Number], joints: Vector
) -> list[tuple[Vector, dict[str, Vector]]]:
    """Return each target's position and its derivatives by all parameters.

    Args:
        joints: rad, m of a slide.
    """
    robot = pair["robot"]
    walks = {"3-RPR": _observed_3rpr, "five-bar": _observed_five_bar}
    return walks.get(robot["convention"], _observed_serial)(robot, values, joints)


def _observed_serial(
    robot: Mapping[str, Any], values: Mapping[str, Number], joints: Vector
) -> list[tuple[Vector, dict[str, Vector]]]:
    place = [values[f"base.{axis}"] for axis in "xyz"]
    R, J = _of_vector([values[f"base.r{axis}"] for axis in "xyz"])
    o, moved = place, {}
    for name, kind, axis in _serial(robot, values, joints):
        i, column = int(name[4 : name.index(".")]) - 1, name.rsplit(".", 1)[1]
        amount = values[name]
        if column == ("d" if robot["joints"][i]["type"] == "prismatic" else "theta"):
            amount = amount + joints[i]
        moved[name] = (kind, _column(R, axis), o)
        if kind == "turn":
            R = _product(R, _rotation(axis, amount))
        else:
            o = _plus(o, [amount * x for x in _column(R, axis)])
    found = []
    for target in robot["targets"]:
        p = _plus(o, _times(R, [values[f"tool.{target}.{axis}"] for axis in "xyz"]))
        by = {f"base.{axis}": [mpf(i == k) for k in range(3)] for i, axis in enumerate("xyz")}
        by |= {f"base.r{axis}": _cross(_column(J, i), _minus(p, place)) for i, axis in enumerate("xyz")}
        by |= {name: z if kind == "shift" else _cross(z, _minus(p, at)) for name, (kind, z, at) in moved.items()}
        by |= {f"tool.{target}.{axis}": _column(R, i) for i, axis in enumerate("xyz")}
        found.append((p, by))
    return found


def _observed_3rpr(
    robot: Mapping[str, Any], values: Mapping[str, Number], joints: Vector
) -> list[tuple[Vector, dict[str, Vector]]]:
    """Solve |P + R(phi) B_i - A_i| = length_i + q_i for the platform by Newton's method; derivatives are implicit."""
    A, B = ([[values[f"{end}{i}.{axis}"] for axis in "xy"] for i in (1, 2, 3)] for end in "AB")
    lengths = [values[f"leg{i + 1}.length"] + joints[i] for i in range(3)]
    x = [mpf(0), mpf(0), mpf(0)]
    while True:
        c, s = mp.cos(x[2]), mp.sin(x[2])
        u = [[x[0] + c * b[0] - s * b[1] - a[0], x[1] + s * b[0] + c * b[1] - a[1]] for a, b in zip(A, B, strict=True)]
        slopes = [
            [2 * w[0], 2 * w[1], 2 * (w[0] * (-s * b[0] - c * b[1]) + w[1] * (c * b[0] - s * b[1]))]
            for w, b in zip(u, B, strict=True)
        ]
        step = mp.lu_solve(
            mp.matrix(slopes), mp.matrix([w[0] ** 2 + w[1] ** 2 - n**2 for w, n in zip(u, lengths, strict=True)])
        )
        x = [each - step[i] for i, each in enumerate(x)]
        if max(map(abs, step)) < mpf("1e-55"):
            break
    inverse = mp.inverse(mp.matrix(slopes))
    by_loops: dict[str, tuple[int, Number]] = {}
    for i, (w, n) in enumerate(zip(u, lengths, strict=True)):
        by_loops |= {f"A{i + 1}.x": (i, -2 * w[0]), f"A{i + 1}.y": (i, -2 * w[1]), f"leg{i + 1}.length": (i, -2 * n)}
        by_loops |= {f"B{i + 1}.x": (i, 2 * (c * w[0] + s * w[1])), f"B{i + 1}.y": (i, 2 * (c * w[1] - s * w[0]))}
    found = []
    for target in robot["targets"]:
        t = [values[f"tool.{target}.{axis}"] for axis in "xyz"]
        turned = [-s * t[0] - c * t[1], c * t[0] - s * t[1]]
        by = {}
        for name, (i, slope) in by_loops.items():
            d = [-inverse[k, i] * slope for k in range(3)]
            by[name] = [d[0] + turned[0] * d[2], d[1] + turned[1] * d[2], mpf(0)]
        by |= {
            f"tool.{target}.{axis}": v
            for axis, v in zip("xyz", ([c, s, mpf(0)], [-s, c, mpf(0)], [mpf(0), mpf(0), mpf(1)]), strict=True)
        }
        found.append(([x[0] + c * t[0] - s * t[1], x[1] + s * t[0] + c * t[1], t[2]], by))
    return found


def _observed_five_bar(
    robot: Mapping[str, Any], values: Mapping[str, Number], joints: Vector
) -> list[tuple[Vector, dict[str, Vector]]]:
    """Intersect the circles of the rods around the cranks' ends, to the left of the way from end 1 to end 2."""
    ends, turned = [], []
    for i in (1, 2):
        angle, size = values[f"crank{i}.rz"] + joints[i - 1], values[f"elbow{i}.x"]
        turned.append((mp.cos(angle), mp.sin(angle)))
        ends.append([values[f"crank{i}.x"] + size * turned[-1][0], values[f"crank{i}.y"] + size * turned[-1][1]])
    first, second = values["rod1.length"], values["rod2.length"]
    along = _minus(ends[1], ends[0])
    between = mp.sqrt(along[0] ** 2 + along[1] ** 2)
    reach = (between**2 + first**2 - second**2) / (2 * between)
    height = mp.sqrt(first**2 - reach**2)
    x, y = along[0] / between, along[1] / between
    P = [ends[0][0] + reach * x - height * y, ends[0][1] + reach * y + height * x]
    u = [_minus(P, end) for end in ends]
    determinant = u[0][0] * u[1][1] - u[0][1] * u[1][0]
    found = []
    for target in robot["targets"]:
        t = [values[f"tool.{target}.{axis}"] for axis in "xyz"]
        by = {f"tool.{target}.{axis}": [mpf(i == k) for k in range(3)] for i, axis in enumerate("xyz")}
        for i, w in enumerate(u):  # w dP = w dE + length dlength, and nothing for the other rod
            size, (c, s) = values[f"elbow{i + 1}.x"], turned[i]
            other = [u[1][1], -u[1][0]] if i == 0 else [-u[0][1], u[0][0]]
            pushes = {"crank.x": w[0], "crank.y": w[1], "crank.rz": size * (c * w[1] - s * w[0])}
            pushes |= {"elbow.x": c * w[0] + s * w[1], "rod.length": values[f"rod{i + 1}.length"]}
            for name, push in pushes.items():
                part, column = name.split(".")
                by[f"{part}{i + 1}.{column}"] = [*(push * each / determinant for each in other), mpf(0)]
        found.append(([P[0] + t[0], P[1] + t[1], t[2]], by))
    return found


# Least squares


@dataclass(frozen=True)
class Triangle:
    """QR factorization of columns scaled to unit norm: those that others do not span, in the order taken."""

    taken: list[int]
    scale: Vector
    R: Matrix
    right: Vector

    def solved(self, right: Sequence[Number]) -> Vector:
        """Solve R x = right, and undo the scaling."""
        n = len(self.taken)
        x = [mpf(0)] * n
        for i in reversed(range(n)):
            rest = right[i] - mp.fdot((self.R[i][j], x[j]) for j in range(i + 1, n))
            x[i] = rest / self.R[i][i]
        return [value / scale for value, scale in zip(x, self.scale, strict=True)]

    def root(self) -> Matrix:
        """Return the inverse of R with the scaling undone: the covariance is its product with its transpose."""
        n = len(self.taken)
        columns = [self.solved([mpf(i == j) for i in range(n)]) for j in range(n)]
        return [list(row) for row in zip(*columns, strict=True)]


def factorized(columns: Matrix, right: Vector, order: Sequence[int] | None = None) -> Triangle:
    """Factorize columns by Gram-Schmidt, pivoting on the largest, or in a given order; dependent ones are left out."""
    norms = [mp.sqrt(mp.fdot(zip(c, c, strict=True))) for c in columns]
    left = [i for i in (range(len(columns)) if order is None else order) if norms[i] > 0]
    rest = {i: [x / norms[i] for x in columns[i]] for i in left}
    taken, rows, projected = [], [], []
    y = right
    while left:
        sizes = {i: mp.fdot(zip(rest[i], rest[i], strict=True)) for i in left}
        left = [i for i in left if sizes[i] > RANK_TOLERANCE**2]
        if not left:
            break
        first = left[0] if order is not None else max(left, key=lambda i: sizes[i])
        left.remove(first)
        size = mp.sqrt(sizes[first])
        q = [x / size for x in rest.pop(first)]
        row = {first: size}
        for i in left:
            row[i] = mp.fdot(zip(q, rest[i], strict=True))
            rest[i] = [x - row[i] * z for x, z in zip(rest[i], q, strict=True)]
        part = mp.fdot(zip(q, y, strict=True))
        y = [x - part * z for x, z in zip(y, q, strict=True)]
        taken.append(first)
        rows.append(row)
        projected.append(part)
    R = [[row.get(i, mpf(0)) for i in taken] for row in rows]
    return Triangle(taken, [norms[i] for i in taken], R, projected)


@dataclass(frozen=True)
class Solution:
    """Least-squares solution: values, residuals (m), weights and the factorized weighted derivatives."""

    values: dict[str, Number]
    names: list[str]
    residuals: Vector
    weights: Vector
    triangle: Triangle


def start_of(pair: Mapping[str, Any]) -> dict[str, Number]:
    """Return the nominal values of all parameters, in m and rad."""
    return {
        name: mpf(value) * (mp.pi / 180 if name.rsplit(".", 1)[1] in _ANGLES else 1)
        for name, value in pair["nominal"].items()
    }


def radians(pair: Mapping[str, Any], joints: Sequence[Any]) -> Vector:
    """Return joint positions in rad, m of a slide."""
    kinds = [joint["type"] for joint in pair["robot"]["joints"]]
    return [mpf(q) * (1 if kind == "prismatic" else mp.pi / 180) for q, kind in zip(joints, kinds, strict=True)]


def _rows(pair: Mapping[str, Any]) -> Iterator[tuple[Vector, list[Any], Number]]:
    measured = pair["measurements"]
    sigma = measured["sigma_m"] or [1] * len(measured["joints"])
    for joints, points, each in zip(measured["joints"], measured["points"], sigma, strict=True):
        yield radians(pair, joints), points, 1 / mpf(each)


def solve(
    pair: Mapping[str, Any], order: Sequence[int] | None = None, *, only: Sequence[str] | None = None
) -> Solution:
    """Fit the free parameters by Gauss-Newton; a rank-deficient problem moves independent columns alone.

    Args:
        order: in which columns are taken, in place of pivoting.
        only: the parameters to move.
    """
    names = list(only or pair["free"])
    values = start_of(pair)
    for _ in range(_MAX_STEPS):
        residuals, weights, columns = [], [], [[] for _ in names]  # type: tuple[Vector, Vector, Matrix]
        for joints, points, weight in _rows(pair):
            for point, (p, by) in zip(points, observed(pair, values, joints), strict=True):
                if point is None:
                    continue
                residuals += _minus([mpf(x) for x in point], p)
                weights += [weight] * 3
                for name, column in zip(names, columns, strict=True):
                    column += [weight * x for x in by.get(name, (mpf(0),) * 3)]
        right = [r * w for r, w in zip(residuals, weights, strict=True)]
        triangle = factorized(columns, right, order)
        step = triangle.solved(triangle.right)
        if max(map(abs, step)) < LAST_STEP:
            return Solution(values, names, residuals, weights, triangle)
        if len(step) < len(names):  # the columns of the first step are kept: the others stay where they are
            names, order = [names[i] for i in triangle.taken], None
            triangle = Triangle(list(range(len(names))), triangle.scale, triangle.R, triangle.right)
        for i, change in zip(triangle.taken, step, strict=True):
            values[names[i]] += change
    raise ArithmeticError(f"{pair['name']}: not converged after {_MAX_STEPS} steps")


def _text(x: Number) -> str:
    return str(mp.nstr(x, PRINTED, strip_zeros=False, min_fixed=0, max_fixed=0)) if abs(x) > ZERO else "0"


def _predicted(pair: Mapping[str, Any], found: Solution, variance: Number) -> list[list[tuple[Vector, Vector]]]:
    """Return points, and the upper triangles of their covariances, at the configurations to predict."""
    root, taken = found.triangle.root(), [found.names[i] for i in found.triangle.taken]
    result = []
    for joints in pair["predict"]:
        each = []
        for p, by in observed(pair, found.values, radians(pair, joints)):
            slopes = [[by.get(name, (mpf(0),) * 3)[axis] for name in taken] for axis in range(3)]
            half = _product(slopes, root)
            C = [[variance * mp.fdot(zip(a, b, strict=True)) for b in half] for a in half]
            each.append((p, [C[i][j] for i in range(3) for j in range(i, 3)]))
        result.append(each)
    return result


def _check_derivatives(pair: Mapping[str, Any], values: Mapping[str, Number]) -> None:
    """Compare the derivatives with central differences at one pose."""
    joints = radians(pair, pair["predict"][0])
    for name in pair["free"]:
        ends = [observed(pair, {**values, name: values[name] + step}, joints) for step in (DIFFERENCE, -DIFFERENCE)]
        for (p, _), (m, _), (_, by) in zip(*ends, observed(pair, values, joints), strict=True):
            slope = [(a - b) / (2 * DIFFERENCE) for a, b in zip(p, m, strict=True)]
            error = max(map(abs, _minus(slope, by.get(name, (mpf(0),) * 3))))
            if error > mpf("1e-33"):
                raise ArithmeticError(f"{pair['name']}: derivatives by {name} are off by {mp.nstr(error, 3)}")


def _check_gauge(pair: Mapping[str, Any], found: Solution, variance: Number) -> None:
    """Solve a rank-deficient problem with other columns: sums of squares and predictions must be the same."""
    other = solve(pair, list(reversed(range(len(pair["free"])))))
    a, b = (_predicted(pair, each, variance) for each in (found, other))
    off = [max(map(abs, _minus(found.residuals, other.residuals)))]
    off += [max(map(abs, _minus(p, q))) for x, y in zip(a, b, strict=True) for (p, _), (q, _) in zip(x, y, strict=True)]
    off += [max(map(abs, _minus(c, d))) for x, y in zip(a, b, strict=True) for (_, c), (_, d) in zip(x, y, strict=True)]
    if other.names == found.names or max(off) > mpf("1e-35"):
        raise ArithmeticError(f"{pair['name']}: results depend on the choice of parameters by {mp.nstr(max(off), 3)}")


def calculate(pair: Mapping[str, Any]) -> dict[str, Any]:
    """Return the results of a pair, as decimals of 30 digits.

    Args:
        pair: its inputs, as ``read`` returns them.
    """
    with mp.workdps(DIGITS):
        found = solve(pair)
        rank, rows = len(found.triangle.taken), len(found.residuals)
        total = mp.fsum((r * w) ** 2 for r, w in zip(found.residuals, found.weights, strict=True))
        factor = total / (rows - rank)
        variance = mpf(1) if pair["measurements"]["sigma_m"] else factor
        _check_derivatives(pair, found.values)
        whole = rank == len(pair["free"])
        if not whole:
            _check_gauge(pair, found, variance)
        singular = mpmath.svd_r(mp.matrix(found.triangle.R), compute_uv=False)
        seen = iter(found.residuals)
        results: dict[str, Any] = {
            "rank": rank,
            "degrees_of_freedom": rows - rank,
            "condition": mp.nstr(singular[0] / singular[rank - 1], 6),
            "sum_of_squares": _text(total),
            "variance_factor": _text(factor),
            "residuals_m": [
                [None if point is None else [_text(next(seen)) for _ in range(3)] for point in points]
                for points in pair["measurements"]["points"]
            ],
            "predicted": [
                [{"point_m": list(map(_text, p)), "covariance_m2": list(map(_text, C))} for p, C in each]
                for each in _predicted(pair, found, variance)
            ],
        }
        if whole:
            root = found.triangle.root()
            at = [found.triangle.taken.index(i) for i in range(rank)]
            C = [[variance * mp.fdot(zip(root[i], root[j], strict=True)) for j in at] for i in at]
            results["parameters"] = {name: _text(found.values[name]) for name in pair["free"]}
            results["covariance"] = [[_text(C[i][j]) for j in range(i, rank)] for i in range(rank)]
        return results


# Inputs of the sets


def _stated(name: str, case: Case, base: Mapping[str, Any]) -> dict[str, Any]:
    """Return a pair's robot with its nominal values, without measurements."""
    kinds = ["prismatic" if i in case.slides else "revolute" for i in range(len(case.limits))]
    joints: list[dict[str, Any]] = [
        {"type": kind, "beta": i in case.parallel, "limits": list(limits)}
        for i, (kind, limits) in enumerate(zip(kinds, case.limits, strict=True))
    ]
    nominal: dict[str, Any] = dict(base)
    for i, row in enumerate(case.table):
        nominal |= {f"link{i + 1}.{column}": x for column, x in zip(("theta", "d", "a", "alpha"), row, strict=True)}
        nominal |= {f"link{i + 1}.beta": 0} if i in case.parallel else {}
    nominal |= _MECHANISMS.get(case.convention, {})
    for target, point in case.targets.items():
        nominal |= {f"tool.{target}.{axis}": x for axis, x in zip("xyz", point, strict=True)}
    return {
        "schema": 1,
        "name": name,
        "tests": case.tests,
        "robot": {"convention": case.convention, "joints": joints, "targets": list(case.targets)},
        "nominal": nominal,
        "free": [each for each in nominal if each not in case.fixed],
    }


def inputs(name: str) -> dict[str, Any]:
    """Generate the inputs of a set: robot, joint positions and measured points, as short decimals."""
    if name == "planar-by-hand":
        return by_hand()
    case, noise = SETS[name], Noise(1 + list(SETS).index(name))
    pair = _stated(name, case, dict(zip(_BASE, case.base, strict=True)))
    angles = {each for each in pair["nominal"] if each.rsplit(".", 1)[1] in _ANGLES}
    size = {each: 0.06 if each in angles else 5e-4 for each in pair["nominal"]}  # deg or m
    truth = {
        each: float(value) + (noise.between(-size[each], size[each], 6) if each in pair["free"] else 0.0)
        for each, value in pair["nominal"].items()
    }
    drawn = case.drawn or case.limits

    def joints() -> list[float]:
        found = [noise.between(*ends, 2 if i not in case.slides else 4) for i, ends in enumerate(drawn)]
        return [20.0 if i == case.still else q for i, q in enumerate(found)]

    rows: dict[str, Any] = {"joints": [joints() for _ in range(case.poses)], "points": [], "sigma_m": None}
    if isinstance(case.sigma, tuple):
        low, high = case.sigma
        rows["sigma_m"] = [round(low * (high / low) ** noise.uniform(), 7) for _ in range(case.poses)]
    elif case.sigma is not None:
        rows["sigma_m"] = [case.sigma] * case.poses
    exact = read(json.dumps({**pair, "nominal": truth}))
    for i, each in enumerate(rows["joints"]):
        points = observed(exact, start_of(exact), radians(exact, read(json.dumps({"q": each}))["q"]))
        sigma = rows["sigma_m"][i] if rows["sigma_m"] else 1e-5
        row: list[Any] = []
        for p, _ in points:
            if case.exact:
                row.append([mp.nstr(x, 40) for x in p])
                continue
            noisy = [round(float(x) + sigma * noise.normal(), 7) for x in p]
            row.append(None if noise.uniform() < case.missing else noisy)
        rows["points"].append(row)
    return {**pair, "measurements": rows, "predict": [joints() for _ in range(3)]}


def _write(name: str) -> Path:
    with mp.workdps(DIGITS):
        pair = inputs(name)
        pair["results"] = calculate(read(json.dumps(pair)))
    lines = [f"  {json.dumps(key)}: {_laid_out(value)}" for key, value in pair.items()]
    path = FOLDER / f"{name}.json"
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    return path


def _laid_out(value: Any) -> str:
    """Return JSON with a line for each row of a list, and each entry of an object."""
    if isinstance(value, dict):
        return "{\n" + ",\n".join(f"    {json.dumps(key)}: {_rows_of(each)}" for key, each in value.items()) + "\n  }"
    return _rows_of(value)


def _rows_of(value: Any) -> str:
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[\n" + ",\n".join(f"      {json.dumps(each)}" for each in value) + "\n    ]"
    return json.dumps(value)


def main() -> None:
    """Write the sets that the command line names, or all."""
    names = ["planar-by-hand", *SETS]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"sets to write: {', '.join(names)}; by default all")
    chosen = parser.parse_args().names or names
    if unknown := [each for each in chosen if each not in names]:
        parser.error(f"{unknown[0]}: no such set; there are {', '.join(names)}")
    FOLDER.mkdir(exist_ok=True)
    for name in chosen:
        path = _write(name)
        print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
