"""Details of a certificate in TOML: who measured what, when and where, with which instrument."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from datetime import date
from pathlib import Path
from typing import Any

from lab.core.errors import LabError
from lab.core.limits import HUMIDITY_PERCENT, LINE_OF_TEXT, PRESSURE_HPA, ROOM_C, day, one_serial, positive
from lab.core.probability import Uncertain
from lab.core.units import PPM
from lab.formats.instrument_toml import StatedUncertainty
from lab.formats.structured import read_toml, structured

__all__ = ["HIGHEST_C", "LOWEST_C", "CertificateDetails", "read_certificate_details"]

LOWEST_C, HIGHEST_C = 0.0, 40.0  # default operating range of laser trackers
_DATES = ("date", "measured_on", "certificate_date", "valid_until")


@dataclass(frozen=True, kw_only=True)
class _Certificate:
    """Certificate's own data: ``date`` is the date of issue; the measurements may be older."""

    number: str = ""
    date: str = ""
    measured_on: str = ""
    issued_by: str = ""
    customer: str = ""
    operator: str = ""
    place: str = ""
    frame: str = ""


@dataclass(frozen=True, kw_only=True)
class _Robot:
    """Robot on the certificate; its repeatability is RP of ISO 9283, from its data sheet."""

    maker: str = ""
    model: str = ""
    serial_number: str = ""
    controller: str = ""
    repeatability_mm: float | None = None

    def __post_init__(self) -> None:
        if self.repeatability_mm is not None:
            positive("repeatability_mm", self.repeatability_mm)


@dataclass(frozen=True, kw_only=True)
class _MeasuredReflector:
    """Reflector, with the certificate of its own calibration."""

    maker: str = ""
    model: str = ""
    serial_number: str = ""
    certificate: str = ""
    certificate_date: str = ""
    valid_until: str = ""


@dataclass(frozen=True, kw_only=True)
class _Instrument(_MeasuredReflector):
    """Instrument, with its range of operating temperatures and the uncertainty of its scale."""

    scale_ppm: StatedUncertainty | None = None
    lowest_c: float = LOWEST_C
    highest_c: float = HIGHEST_C

    def __post_init__(self) -> None:
        if not (self.lowest_c in ROOM_C and self.highest_c in ROOM_C and self.lowest_c < self.highest_c):
            raise LabError(
                f"lowest_c {self.lowest_c:g} and highest_c {self.highest_c:g}: give a range in degrees Celsius"
            )


@dataclass(frozen=True, kw_only=True)
class _Environment:
    """Room conditions; ``robot_temperature_k`` is the uncertainty of the robot's temperature."""

    temperature_c: float | None = None
    robot_temperature_k: StatedUncertainty | None = None
    expansion_ppm_per_k: float | None = None
    pressure_hpa: float | None = None
    humidity_percent: float | None = None

    def __post_init__(self) -> None:
        if self.temperature_c is not None and self.temperature_c not in ROOM_C:
            raise LabError(f"temperature_c is {self.temperature_c:g}; give degrees Celsius")
        if (self.robot_temperature_k is None) != (self.expansion_ppm_per_k is None):
            raise LabError("robot_temperature_k and expansion_ppm_per_k go together; give both or neither")
        if self.expansion_ppm_per_k is not None:
            positive("expansion_ppm_per_k", self.expansion_ppm_per_k)
        if self.pressure_hpa is not None:
            PRESSURE_HPA("pressure_hpa", self.pressure_hpa)
        if self.humidity_percent is not None and self.humidity_percent not in HUMIDITY_PERCENT:
            raise LabError(f"humidity_percent is {self.humidity_percent:g}; give 0 to 100")


_SECTIONS = {
    "certificate": _Certificate,
    "robot": _Robot,
    "instrument": _Instrument,
    "reflector": _MeasuredReflector,
    "environment": _Environment,
}
_NEEDED = {
    "certificate": ("number", "date", "issued_by", "operator", "place"),
    "robot": ("serial_number",),
    "instrument": ("serial_number", "certificate"),
    "reflector": ("serial_number",),
    "environment": ("temperature_c",),
}  # required for traceability


@dataclass(frozen=True)
class CertificateDetails:
    """Details of a certificate; a detail that is not given is empty, or None."""

    certificate: _Certificate = _Certificate()
    robot: _Robot = _Robot()
    instrument: _Instrument = _Instrument()
    reflector: _MeasuredReflector = _MeasuredReflector()
    environment: _Environment = _Environment()

    def of_arm(self, serial: str | None, where: str, run: str) -> "CertificateDetails":
        """Return the details with the arm's serial number of a run; refuse a different one.

        Args:
            serial: of the run, or None.
            where, run: file of the details and folder of the run, for the error.
        """
        stated = {run: serial, f"{where}: serial_number of [robot]": self.robot.serial_number or None}
        shared = one_serial(stated, "give the details of the arm that was calibrated")
        return replace(self, robot=replace(self.robot, serial_number=shared or ""))

    @property
    def missing(self) -> tuple[str, ...]:
        """Details required for a traceable result that are not given, as ``section.name``."""
        stated = self.to_dict()
        return tuple(f"{part}.{name}" for part, names in _NEEDED.items() for name in names if name not in stated[part])

    @property
    def robot_temperature(self) -> tuple[Uncertain, float] | None:
        """Uncertainty of the robot's temperature (K), and its expansion (1/K); None if not given."""
        stated, expansion = self.environment.robot_temperature_k, self.environment.expansion_ppm_per_k
        return None if stated is None or expansion is None else (stated.quantity(1.0), PPM.to_si(expansion))

    @property
    def scale(self) -> Uncertain | None:
        """Relative uncertainty of the instrument's scale; None if not given."""
        stated = self.instrument.scale_ppm
        return None if stated is None else stated.quantity(PPM.factor)

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Return all given details, by section."""
        return {
            section.name: {
                each.name: value for each in fields(part) if _is_given(value := getattr(part, each.name), each.default)
            }
            for section in fields(self)
            for part in [getattr(self, section.name)]
        }


def read_certificate_details(path: Path) -> CertificateDetails:
    """Read a certificate's ``[certificate]``, ``[robot]``, ``[instrument]``, ``[reflector]``, ``[environment]``."""
    content = read_toml(path)
    if unknown := sorted(set(content) - set(_SECTIONS)):
        raise LabError(f"{path}: [{unknown[0]}]: unknown; valid are [{'], ['.join(_SECTIONS)}]")
    parts = {name: _section(path, name, content[name]) for name in content}
    return CertificateDetails(**parts)


def _section(path: Path, name: str, values: Any) -> Any:
    where = f"{path}: [{name}]"
    if not isinstance(values, dict):
        raise LabError(f"{where} is to be a section")
    plain = {key: value.isoformat() if isinstance(value, date) else value for key, value in values.items()}
    section: Any = structured(where, _SECTIONS[name], plain)
    _check_texts(where, plain)
    return section


def _check_texts(where: str, values: Mapping[str, Any]) -> None:
    for key, value in values.items():
        if not isinstance(value, str):
            continue
        if len(value) > LINE_OF_TEXT.most or not value.isprintable() or not value.strip():
            raise LabError(f"{where} {key}: give one line of 1 to {LINE_OF_TEXT.most} characters, or leave it out")
        if key in _DATES:
            day(f"{where} {key}", value)


def _is_given(value: object, default: object) -> bool:
    """Check for a text or a number; stated uncertainties are lines of the budget."""
    return value != default and not isinstance(value, StatedUncertainty)
