"""A laser tracker in TOML: its noise, its field of view, and uncertainties of its systematic errors."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lab.core.errors import LabError, error_context
from lab.core.limits import ELEVATION_DEG, REFLECTOR_DEG, UNCERTAINTY
from lab.core.probability import DistributionName, Uncertain
from lab.formats.structured import read_toml, structured
from lab.noise.instruments import SYSTEMATIC_ERRORS, FieldOfView, Instrument, TrackerErrors

__all__ = ["StatedUncertainty", "read_instrument"]

_MICRO = 1e-6
_NAME = re.compile(r"[\w .()/-]{1,60}")


@dataclass(frozen=True, kw_only=True)
class StatedUncertainty:
    """Stated uncertainty of a quantity, in the file's unit.

    Attributes:
        standard: standard uncertainty; or
        limit: half the width of an interval.
        distribution: by default normal for a standard uncertainty, rectangular for a limit.
        freedom: degrees of freedom of a standard uncertainty.
    """

    standard: float | None = None
    limit: float | None = None
    distribution: DistributionName | None = None
    freedom: float | None = None

    def __post_init__(self) -> None:
        if (self.standard is None) == (self.limit is None):
            raise LabError("give either standard (a standard uncertainty) or limit (half of an interval)")
        given = self.standard if self.limit is None else self.limit
        if given is not None and given not in UNCERTAINTY:
            raise LabError(f"{given:g} is not an uncertainty; give a number from 0 to {UNCERTAINTY.most:g}")
        self.quantity(1.0)  # refuses contradictions

    def quantity(self, factor: float) -> Uncertain:
        """Return the uncertainty in SI units; ``factor`` is the number of the file's units in one."""
        dof = np.inf if self.freedom is None else self.freedom
        if self.standard is not None:
            return Uncertain(self.standard / factor, self.distribution or "normal", dof)
        if self.freedom is not None:
            raise LabError("freedom goes with standard, not with limit")
        assert self.limit is not None
        return Uncertain.within(self.limit / factor, self.distribution or "rectangular")


@dataclass(frozen=True, kw_only=True)
class _NoiseSection:
    """Noise of one reading (one standard deviation) along the beam and across it, and its growth per metre."""

    radial_um: float
    transverse_um: float
    radial_um_per_m: float = 0.0
    transverse_um_per_m: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value not in UNCERTAINTY:
                raise LabError(f"{name} is {value:g}; give a standard deviation from 0 to {UNCERTAINTY.most:g}")
        if not (self.radial_um or self.radial_um_per_m) or not (self.transverse_um or self.transverse_um_per_m):
            raise LabError("is zero along or across the beam; give standard deviations above zero")


@dataclass(frozen=True, kw_only=True)
class _FieldOfView:
    """Field of view of the instrument."""

    nearest_m: float = 0.0
    farthest_m: float = 1e3
    lowest_deg: float = -90.0
    highest_deg: float = 90.0
    acceptance_deg: float = 180.0

    def __post_init__(self) -> None:
        sides = self.lowest_deg in ELEVATION_DEG and self.highest_deg in ELEVATION_DEG
        ranges = 0 <= self.nearest_m < self.farthest_m and self.lowest_deg < self.highest_deg
        if not (sides and ranges and self.acceptance_deg in REFLECTOR_DEG):
            raise LabError("is empty: give nearest_m < farthest_m, lowest_deg < highest_deg, acceptance_deg up to 180")

    @property
    def field_of_view(self) -> FieldOfView:
        lowest, highest, acceptance = np.deg2rad([self.lowest_deg, self.highest_deg, self.acceptance_deg]).tolist()
        return FieldOfView(self.nearest_m, self.farthest_m, lowest, highest, acceptance)


def read_instrument(path: Path) -> Instrument:
    """Read a tracker: ``name``, ``[noise]``, and optionally ``[field_of_view]`` and ``[systematic]``."""
    content = read_toml(path)
    if unknown := sorted(set(content) - {"name", "noise", "field_of_view", "systematic"}):
        raise LabError(f"{path}: {unknown[0]}: unknown; there are name, noise, field_of_view and systematic")
    name = content.get("name", path.stem)
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise LabError(f"{path}: name: give up to 60 letters, digits, spaces and . ( ) / - _")
    if "noise" not in content:
        raise LabError(f"{path}: [noise] is missing; give radial_um and transverse_um, of one reading (1 sigma)")
    noise = structured(f"{path}: [noise]", _NoiseSection, content["noise"])
    view = structured(f"{path}: [field_of_view]", _FieldOfView, content.get("field_of_view", {}))
    return Instrument(
        name,
        "spherical",
        noise.radial_um * _MICRO,
        noise.radial_um_per_m * _MICRO,
        noise.transverse_um * _MICRO,
        noise.transverse_um_per_m * _MICRO,
        view.field_of_view,
        _errors(path, content.get("systematic", {})),
        str(path),
    )


def _errors(path: Path, section: Any) -> TrackerErrors:
    where = f"{path}: [systematic]"
    if not isinstance(section, dict):
        raise LabError(f"{where} is to be a section with a line for each error")
    two_face = section.get("two_face", False)
    if not isinstance(two_face, bool):
        raise LabError(f"{where} two_face is {two_face!r}; give true or false")
    terms = {term.key: term for term in SYSTEMATIC_ERRORS}
    numbers = {key: value for key, value in section.items() if key != "two_face"}
    if unknown := sorted(set(numbers) - set(terms)):
        raise LabError(f"{where} {unknown[0]}: unknown; there are two_face, {', '.join(terms)}")
    quantities = {}
    for key, value in numbers.items():
        if not isinstance(value, dict):
            raise LabError(f"{where} {key} is {value!r}; give {{ standard = … }} or {{ limit = … }}")
        with error_context(f"{where} {key}"):
            stated = structured("", StatedUncertainty, value)
            quantities[terms[key].name] = stated.quantity(terms[key].unit.factor)
    return TrackerErrors(**quantities, two_face=two_face)
