"""An arm with its effects as plain numbers, computed by the standard library alone.

``calibrated.py`` of a run is the text of this module with the numbers of one arm, so it imports only Python's own
modules; its functions take these numbers (``model``) as a dictionary:

* ``convention``, ``table`` (theta, d, a, alpha, beta of each link, m and rad), ``sign``, ``prismatic``,
``joint_names``, ``lower``, ``upper``: the identified chain (None for no limit);
* ``base``: pose of frame 0 in the instrument's frame; ``points``: the measured points in the last frame (m); ``tool``:
the rotation of the measured tool there;
* ``conditions``: conditions of a pose, each with its default value (None: required);
* ``loads``: the nominal chain's ``table``, ``mass_kg``, ``centre_m``, ``gravity`` and ``payload_at_m``; ``steps`` of
Newton's method for springs;
* ``terms``: the effects, which add up. Each has one of these forms:
  ``{"joint": i, "times": c, "of": signal}``, an offset of joint i (rad, m of a slide);
  ``{"link": l, "axis": k, "times": c, "of": signal}``, a displacement of link l's far end (x y z rx ry rz of its axes);
  ``{"size": c, "of": signal}``, the relative growth of all lengths about frame 0;
  ``{"springs": compliances, "payload_kg": m}``, joint compliances (rad/Nm, m/N of a slide);
  ``{"beams": {l: rows}}``, bending links: nine loads at rest times these rows are the far end's displacement;
  ``{"residual": share, ...}``, offsets of the joints by the kernels of ``calibration.residual``;
  ``{"call": function, "moves": "joints", "conditions": names, "values": parameters}``, the offsets that an effect's own
  function returns of one pose; with ``"links"``, six of each link's far end, or with ``"size"`` the growth.
* A signal is ``["position", j]``, ``["sin", k, j]`` or ``["cos", k, j]`` of joint j, ``["condition", name, less]``,
``["torque cubed", j]``, or ``["weight", i, l, axis, down]``, the torque of a unit weight on link l about joint i.
"""

# ruff: noqa: B905  # a controller's Python may be older than 3.10, where zip has no strict
from __future__ import annotations

import math
from typing import Any

__all__ = ["in_base", "inverse_of", "place"]

LARGEST_STEP, STEPS, CLOSE_ENOUGH = 0.5, 100, 1e-10  # rad or m; rad and m of what is missed


def place(
    model: dict[str, Any], joints: list[float], conditions: dict[str, float]
) -> tuple[list[list[float]], dict[str, list[float]]]:
    """Pose 4x4 of the last frame and positions of the points, in the instrument's frame (m), at joint positions."""
    T, points, _ = _placed(model, [float(q) for q in joints], _given(model, conditions))
    return T, points


def inverse_of(
    model: dict[str, Any],
    pose: list[list[float]],
    near: list[float],
    point: str | None,
    conditions: dict[str, float],
) -> list[float]:
    """Joint positions at which the last frame, or a point with its axes, has a pose 4x4: Newton's method from near."""
    if point is not None and point not in model["points"]:
        raise ValueError(f"point {point!r} was not measured; there are {', '.join(model['points'])}")
    given, joints, wanted = _given(model, conditions), [float(q) for q in near], _wanted_rotation(model, pose, point)
    missed = [0.0] * 6
    for _ in range(STEPS):
        T, points, motions = _placed(model, joints, given)
        at = _origin(T) if point is None else points[point]
        turn = _rotation_vector(_product(wanted, _transposed(_turn(T))))
        missed = [*_less(_origin(pose), at), *turn]
        if max(map(abs, missed)) < CLOSE_ENOUGH:
            _refuse_beyond_limits(model, joints)
            return joints
        step = _least_squares([_motion(axis, origin, at) for axis, origin in motions], missed)
        size = max(map(abs, step))
        if size < 1e-14:  # nothing brings it nearer
            break
        scale = min(1.0, LARGEST_STEP / size)
        joints = [q + scale * s for q, s in zip(joints, step)]
    where = f"{1e3 * math.hypot(*missed[:3]):.3g} mm and {1e3 * math.hypot(*missed[3:]):.3g} mrad"
    text = f"not reached from here with {len(joints)} joints (missed by {where})"
    raise ValueError(f"pose: {text}; give near closer to it")


