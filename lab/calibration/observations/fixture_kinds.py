"""What the kinds of observation at fixtures have in common: which rows are of which fixture.

A kind of this family says what a row's fixture is called and what was observed there; a model of ``fixtures`` predicts
it. The kinds are ``cable``, ``socket`` and ``plane``.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from lab.calibration.observations.fixtures import FIXTURE, Fixtures
from lab.calibration.observations.kind import ObservationKind
from lab.calibration.observations.options import FitInputs, ObservationOptions
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.core.wording import counted
from lab.kinematics.model import Model

__all__ = ["FixtureKind", "FixtureRows", "refuse_blank"]


@dataclass(frozen=True)
class FixtureRows:
    """What a file says of fixtures.

    Attributes:
        labels: of each row's fixture, one a row; "" where the file names none.
        observed: ``(n, d)`` m; NaN where nothing was observed.
        warnings: what a reader should be told.
    """

    labels: Sequence[str]
    observed: Array
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class FixtureKind(ObservationKind, ABC):
    """A kind of observation at fixtures: of one target, and of nothing in an instrument's frame."""

    model: ClassVar[type[Fixtures]]
    in_instrument_frame: ClassVar[bool] = False

    @abstractmethod
    def fixture_rows(self, arm: Model, data: Measurements, nominal: Array) -> FixtureRows:
        """What the file says of fixtures.

        Raises:
            LabError: a column is missing, or a cell says what cannot be.
        """

    @abstractmethod
    def fixtures(self, arm: Model, nominal: Array, numbers: tuple[int, ...], labels: tuple[str, ...]) -> Fixtures:
        """The model of these fixtures.

        Raises:
            LabError: an option of the kind does not hold for them.
        """

    @classmethod
    def configured(cls, options: ObservationOptions, fit: FitInputs) -> Self:
        """The kind, whose observations no instrument weighs.

        Raises:
            LabError: an instrument or a validation file is given.
        """
        fit.refuse_those_of_points(cls.name)
        return cls()

    def targets(self, data: Measurements) -> tuple[str, ...]:
        """The target that touches or is tied, whatever points the file has."""
        return ("p1",)

    def observation(self, arm: Model, data: Measurements, nominal: Array) -> tuple[Model, Measurements]:
        """The fixtures that have enough rows, and these rows; a warning for each of the others.

        Raises:
            LabError: the arm has several targets, no fixture has enough rows, or the file says what cannot be.
        """
        if len(arm.targets) != 1:
            raise LabError(f"--observe {self.name} takes one target, not {', '.join(arm.targets)}: name one")
        rows, kind = self.fixture_rows(arm, data, nominal), self.model
        measured = np.asarray(np.isfinite(rows.observed).all(axis=1))
        labels = list(dict.fromkeys(name for name, there in zip(rows.labels, measured.tolist(), strict=True) if there))
        number = np.array([labels.index(name) if name in labels else -1 for name in rows.labels])
        counts = np.array([int((measured & (number == i)).sum()) for i in range(len(labels))])
        few = [i for i in range(len(labels)) if counts[i] < kind.least_rows]
        if len(few) == len(labels):
            most = int(counts.max(initial=0))
            raise LabError(
                f"no {kind.group} has more than {counted(most, 'row')}; its own position takes {len(kind.axes)} "
                f"numbers: measure each from at least {kind.least_rows} poses"
            )
        left_out = tuple(
            f"{kind.group} {labels[i] or 'of the file'} has {counts[i]} of the {kind.least_rows} rows "
            "that say anything of the arm: left out"
            for i in few
        )
        numbers = tuple(i for i in range(len(labels)) if i not in few)
        model = self.fixtures(arm, np.asarray(nominal), numbers, tuple(labels[i] for i in numbers))
        full = replace(
            data,
            targets=model.targets,
            points=rows.observed[:, None],
            conditions={**data.conditions, FIXTURE: number.astype(np.float64)},
            warnings=(*data.warnings, *rows.warnings, *left_out),
        )
        return model, full.take(np.flatnonzero(measured & ~np.isin(number, few)))


def refuse_blank(
    data: Measurements, column: str, labels: Sequence[str], group: str, rows: NDArray[np.bool_] | None = None
) -> None:
    """Refuse rows to be used that do not say which fixture they are of.

    Args:
        data: the file's.
        column: where a label is from.
        labels: one a row.
        group: what a fixture is called.
        rows: ``(n,)`` those with something observed; all, if not given.

    Raises:
        LabError: the label of such a row is empty.
    """
    for row, label in enumerate(labels):
        if not label and data.use[row] != "skip" and (rows is None or rows[row]):
            raise LabError(f"{data.where(row)}, column {column}: empty; say which {group} the row is of, or use = skip")
