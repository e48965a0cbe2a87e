"""Model the errors of measured numbers beside the instrument's, as estimated from one set of measurements.

The model, in SI units, gives the shared errors of any measurements of the same arm: of those that it was estimated
from, of held-out poses, and of another session.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.core.measurements import Measurements, setups
from lab.core.se3 import Array
from lab.core.units import MM
from lab.noise.error_term import TERMS, ErrorTerm, terms_with

__all__ = ["Clock", "ErrorModel", "row_times", "session_of", "within_session"]

_APART = 1e9  # units of time, from the first pose of a session to the first of the next


@dataclass(frozen=True)
class Clock:
    """The time of a campaign, in units of the spacing of its poses.

    Attributes:
        middle: the mean time of its poses.
        half_span: from there to the last.
        origin_s, spacing_s: origin and unit in ``time_s``; None where rows are counted.
        sessions: in their order.
    """

    middle: float
    half_span: float
    origin_s: float = 0.0
    spacing_s: float | None = None
    sessions: tuple[tuple[str, str], ...] = ()

    @staticmethod
    def of(data: Measurements) -> "Clock":
        """Return the clock of measured rows; sessions are laid side by side."""
        seconds, origin, spacing = data.conditions.get("time_s", np.full(len(data), np.nan)), 0.0, None
        if np.isfinite(seconds).all() and (gaps := np.diff(np.sort(seconds))).size and np.median(gaps) > 0:
            origin, spacing = float(seconds.min()), float(np.median(gaps))
        clock = Clock(0.0, 1.0, origin, spacing, tuple(dict.fromkeys(setups(data))))
        within = within_session(row_times(data, clock))
        half_span = float(max(np.abs(within - within.mean()).max(), 1.0))
        return replace(clock, middle=float(within.mean()), half_span=half_span)


@dataclass(frozen=True)
class ErrorModel:
    """Standard deviations of the errors that numbers share, term by term.

    Attributes:
        sigma_m: of the instrument, of one coordinate, as estimated beside them.
        independent_share: share of a given instrument's variance that is independent from pose to pose.
        sizes: by the name of the term, without those of zero.
        clock: of that campaign; None for another session, after a drift of unknown end.
        values: parameters by name, at which the derivatives by the joints are taken.
        carry: the correlation of the autoregressive term from one pose to the next.
        counts_rad: ``(J, J)`` a root of the covariance of joint positions from rounding to encoder counts (rad, m);
            None for ideal encoders, or counts too fine to be weighted.
    """

    sigma_m: float
    independent_share: float
    sizes: Mapping[str, float]
    clock: Clock | None
    values: Mapping[str, float]
    carry: float = 0.0
    counts_rad: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "sizes", {name: size for name, size in self.sizes.items() if size})

    def size(self, name: str) -> float:
        """Return the standard deviation of a term by its name; zero for a missing one."""
        return self.sizes.get(name, 0.0)

    @property
    def terms(self) -> tuple[ErrorTerm, ...]:
        """The terms of nonzero size."""
        return tuple(term for term in terms_with(self.sizes) if self.size(term.name) > 0)

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of these terms."""
        return tuple(term.kind for term in self.terms)

    @property
    def is_given(self) -> bool:
        """True if nothing was estimated from residuals: only encoder counts add to the instrument's noise."""
        return self.counts_rad is not None and not self.terms

    @property
    def scatter_rad(self) -> float:
        """Standard deviation of each joint's scatter from pose to pose; m of a slide."""
        return self.size("scatter")

    @property
    def autocorrelated_m(self) -> float:
        """Standard deviation of a shift that is correlated in time, of one coordinate."""
        return self.size("shift")

    @property
    def drift_m(self) -> float:
        """Standard deviation of the shift at the end of a steady drift, of one coordinate."""
        return self.size("trend")

    @property
    def common_m2(self) -> float:
        """Variance of a coordinate in another session: independent excess errors, and every shift."""
        own = max(self.independent_m**2 - self.sigma_m**2, 0.0)
        return float(own + sum(self.size(term.name) ** 2 for term in self.terms if term.unit.si == "m"))

    @property
    def within_m2(self) -> tuple[float, ...]:
        """Mean variances of a coordinate from each term's shifts in the campaign itself."""
        return tuple(term.variance_within(self.size(term.name)) for term in self.terms)

    def joint_covariance(self, joints: int) -> Array:
        """Covariance ``(J, J)`` of so many joints' positions at one pose (rad, m)."""
        own: Array = sum(self.size(term.name) ** 2 for term in self.terms if term.unit.si == "rad") * np.eye(joints)
        return own if self.counts_rad is None else own + self.counts_rad @ self.counts_rad.T

    def moved(self, name: str, step: float) -> "ErrorModel":
        """Return the model with the logarithm of one variance (of ``carry`` that of its odds) larger by ``step``.

        Args:
            name: as in ``variance_components.ComponentErrors``.
        """
        factor = float(np.exp(step / 2))
        if name == "scale":
            return replace(self, independent_share=self.independent_share * factor**2)
        if name == "carry":
            odds = self.carry / (1 - self.carry) * factor**2
            return replace(self, carry=odds / (1 + odds))
        return replace(self, sizes={**self.sizes, name: factor * self.size(name)})

    @property
    def independent_m(self) -> float:
        """The instrument's noise that is independent from pose to pose, of one coordinate."""
        return float(self.sigma_m * np.sqrt(self.independent_share))

    @property
    def descriptions(self) -> tuple[str, ...]:
        """Describe each of the errors."""
        messages = ["joint positions are whole counts of the encoders"] if self.counts_rad is not None else []
        return (
            *messages,
            *(text for term in self.terms for text in term.describe(self.size(term.name), self.carry)),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the model as in ``result.json``, without the clock of that campaign."""
        found: dict[str, Any] = {
            "independent_mm": MM.of(self.independent_m),
            "independent_share": self.independent_share,
        }
        for term in TERMS:
            if term.key:
                found[term.key] = term.unit.of(self.size(term.name))
            if term.structure == "autoregressive":
                found["wandering_correlation"] = self.carry
        if further := {term.name: self.size(term.name) for term in self.terms if not term.key}:
            found["further"] = further
        counts = None if self.counts_rad is None else self.counts_rad.tolist()
        return {**found, "encoder_counts_rad": counts}


def row_times(data: Measurements, clock: Clock | None = None) -> Array:
    """Return the time of each row, ``(n,)`` in the spacing of poses: from ``time_s``, else from the order in the file.

    Rows of another session or station are far away, so that their errors are uncorrelated.

    Args:
        clock: of the campaign of the rows; their own if not given.
    """
    clock = Clock.of(data) if clock is None else clock
    if clock.spacing_s is not None:
        times = (data.conditions["time_s"] - clock.origin_s) / clock.spacing_s
        times = np.where(np.isfinite(times), times, clock.middle)  # of held-out rows
    elif data.lines:
        times = np.array(data.lines, dtype=np.float64)
    elif all(name.isdecimal() for name in data.ids):
        times = np.array([float(name) for name in data.ids])
    else:
        times = np.arange(len(data), dtype=np.float64)
    place = {setup: i for i, setup in enumerate(dict.fromkeys((*clock.sessions, *setups(data))))}
    return np.asarray(times + _APART * np.array([place[setup] for setup in setups(data)]))


def session_of(times: Array) -> NDArray[np.int_]:
    """Return the session index of each row, from 0."""
    return np.round(times / _APART).astype(np.int_)


def within_session(times: Array) -> Array:
    """Return times of rows from the beginning of each session."""
    return np.asarray(times - _APART * session_of(times))