def _wanted_rotation(model: dict[str, Any], pose: list[list[float]], point: str | None) -> list[list[float]]:
    """Rotation of the last frame for a pose of it, or of a point with the tool's axes."""
    wanted = [[float(c) for c in row[:3]] for row in pose[:3]]
    wanted = wanted if point is None else _product(wanted, _transposed(model["tool"]))
    across = _product(wanted, _transposed(wanted))
    if max(abs(across[i][j] - (i == j)) for i in range(3) for j in range(3)) > 1e-6:
        raise ValueError("pose: its first three rows and columns are not a rotation; give a 4x4 pose")
    return wanted


def _refuse_beyond_limits(model: dict[str, Any], joints: list[float]) -> None:
    for name, q, low, high in zip(model["joint_names"], joints, model["lower"], model["upper"]):
        if (low is not None and q < low - 1e-6) or (high is not None and q > high + 1e-6):
            raise ValueError(f"joint {name} would be at {q:.6g}, beyond its limits {low:.6g} to {high:.6g}")


def _motion(axis: list[float], origin: list[float] | None, at: list[float]) -> list[float]:
    """Velocity and angular velocity at a place by a joint of this axis; a slide has no origin."""
    return [*axis, 0.0, 0.0, 0.0] if origin is None else [*_cross(axis, _less(at, origin)), *axis]


def in_base(model: dict[str, Any], pose: list[list[float]]) -> list[list[float]]:
    """A pose 4x4 of the instrument's frame in frame 0 of the table."""
    base, at = model["base"], _origin(pose)
    back = _transposed(_turn(base))
    turn = _product(back, _turn(pose))
    moved = [_dot(row, _less(at, _origin(base))) for row in back]
    return [[*turn[i], moved[i]] for i in range(3)] + [[0.0, 0.0, 0.0, 1.0]]


def _given(model: dict[str, Any], conditions: dict[str, float]) -> dict[str, float]:
    known = model["conditions"]
    for name in conditions:
        if name not in known:
            raise TypeError(f"condition {name!r} has no effect on this arm; valid are {list(known) or 'none'}")
    for name, usual in known.items():
        if name not in conditions and usual is None:
            raise TypeError(f"condition {name!r} is missing: the model needs it; give forward(joints, **{{...}})")
    return {name: float(conditions.get(name, usual)) for name, usual in known.items()}


def _placed(model: dict[str, Any], joints: list[float], given: dict[str, float]) -> tuple[Any, Any, list[Any]]:
    """Pose, points, and of each joint its axis, along which it counts positive, and a place on it (None of a slide)."""
    n = len(model["table"])
    if len(joints) != n or not all(map(math.isfinite, joints)):
        raise ValueError(f"joints {joints}: give {n} finite positions, in rad (m of a slide)")
    offsets, ends, growth = _effects(model, joints, given)
    frame, at, motions = _walked(model, _plus(joints, offsets), ends)
    # all lengths grow about the base
    foot = _origin(model["base"])
    at, *places = [_along(p, growth, _less(p, foot)) for p in
                   (at, *(_combined(at, point, frame) for point in model["points"].values()))]  # fmt: skip
    T = [[*axes, c] for axes, c in zip(_transposed(frame), at)] + [[0.0, 0.0, 0.0, 1.0]]
    return T, dict(zip(model["points"], places)), motions


def _walked(
    model: dict[str, Any], joints: list[float], ends: dict[int, list[float]]
) -> tuple[Any, list[float], list[Any]]:
    """Axes and origin of the last frame, and each joint's axis and a place on it, at displaced joints and links."""
    base, distal = model["base"], model["convention"] == "distal"
    frame, at = _transposed(_turn(base)), _origin(base)  # axes as rows
    motions: list[Any] = []
    for i, (theta, d, a, alpha, beta) in enumerate(model["table"]):
        reading, slides = model["sign"][i] * joints[i], model["prismatic"][i]
        angle, slide = (theta, d + reading) if slides else (theta + reading, d)
        if not distal:  # alpha and a come before the joint (Craig 1986)
            if i:
                frame, at = _displaced(frame, at, _along(at, a, frame[0]), ends.get(i - 1))
            at = _along(at, a, frame[0])
            frame = _about(1, beta, _about(0, alpha, frame))
        motions.append(([model["sign"][i] * c for c in frame[2]], None if slides else at))
        frame = _about(2, angle, frame)
        at = _along(at, slide, frame[2])
        if distal:  # a and alpha come after it (Denavit and Hartenberg 1955)
            at = _along(at, a, frame[0])
            frame, at = _displaced(frame, at, at, ends.get(i))
            frame = _about(1, beta, _about(0, alpha, frame))
    if not distal:
        frame, at = _displaced(frame, at, at, ends.get(len(joints) - 1))
    return frame, at, motions


