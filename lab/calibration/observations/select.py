"""What of a file is observed: the model and the measurements of each kind of sighting."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.calibration.observations.consistency import disagreement
from lab.calibration.observations.fixture_kinds import Cable, Planes, Sockets
from lab.calibration.observations.fixtures import PLACE, Fixtures
from lab.calibration.observations.full_pose import QUATERNION, START_RATIO, Poses
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.formats.orientations import Meaning, oriented_target, read_orientations
from lab.kinematics.model import Model

ObservationKind = Literal["points", "pose", "cable", "socket", "plane"]


@dataclass(frozen=True)
class ObservationOptions:
    """What to observe of a file that may hold several kinds, and what is known beside it.

    Attributes:
        kind: of sighting.
        orientation: what three angles of a pose mean.
        ratio: noise of a rotation over that of a position, rad per m; None to start at 1 mrad per mm.
        socket_distance_m: between the two sockets of a location; None if unknown.
    """

    kind: ObservationKind = "points"
    orientation: Meaning | None = None
    ratio: float | None = None
    socket_distance_m: float | None = None


def sighted(
    arm: Model, data: Measurements, nominal: Array, observing: ObservationOptions
) -> tuple[Model, Measurements]:
    """The model that predicts what is observed, and the measurements with it as their points.

    Args:
        arm: seen by points: of the targets of ``data`` for points and poses, else of one target.
        nominal: the drawing's parameters of ``arm``.

    Raises:
        LabError: a column is missing, or says what cannot be.
    """
    if observing.kind == "points":
        return arm, data
    if observing.kind == "pose":
        return _poses(arm, data, observing)
    if len(arm.targets) != 1:
        raise LabError(f"--observe {observing.kind} takes one target, not {', '.join(arm.targets)}: name one")
    if observing.kind == "cable":
        if "cable_mm" not in data.conditions:
            raise LabError("column cable_mm is missing: --observe cable needs the wire's length")
        lengths = data.conditions["cable_mm"] / 1e3
        if (bad := np.flatnonzero(lengths <= 0)).size:
            where = f"{data.where(bad[0])}, column cable_mm"
            raise LabError(f"{where}: a wire's length is above zero; mend it, or leave the cell empty")
        if any(data.sessions):
            _refuse_blank(Cable, data, "session", data.sessions, np.isfinite(lengths))
        data = replace(data, warnings=(*data.warnings, *_contradictions(arm, data, nominal)))
        return _placed(Cable, arm, nominal, data, data.sessions, lengths[:, None, None])
    if observing.kind == "plane":
        column = "location" if "location" in data.other else "session"
        names = data.other.get("location", data.sessions)
        if any(names):
            _refuse_blank(Planes, data, column, names)
        return _placed(Planes, arm, nominal, data, names, np.zeros((len(data), 1, 1)))
    for column in ("location", "socket"):
        if column not in data.other:
            raise LabError(f"column {column} is missing: --observe socket needs location and socket in every row")
        _refuse_blank(Sockets, data, column, data.other[column])
    pairs = zip(data.other["location"], data.other["socket"], strict=True)
    names = tuple(f"{place}.{socket}" for place, socket in pairs)
    model, seen = _placed(Sockets, arm, nominal, data, names, np.zeros((len(data), 1, 3)))
    assert isinstance(model, Sockets)
    return _with_distance(model, observing.socket_distance_m), seen


def _poses(arm: Model, data: Measurements, observing: ObservationOptions) -> tuple[Model, Measurements]:
    """Positions and the orientation of one target."""
    target = oriented_target(data)
    measured = read_orientations(data, target, observing.orientation)
    blank = np.isnan(measured[:, 0])
    rotation = np.where(blank[:, None, None], np.nan, np.zeros((len(data), 1, 3)))
    stated = np.where(blank[:, None], [1.0, 0.0, 0.0, 0.0], measured)
    model = Poses(arm, target, START_RATIO if observing.ratio is None else observing.ratio)
    turned = {f"{target}_{part}": stated[:, i] for i, part in enumerate(QUATERNION)}
    points = np.concatenate([data.points, rotation], axis=1)
    return model, replace(data, targets=model.targets, points=points, conditions={**data.conditions, **turned})


def _placed(
    kind: type[Cable] | type[Sockets] | type[Planes],
    arm: Model,
    nominal: Array,
    data: Measurements,
    names: Sequence[str],
    observed: Array,
) -> tuple[Fixtures, Measurements]:
    """Rows by the names of their places; places of too few rows are left out with a warning."""
    seen = np.asarray(np.isfinite(observed).all(axis=(1, 2)))
    labels = list(dict.fromkeys(name for name, there in zip(names, seen.tolist(), strict=True) if there))
    number = np.array([labels.index(name) if name in labels else -1 for name in names])
    counts = np.array([int((seen & (number == i)).sum()) for i in range(len(labels))])
    few = [i for i in range(len(labels)) if counts[i] < kind.least_rows]
    if len(few) == len(labels):
        most = int(counts.max(initial=0))
        rows_of = "1 row" if most == 1 else f"{most} rows"
        raise LabError(
            f"no {kind.group} has more than {rows_of}; its own place takes {len(kind.axes)} numbers: "
            f"measure each from at least {kind.least_rows} poses"
        )
    told = tuple(
        f"{kind.group} {labels[i] or 'of the file'} has {counts[i]} of the {kind.least_rows} rows "
        "that say anything of the arm: left out"
        for i in few
    )
    rows = np.flatnonzero(seen & ~np.isin(number, few))
    numbers = tuple(i for i in range(len(labels)) if i not in few)
    model = kind(arm, np.asarray(nominal), numbers, tuple(labels[i] for i in numbers))
    full = replace(
        data,
        targets=model.targets,
        points=observed,
        conditions={**data.conditions, PLACE: number.astype(np.float64)},
        warnings=(*data.warnings, *told),
    )
    return model, full.take(rows)


def _refuse_blank(
    kind: type[Fixtures], data: Measurements, column: str, names: Sequence[str], rows: NDArray[np.bool_] | None = None
) -> None:
    """Rows to be used say which place they are of.

    Args:
        rows: ``(n,)`` those with something observed; all, if not given.
    """
    for row, name in enumerate(names):
        if not name and data.use[row] != "skip" and (rows is None or rows[row]):
            raise LabError(
                f"{data.where(row)}, column {column}: empty; say which {kind.group} the row is of, or use = skip"
            )


def _contradictions(arm: Model, data: Measurements, nominal: Array) -> list[str]:
    """What a reader should be told where the points beside a wire's length are not those of the joints."""
    if arm.targets != data.targets:
        return []
    found = disagreement(arm, data, nominal)
    return [
        f"row {data.ids[row]}: its point is {1e3 * size:.3g} mm from where its joints put it: check the row "
        "(the wire's length alone is fitted)"
        for row, size in zip(found.rows.tolist(), found.sizes_m.tolist(), strict=True)
    ]


def _with_distance(model: Sockets, distance_m: float | None) -> Sockets:
    """The sockets with the distance between the two of a location."""
    if distance_m is None:
        return model
    locations = [label.rpartition(".")[0] for label in model.labels]
    for location in dict.fromkeys(locations):
        if locations.count(location) > 2:
            raise LabError(
                f"location {location} has {locations.count(location)} sockets: --socket-distance-mm is that of two; "
                "leave it out, or name pairs as locations of their own"
            )
    return replace(model, distance_m=distance_m)
