"""A draw-wire: lengths of a cable from a target of the tool to anchors whose positions are fitted."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lab.calibration.observations.anchor_changepoints import found_sessions, with_sessions
from lab.calibration.observations.consistency import disagreement
from lab.calibration.observations.fixture_kinds import FixtureKind, FixtureRows, refuse_blank
from lab.calibration.observations.fixtures import Fixtures
from lab.calibration.observations.kind import ObservationWords
from lab.core.errors import LabError
from lab.core.measurements import Measurements, rows_called
from lab.core.se3 import Array
from lab.formats.measurement_csv import ObservedColumns
from lab.kinematics.model import Model
from lab.kinematics.parameter import Parameter, placed_parameters

__all__ = ["Cable", "CableKind"]


@dataclass(frozen=True)
class Cable(Fixtures):
    """Lengths of a cable from a target to anchors: ``|p - anchor| + offset`` (m).

    The offset is the cable's between its guide and the point whose distance a zero reading means.
    """

    group: ClassVar[str] = "anchor"
    least_rows: ClassVar[int] = 4
    contact: ClassVar[bool] = False
    offset: ClassVar[tuple[Parameter, ...]] = placed_parameters("cable", "cable", ("offset",), scaled=True)

    def predict(self, points: Array, fixtures: Array) -> tuple[Array, Array, Array]:
        """Lengths ``(n, 1)``; they grow along the cable."""
        cable = points - fixtures
        length = np.sqrt((cable * cable).sum(axis=1, keepdims=True))
        along = (cable / length)[:, None]
        return length, along, -along

    def located(self, points: Array, observed: Array) -> Array:
        """The anchor ``(3,)`` by trilateration: |p|^2 - L^2 = 2 p'a - a'a is linear in a and a'a, about the mean."""
        centre = points.mean(axis=0)
        near = points - centre
        system = np.column_stack([2 * near, -np.ones(len(near))]) / observed
        right = ((near**2).sum(axis=1) - observed[:, 0] ** 2) / observed[:, 0]
        return np.asarray(centre + np.linalg.lstsq(system, right)[0][:3])

    def random_fixtures(self, points: Array, rng: np.random.Generator) -> Array:
        """Anchors ``(m, 3)`` at the points themselves."""
        return points


@dataclass(frozen=True)
class CableKind(FixtureKind):
    """Lengths of a cable; a session of the file is an anchor."""

    name: ClassVar[str] = "cable"
    words: ClassVar[ObservationWords] = ObservationWords(
        measured="lengths of a cable",
        reading="length of the cable",
        error="error of the cable's length",
        placed="tool and anchors",
        names_targets=False,
    )
    columns: ClassVar[ObservedColumns] = ObservedColumns(positions=False, numbers=("cable_mm",), observed="cable")
    model: ClassVar[type[Fixtures]] = Cable

    def rows(self, data: Measurements) -> NDArray[np.bool_]:
        """``(n,)``: those with a length."""
        return np.isfinite(data.conditions.get("cable_mm", np.full(len(data), np.nan)))

    def with_sessions(self, arm: Model, data: Measurements, nominal: Array) -> Measurements:
        """The measurements with a session for each anchor that the lengths tell apart, where the file names none."""
        if any(data.sessions):
            return data
        model, observed = self.observation(arm, data, nominal)
        assert isinstance(model, Cable)
        found = found_sessions(model, observed, nominal)
        if len(found) == 1:
            return data
        starts = (0, *rows_called(data, [observed.ids[start] for start in found[1:]]))
        rows = ", ".join(data.ids[start] for start in starts[1:])
        moved = (
            f"the anchor seems to have moved before rows {rows}: {len(starts)} anchors; name them in a column session"
        )
        return replace(with_sessions(data, starts), warnings=(*data.warnings, moved))

    def fixture_rows(self, arm: Model, data: Measurements, nominal: Array) -> FixtureRows:
        """An anchor a session, and the lengths.

        Raises:
            LabError: the lengths are missing, one is not above zero, or a row does not name its session.
        """
        if "cable_mm" not in data.conditions:
            raise LabError("column cable_mm is missing: --observe cable needs the wire's length")
        lengths = data.conditions["cable_mm"] / 1e3
        if (bad := np.flatnonzero(lengths <= 0)).size:
            where = f"{data.where(bad[0])}, column cable_mm"
            raise LabError(f"{where}: a wire's length is above zero; mend it, or leave the cell empty")
        if any(data.sessions):
            refuse_blank(data, "session", data.sessions, Cable.group, np.isfinite(lengths))
        return FixtureRows(data.sessions, lengths[:, None], tuple(_contradictions(arm, data, nominal)))

    def fixtures(self, arm: Model, nominal: Array, numbers: tuple[int, ...], labels: tuple[str, ...]) -> Fixtures:
        """The anchors."""
        return Cable(arm, nominal, numbers, labels)


def _contradictions(arm: Model, data: Measurements, nominal: Array) -> list[str]:
    """Warnings of rows whose point, beside the length, is not where their joints put it."""
    if arm.targets != data.targets:
        return []
    found = disagreement(arm, data, nominal)
    return [
        f"row {data.ids[row]}: its point is {1e3 * size:.3g} mm from where its joints put it: check the row "
        "(the wire's length alone is fitted)"
        for row, size in zip(found.rows.tolist(), found.sizes_m.tolist(), strict=True)
    ]