def _displaced(frame: Any, at: list[float], end: list[float], torsor: list[float] | None) -> tuple[Any, list[float]]:
    """Axes and an origin that a link's far end carries, after its displacement there."""
    if torsor is None:
        return frame, at
    turn = _rotation(torsor[3:])
    turned = [[sum(turn[k][j] * frame[k][i] for k in range(3)) for i in range(3)] for j in range(3)]
    lever = _less(at, end)
    local = [_dot(frame[k], lever) + torsor[k] for k in range(3)]
    return turned, [end[i] + sum(local[k] * turned[k][i] for k in range(3)) for i in range(3)]


def _effects(
    model: dict[str, Any], joints: list[float], given: dict[str, float]
) -> tuple[list[float], dict[int, list[float]], float]:
    """Sum all effects: offsets of the joints, displacements of links' far ends by link, and growth."""
    offsets, growth = [0.0] * len(joints), 0.0
    ends: dict[int, list[float]] = {}
    for term in model["terms"]:
        if "springs" in term:
            for i, more in enumerate(_sag(model, joints, term, given)):
                offsets[i] += more
        elif "beams" in term:
            loads = _link_loads(model, joints, given)
            for link, rows in term["beams"].items():
                end = ends.setdefault(link, [0.0] * 6)
                for k in range(6):
                    end[k] += sum(load * row[k] for load, row in zip(loads[link], rows))
        elif "residual" in term:
            for i, more in enumerate(_residual(term, joints)):
                offsets[i] += more
        elif "call" in term:
            more = term["call"](list(joints), [given[name] for name in term["conditions"]], list(term["values"]))
            if term["moves"] == "joints":
                offsets = _plus(offsets, more)
            elif term["moves"] == "size":
                growth += more[0]
            for k, link in enumerate(term["links"]):
                ends[link] = _plus(ends.setdefault(link, [0.0] * 6), more[6 * k : 6 * k + 6])
        else:
            signal = _signal(model, term["of"], joints, given)
            if "joint" in term:
                offsets[term["joint"]] += term["times"] * signal
            elif "link" in term:
                ends.setdefault(term["link"], [0.0] * 6)[term["axis"]] += term["times"] * signal
            else:
                growth += term["size"] * signal
    return offsets, ends, growth


def _signal(model: dict[str, Any], of: list[Any], joints: list[float], given: dict[str, float]) -> float:
    kind = of[0]
    if kind == "position":
        return float(joints[of[1]])
    if kind in ("sin", "cos"):
        return math.sin(of[1] * joints[of[2]]) if kind == "sin" else math.cos(of[1] * joints[of[2]])
    if kind == "condition":
        return float(given[of[1]] - of[2])
    if kind == "torque cubed":
        return float(_torques(model, joints, given.get("payload_kg", 0.0))[0][of[1]] ** 3)
    _, joint, link, axis, down = of
    placed = _nominal_frames(model, joints)
    return _dot(_cross(down, placed["axes"][joint]), placed["frames"][link][axis])


def _nominal_frames(model: dict[str, Any], joints: list[float]) -> dict[str, Any]:
    """Compute the nominal links in frame 0: axes and anchors of joints, axes of links, centres of mass."""
    loads, distal = model["loads"], model["convention"] == "distal"
    frame, at = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [0.0, 0.0, 0.0]
    placed: dict[str, Any] = {"axes": [], "anchors": [], "frames": [], "centres": []}
    for i, (theta, d, a, alpha, beta) in enumerate(loads["table"]):
        reading = model["sign"][i] * joints[i]
        angle, slide = (theta, d + reading) if model["prismatic"][i] else (theta + reading, d)
        if not distal:
            frame = _about(0, alpha, frame)
            at = _along(at, a, frame[0])
            frame = _about(1, beta, frame)
        placed["axes"].append([model["sign"][i] * c for c in frame[2]])
        placed["anchors"].append(at)
        at = _along(at, slide, frame[2])
        frame = _about(2, angle, frame)
        placed["frames"].append(frame)
        if distal:
            at = _along(at, a, frame[0])
            frame = _about(1, beta, _about(0, alpha, frame))
        placed["centres"].append(_combined(at, loads["centre_m"][i], frame))
    placed["payload"], placed["end"] = _combined(at, loads["payload_at_m"], frame), at
    return placed


def _torques(model: dict[str, Any], joints: list[float], payload_kg: float) -> tuple[list[float], list[list[float]]]:
    """Gravity's torques about the joints (forces of slides), Nm and N, and their derivatives by the joints."""
    loads, placed, n = model["loads"], _nominal_frames(model, joints), len(joints)
    gravity, first = loads["gravity"], [[0.0] * 3] * n
    weight, moment = payload_kg, [payload_kg * c for c in placed["payload"]]
    for j in reversed(range(n)):
        mass, axis = loads["mass_kg"][j], placed["axes"][j]
        weight += mass
        moment = [m + mass * c for m, c in zip(moment, placed["centres"][j])]
        if model["prismatic"][j]:
            first[j] = [weight * c for c in axis]
        else:
            first[j] = _cross(axis, [m - weight * c for m, c in zip(moment, placed["anchors"][j])])
    rate = [[0.0] * n for _ in range(n)]
    for i in range(n):
        if not model["prismatic"][i]:
            across = _cross(gravity, placed["axes"][i])
            for j in range(i, n):
                rate[i][j] = rate[j][i] = _dot(across, first[j])
    return [_dot(gravity, each) for each in first], rate


def _sag(model: dict[str, Any], joints: list[float], term: dict[str, Any], given: dict[str, float]) -> list[float]:
    """Solve the equilibrium of compliant joints: offset = compliance times torque there, by Newton's method."""
    soft, n = term["springs"], len(joints)
    payload = given.get("payload_kg", 0.0) + term["payload_kg"]
    offset = [0.0] * n
    for _ in range(model["loads"]["steps"]):
        force, rate = _torques(model, [q + o for q, o in zip(joints, offset)], payload)
        rows = [[(i == j) - soft[i] * rate[i][j] for j in range(n)] for i in range(n)]
        offset = [o + s for o, s in zip(offset, _solved(rows, [soft[i] * force[i] - offset[i] for i in range(n)]))]
    return offset


def _link_loads(model: dict[str, Any], joints: list[float], given: dict[str, float]) -> list[list[float]]:
    """Force and moment at each link's far end and gravity, nine numbers in the link's axes, summed from the hand in."""
    loads, placed, n = model["loads"], _nominal_frames(model, joints), len(joints)
    gravity, payload = loads["gravity"], given.get("payload_kg", 0.0)
    force, moment, at = [payload * g for g in gravity], [0.0] * 3, placed["payload"]
    loads_at_ends: list[list[float]] = []
    for j in reversed(range(n)):
        far = placed["end"] if j == n - 1 else placed["anchors"][j + 1]
        moment, at = _plus(moment, _cross(_less(at, far), force)), far
        axes = placed["frames"][j]
        loads_at_ends.append([_dot(axis, vector) for vector in (force, moment, gravity) for axis in axes])
        weight = [loads["mass_kg"][j] * g for g in gravity]
        moment = _plus(moment, _cross(_less(placed["centres"][j], at), weight))
        force = _plus(force, weight)
    return loads_at_ends[::-1]


def _residual(term: dict[str, Any], joints: list[float]) -> list[float]:
    """Offsets by Gaussian processes: Matern's of each joint's own position, and of all positions."""
    own, every, smooth = term["own"], term["all"], term["smooth"]  # pairs of a length and a variance
    offsets = [0.0] * len(joints)
    for pose, weights in zip(term["poses"], term["weights"]):
        apart = [
            2 * math.sin((q - p) / 2) if turns else (q - p) / term["slide_m"]
            for q, p, turns in zip(joints, pose, term["turning"])
        ]
        whole = math.hypot(*apart)
        common = sum(size * math.exp(-whole / length) for length, size in every)
        for length, size in smooth:
            scaled = math.sqrt(5) * whole / length
            common += size * (1 + scaled + scaled**2 / 3) * math.exp(-scaled)
        for i, weight in enumerate(weights):
            kernel = common
            for length, size in own:
                scaled = math.sqrt(3) * abs(apart[i]) / length
                kernel += size * (1 + scaled) * math.exp(-scaled)
            offsets[i] += term["residual"] * kernel * weight
    return offsets


def _turn(pose: Any) -> list[list[float]]:
    return [row[:3] for row in pose[:3]]


def _origin(pose: Any) -> list[float]:
    return [row[3] for row in pose[:3]]


def _about(axis: int, angle: float, frame: Any) -> Any:
    """A frame's axes after a turn about one of its own."""
    j, k, c, s = (axis + 1) % 3, (axis + 2) % 3, math.cos(angle), math.sin(angle)
    after = list(frame)
    after[j] = [c * p + s * q for p, q in zip(frame[j], frame[k])]
    after[k] = [c * q - s * p for p, q in zip(frame[j], frame[k])]
    return after


def _along(at: list[float], length: float, axis: list[float]) -> list[float]:
    return [p + length * c for p, c in zip(at, axis)]


def _combined(at: list[float], vector: list[float], frame: Any) -> list[float]:
    return [at[i] + sum(vector[k] * frame[k][i] for k in range(3)) for i in range(3)]


def _plus(a: list[float], b: list[float]) -> list[float]:
    return [p + q for p, q in zip(a, b)]


def _less(a: list[float], b: list[float]) -> list[float]:
    return [p - q for p, q in zip(a, b)]


def _dot(a: list[float], b: list[float]) -> float:
    return sum(p * q for p, q in zip(a, b))


def _cross(a: list[float], b: list[float]) -> list[float]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _transposed(matrix: Any) -> Any:
    return [list(column) for column in zip(*matrix)]


def _product(a: Any, b: Any) -> Any:
    return [[_dot(row, column) for column in _transposed(b)] for row in a]


def _rotation(vector: list[float]) -> Any:
    """The rotation matrix of a rotation vector."""
    angle = math.hypot(*vector)
    first, second = (math.sin(angle) / angle, (math.sin(angle / 2) / angle) ** 2 * 2) if angle > 1e-150 else (1.0, 0.5)
    x, y, z = vector
    cross = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    square = _product(cross, cross)
    return [[(i == j) + first * cross[i][j] + second * square[i][j] for j in range(3)] for i in range(3)]


def _rotation_vector(R: Any) -> list[float]:
    """The rotation vector of a rotation matrix."""
    odd = [(R[2][1] - R[1][2]) / 2, (R[0][2] - R[2][0]) / 2, (R[1][0] - R[0][1]) / 2]
    sine, cosine = math.hypot(*odd), (R[0][0] + R[1][1] + R[2][2] - 1) / 2
    angle = math.atan2(sine, cosine)
    if sine > 1e-8 or cosine > 0:
        return [c * (angle / sine if sine > 1e-12 else 1.0) for c in odd]
    i = max(range(3), key=lambda k: R[k][k])  # half a turn
    column = [(R[k][i] + R[i][k]) / 2 + (k == i) for k in range(3)]
    return [angle * c / math.hypot(*column) for c in column]


def _least_squares(columns: list[list[float]], wanted: list[float]) -> list[float]:
    """The step whose columns come nearest to what is wanted; of more than six joints the shortest."""
    n = len(columns)
    if n > 6:
        rows = [[sum(c[i] * c[j] for c in columns) for j in range(6)] for i in range(6)]
        duals = _solved(rows, wanted)
        return [_dot(column, duals) for column in columns]
    if n == 6:
        return _solved(_transposed(columns), wanted)
    return _solved([[_dot(a, b) for b in columns] for a in columns], [_dot(a, wanted) for a in columns])


def _solved(rows: list[list[float]], right: list[float]) -> list[float]:
    """Gaussian elimination with partial pivoting."""
    n, work = len(rows), [[*row, b] for row, b in zip(rows, right)]
    for i in range(n):
        pivot = max(range(i, n), key=lambda k: abs(work[k][i]))
        if abs(work[pivot][i]) < 1e-14:
            raise ValueError("the arm is singular here; give near elsewhere")
        work[i], work[pivot] = work[pivot], work[i]
        for k in range(i + 1, n):
            share = work[k][i] / work[i][i]
            work[k] = [p - share * q for p, q in zip(work[k], work[i])]
    solution = [0.0] * n
    for i in reversed(range(n)):
        solution[i] = (work[i][n] - sum(work[i][j] * solution[j] for j in range(i + 1, n))) / work[i][i]
    return solution
