"""Model the noise of instruments: drawn by the virtual tracker, used as weights by the identifier.

Positions are in the instrument's frame: the origin is its head, z its standing axis, upwards.

Systematic errors of a laser tracker are closed forms of its misalignments, of refraction, and of the reflector. A
tracker turns a beam about a standing axis (azimuth H) and a transit axis (elevation E) and measures the range R. The
effects of misalignments on R, H and E, to first order, are those of Loser & Kyle (1999, Alignment and field check
procedures for the Leica laser tracker LTD 500) and Muralikrishnan et al. (2009, J. Res. Natl. Inst. Stand. Technol.
114, 21-35), with elevations in place of zenith angles. The tracker's own compensation removes most of them: the rest
has an uncertainty.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.probability import Uncertain
from lab.core.se3 import Array, exp
from lab.core.units import KELVIN, MICRONS, MICRORADIANS, PPM, Unit
from lab.core.values import Value
from lab.extension_points import Part, PartKind, numbers
from lab.kinematics.effects.effect import FREE_RANGE, RangePrior

__all__ = [
    "AIR_INDEX_PER_K",
    "INSTRUMENTS",
    "PLACEMENT",
    "SYSTEMATIC_ERRORS",
    "FieldOfView",
    "Instrument",
    "LineCameras",
    "PoseInstrument",
    "SystematicError",
    "TrackerErrors",
    "air_index",
    "instrument",
    "is_isotropic",
    "is_named",
    "observers",
    "observing",
]


def air_index(celsius: float, pascal: float = 101325.0, wavelength_m: float = 633e-9) -> float:
    """Return the refractive index of dry air (Birch & Downs 1993, 1994, Metrologia 30, 31: Edlen updated)."""
    square = (1e-6 / wavelength_m) ** 2
    dispersion = 1e-8 * (8342.54 + 2406147.0 / (130 - square) + 15998.0 / (38.9 - square))
    compressed = 1 + 1e-8 * (0.601 - 0.00972 * celsius) * pascal
    return float(1 + dispersion * pascal * compressed / (96095.43 * (1 + 0.003661 * celsius)))


AIR_INDEX_PER_K = air_index(20.5) - air_index(19.5)  # at 20 degrees and 1013.25 hPa: -0.93e-6


@dataclass(frozen=True)
class SystematicError:
    """A systematic error of a tracker.

    Attributes:
        name: of the attribute of ``TrackerErrors``.
        unit: of its stated value.
        description: for reports.
        components: number of independent quantities with this uncertainty.
    """

    name: str
    unit: Unit
    description: str
    components: int = 1

    @property
    def key(self) -> str:
        """Key in a file: the name with the unit."""
        return f"{self.name}_{self.unit.key}"


@dataclass(frozen=True)
class TrackerErrors:
    """Uncertainties of a tracker's systematic errors; a term that is not given is zero.

    Attributes:
        transit_offset: of the transit axis from the standing axis, m, along the beam.
        transit_tilt: of the transit axis from square to the standing axis, rad.
        collimation: of the beam from square to the transit axis, rad.
        beam_offset: of the beam from the standing axis, sideways, m.
        elevation_index: of the elevation's zero, rad.
        azimuth_eccentricity, elevation_eccentricity: of the circles from their axes, over their radii, as their cosine
            and their sine, rad.
        range_offset: of the range's zero, m.
        range_scale: of the range, relative.
        air_temperature: of the air along the beam, from the one that the range is corrected for, K.
        temperature_gradient: of the air, upwards, K/m.
        centring_depth: of the reflector's optical centre from its sphere's, along the beam, m.
        centring_lateral: that across the beam, in each of two directions, m. The reflector is turned to the
            tracker again in each pose, so that its direction is random.
        nest: of the sphere in its nest from one pose to the next, in each direction, m.
        lock_on: of the range's zero from one pose to the next, m: the absolute distance meter sets it again wherever
            the beam was broken.
        two_face: whether each point is the mean of both faces.
    """

    transit_offset: Uncertain = field(default_factory=Uncertain)
    transit_tilt: Uncertain = field(default_factory=Uncertain)
    collimation: Uncertain = field(default_factory=Uncertain)
    beam_offset: Uncertain = field(default_factory=Uncertain)
    elevation_index: Uncertain = field(default_factory=Uncertain)
    azimuth_eccentricity: Uncertain = field(default_factory=Uncertain)
    elevation_eccentricity: Uncertain = field(default_factory=Uncertain)
    range_offset: Uncertain = field(default_factory=Uncertain)
    range_scale: Uncertain = field(default_factory=Uncertain)
    air_temperature: Uncertain = field(default_factory=Uncertain)
    temperature_gradient: Uncertain = field(default_factory=Uncertain)
    centring_depth: Uncertain = field(default_factory=Uncertain)
    centring_lateral: Uncertain = field(default_factory=Uncertain)
    nest: Uncertain = field(default_factory=Uncertain)
    lock_on: Uncertain = field(default_factory=Uncertain)
    two_face: bool = False

    def quantity(self, term: SystematicError) -> Uncertain:
        """Return the uncertainty of a term."""
        found: Uncertain = getattr(self, term.name)
        return found

    def displacements(self, term: SystematicError, points: Array) -> Array:
        """Return the displacement of measured points ``(..., 3)`` m by a unit of a term: ``(..., 3, components)``.

        A term of ``PLACEMENT`` has none: its error differs in each pose.
        """
        reach = np.linalg.norm(points, axis=-1)
        azimuth = np.arctan2(points[..., 1], points[..., 0])
        elevation = np.arctan2(points[..., 2], np.hypot(points[..., 0], points[..., 1]))
        first = _displaced(term.name, reach, azimuth, elevation)
        if not self.two_face:
            return first
        second = _displaced(term.name, reach, azimuth + np.pi, np.pi - elevation)
        return (first + second) / 2

    def sample(self, points: Array, rng: np.random.Generator) -> Array:
        """Draw the systematic errors of one campaign at points ``(..., 3)`` m, including those of ``PLACEMENT``."""
        total: Array = np.zeros_like(points)
        if not self.stated:
            return total
        streams = rng.spawn(len(SYSTEMATIC_ERRORS))  # a term does not change the draws of others
        for term, own in zip(SYSTEMATIC_ERRORS, streams, strict=True):
            quantity = self.quantity(term)
            if not quantity.standard:
                continue
            if term in PLACEMENT:
                total += self._placed(term, quantity, points, own)
            else:
                total += self.displacements(term, points) @ quantity.sample(own, term.components)
        return total

    @property
    def stated(self) -> tuple[SystematicError, ...]:
        """The nonzero terms."""
        return tuple(term for term in SYSTEMATIC_ERRORS if self.quantity(term).standard)

    @property
    def lasting(self) -> tuple[SystematicError, ...]:
        """The nonzero terms with one error for all poses of a campaign."""
        return tuple(term for term in self.stated if term not in PLACEMENT)

    @property
    def placement(self) -> tuple[SystematicError, ...]:
        """The nonzero terms with an error of its own in each pose."""
        return tuple(term for term in self.stated if term in PLACEMENT)

    @property
    def without_range(self) -> "TrackerErrors":
        """The errors but for constant and scale of the range, which a fit has as parameters."""
        none = Uncertain()
        return replace(self, range_offset=none, centring_depth=none, range_scale=none)

    def times(self, factor: float) -> "TrackerErrors":
        """Return the errors with every uncertainty multiplied."""
        grown = {term.name: self.quantity(term) for term in self.stated}
        grown = {name: replace(each, standard=factor * each.standard) for name, each in grown.items()}
        return TrackerErrors(**grown, two_face=self.two_face)

    def placement_covariance(self, points: Array, terms: Sequence[SystematicError] = ()) -> Array:
        """Return the covariance ``(..., 3, 3)`` m^2 of ``PLACEMENT``: of some terms, by default of all."""
        total: Array = np.zeros((*points.shape, 3))
        for each in terms or PLACEMENT:
            total += self.quantity(each).standard ** 2 * _SHAPES[each.name](points)
        return total

    def _placed(self, term: SystematicError, quantity: Uncertain, points: Array, rng: np.random.Generator) -> Array:
        """Draw nest and range at each point; the reflector's offset once, turned about the beam at random."""
        if term.name == "nest":
            return quantity.sample(rng, points.shape)
        if term.name == "lock_on":
            ray = points / np.linalg.norm(points, axis=-1, keepdims=True)
            return np.asarray(ray * quantity.sample(rng, points.shape[:-1])[..., None])
        offset, turn = quantity.sample(rng, 2), rng.uniform(-np.pi, np.pi, points.shape[:-1])
        azimuth = np.arctan2(points[..., 1], points[..., 0])
        elevation = np.arctan2(points[..., 2], np.hypot(points[..., 0], points[..., 1]))
        _, sideways, upwards = _directions(azimuth, elevation)
        c, s = np.cos(turn)[..., None], np.sin(turn)[..., None]
        moved: Array = (c * offset[0] - s * offset[1]) * sideways + (s * offset[0] + c * offset[1]) * upwards
        return moved


_PER_METRE = Unit("K/m", "K/m", 1.0)
SYSTEMATIC_ERRORS = (
    SystematicError("transit_offset", MICRONS, "transit axis beside the standing axis"),
    SystematicError("transit_tilt", MICRORADIANS, "transit axis not square to the standing axis"),
    SystematicError("collimation", MICRORADIANS, "beam not square to the transit axis"),
    SystematicError("beam_offset", MICRONS, "beam beside the standing axis"),
    SystematicError("elevation_index", MICRORADIANS, "zero of the elevation"),
    SystematicError("azimuth_eccentricity", MICRORADIANS, "eccentricity of the azimuth circle", 2),
    SystematicError("elevation_eccentricity", MICRORADIANS, "eccentricity of the elevation circle", 2),
    SystematicError("range_offset", MICRONS, "zero of the range"),
    SystematicError("range_scale", PPM, "scale of the range"),
    SystematicError("air_temperature", KELVIN, "temperature of the air along the beam"),
    SystematicError("temperature_gradient", _PER_METRE, "vertical temperature gradient of the air: the beam bends"),
    SystematicError("centring_depth", MICRONS, "centring of the reflector along the beam"),
    SystematicError("centring_lateral", MICRONS, "centring of the reflector across the beam"),
    SystematicError("nest", MICRONS, "repeatability of the reflector's nest"),
    SystematicError("lock_on", MICRONS, "zero of the range, found anew in each pose"),
)
PLACEMENT = tuple(term for term in SYSTEMATIC_ERRORS if term.name in ("centring_lateral", "nest", "lock_on"))
"""Terms with an error of its own in each pose."""
assert [term.name for term in SYSTEMATIC_ERRORS] == [each.name for each in fields(TrackerErrors)][:-1]


def _directions(azimuth: Array, elevation: Array) -> tuple[Array, Array, Array]:
    """Return unit vectors ``(..., 3)``: along the beam, of growing azimuth, of growing elevation.

    They are those of the mechanical angles: in the second face the last two are reversed.
    """
    ch, sh, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    along = np.stack([ce * ch, ce * sh, se], axis=-1)
    sideways = np.stack([-sh, ch, np.zeros_like(ch)], axis=-1)
    upwards = np.stack([-se * ch, -se * sh, ce], axis=-1)
    return along, sideways, upwards


def _displaced(name: str, reach: Array, azimuth: Array, elevation: Array) -> Array:
    """Return a point's displacement by a unit of a term, at its mechanical angles: ``(..., 3, components)``.

    An azimuth error h is R cos(E) h sideways: a transit tilt's tan(E), a collimation's 1 / cos(E) and a beam's
    1 / (R cos(E)) are finite displacements, also straight up.
    """
    parts = _components(name, reach, azimuth, elevation)
    directions = np.stack(_directions(azimuth, elevation), axis=-1)  # (..., 3, 3)
    return np.asarray(np.einsum("...ij,...jc->...ic", directions, parts))


def _components(name: str, reach: Array, azimuth: Array, elevation: Array) -> Array:
    """Return this displacement along the beam, sideways and upwards: ``(..., 3, components)``."""
    ce, se, zero, one = np.cos(elevation), np.sin(elevation), np.zeros_like(reach), np.ones_like(reach)
    index, level = AIR_INDEX_PER_K, reach * np.cos(elevation)
    parts = {
        "transit_offset": [(-ce, zero, se)],
        "transit_tilt": [(zero, reach * se, zero)],
        "collimation": [(zero, reach, zero)],
        "beam_offset": [(zero, one, zero)],
        "elevation_index": [(zero, zero, reach)],
        "azimuth_eccentricity": [(zero, level * np.cos(azimuth), zero), (zero, level * np.sin(azimuth), zero)],
        "elevation_eccentricity": [(zero, zero, level), (zero, zero, reach * se)],
        "range_offset": [(one, zero, zero)],
        "range_scale": [(reach, zero, zero)],
        "air_temperature": [(index * reach, zero, zero)],
        # A ray bends by the gradient of the index across it (Born & Wolf 1999, 3.2): it leaves at half the bend to the
        # chord. The mean index along it is that half way up.
        "temperature_gradient": [(index * reach**2 * se / 2, zero, -index * reach**2 * ce / 2)],
        "centring_depth": [(one, zero, zero)],
    }[name]
    return np.stack([np.stack(part, axis=-1) for part in parts], axis=-1)


def _along(points: Array) -> Array:
    along: Array = points[..., :, None] * points[..., None, :] / np.sum(points**2, axis=-1)[..., None, None]
    return along


_SHAPES: dict[str, Callable[[Array], Array]] = {
    "centring_lateral": lambda points: np.eye(3) - _along(points),
    "nest": lambda points: np.broadcast_to(np.eye(3), (*points.shape, 3)),
    "lock_on": _along,
}  # the covariance of a unit of each term of PLACEMENT, (..., 3, 3)


_ISOTROPIC = ("exact", "uniform", "gaussian")  # kinds with the same noise along all axes


@dataclass(frozen=True)
class FieldOfView:
    """Field of view of an instrument; unlimited if nothing is given.

    Attributes:
        nearest_m, farthest_m: range from the head.
        lowest_rad, highest_rad: elevation above the instrument's x-y plane.
        acceptance_rad: largest angle between the reflector's axis and the line to the head.
    """

    nearest_m: float = 0.0
    farthest_m: float = np.inf
    lowest_rad: float = -np.pi / 2
    highest_rad: float = np.pi / 2
    acceptance_rad: float = np.pi

    def admits(self, points: Array, axes: Array) -> NDArray[np.bool_]:
        """Return ``(...)``: whether targets at ``points`` ``(..., 3)`` (m) that face along unit ``axes`` are in view.

        Both are in the instrument's frame. Occlusion is not checked.
        """
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        reach, elevation = np.linalg.norm(points, axis=-1), np.arctan2(z, np.hypot(x, y))
        facing = -np.sum(points * axes, axis=-1) >= np.cos(self.acceptance_rad) * reach
        in_range = (self.nearest_m <= reach) & (reach <= self.farthest_m)
        in_view = (self.lowest_rad <= elevation) & (elevation <= self.highest_rad)
        visible: NDArray[np.bool_] = in_range & in_view & (facing | (self.acceptance_rad >= np.pi))
        return visible


_KIND = PartKind(
    "lab.instruments",
    "instrument",
    "instrument",
    returned={
        "sample": lambda where, readings, points, *_, **__: numbers(where, readings, points.shape),
        "covariance": lambda where, matrices, points, *_, **__: numbers(where, matrices, (*points.shape, 3)),
    },
)


@dataclass(frozen=True, eq=False, repr=False)
class Instrument(Part, Value, kind=_KIND):
    """Noise of a measured point at range R (metres).

    ``gaussian`` and ``uniform`` are isotropic: each coordinate, or the one number that is measured, has standard
    deviation ``radial_m``. ``spherical`` has standard deviation ``radial_m + radial_per_m R`` along the
    line of sight and ``transverse_m + transverse_per_m R`` in the two directions across it: to
    first order, azimuth and elevation errors of that over R cos(elevation) and over R. ``line-cameras`` are a
    ``LineCameras``. That is the noise of one reading, which the mean of several reduces. ``errors`` are common to the
    readings: those of nest and range differ in each pose and belong to the noise, which no number of
    readings reduces; the others last through a campaign.

    Your own is an object, or an object of a subclass with its own ``sample`` and ``covariance``, of kind ``spherical``
    unless its noise is the same along all axes. Every call with an option ``instrument`` takes it; if a package
    registers it as an entry point of ``lab.instruments``, ``--instrument`` takes it by name.

    Attributes:
        name: of the preset or the file.
        kind: distribution of the noise.
        radial_m: standard deviation along the line of sight, at range zero; of each coordinate if isotropic.
        radial_per_m: its growth with range.
        transverse_m: standard deviation across the line of sight, at range zero.
        transverse_per_m: its growth with range.
        field_of_view: bounds of visible targets.
        errors: systematic errors, zero unless stated.
        source: path of the file that describes it; "" without one.
        observes: the sensors that it reads; none for points, and poses of a ``PoseInstrument``.
    """

    observes: ClassVar[tuple[str, ...]] = ()

    name: str
    kind: Literal["exact", "uniform", "gaussian", "spherical", "line-cameras"]
    radial_m: float = 0.0
    radial_per_m: float = 0.0
    transverse_m: float = 0.0
    transverse_per_m: float = 0.0
    field_of_view: FieldOfView = field(default_factory=FieldOfView)
    errors: TrackerErrors = field(default_factory=TrackerErrors)
    source: str = ""

    def _about(self) -> str:
        return self.name

    @property
    def range_prior(self) -> RangePrior | None:
        """Prior of the errors of the range that last through a campaign; None where no range is measured.

        The constant is the zero of the range and the depth of the reflector's centre together, free where neither is
        stated. The scale is the stated one; else what the noise grows by per metre, which contains it; else that of
        the arm's size, from which the measurements do not tell it.
        """
        if self.kind != "spherical":
            return None
        constant_m = float(np.hypot(self.errors.range_offset.standard, self.errors.centring_depth.standard))
        scale = self.errors.range_scale.standard or self.radial_per_m
        return RangePrior(constant_m or FREE_RANGE.constant_m, scale or FREE_RANGE.scale)

    def sample(self, points: Array, rng: np.random.Generator, readings: int = 1) -> Array:
        """Draw readings of points, without ``errors``.

        Args:
            points: ``(..., 3)`` m, in the instrument's frame.
            rng: random generator.
            readings: of which each is the mean.

        Returns:
            The readings ``(..., 3)`` m.
        """
        if self.kind == "exact":
            return points.copy()
        total = np.zeros_like(points)
        for _ in range(readings):
            total += self._one_reading(points, rng)
        return total / readings

    def covariance(self, points: Array, readings: int = 1) -> Array:
        """Return the covariance of the mean of some readings.

        It includes all errors that vary from pose to pose: the noise of the readings, and those of nest and range.

        Args:
            points: ``(..., 3)`` m, in the instrument's frame.
            readings: of which each is the mean.

        Returns:
            The covariance ``(..., 3, 3)`` m².
        """
        return self._reading_covariance(points) / readings + self.errors.placement_covariance(points)

    def isotropic_sigma(self, readings: int = 1) -> float:
        """Return the standard deviation (m) along each axis of the mean of some readings, of isotropic noise.

        Args:
            readings: of which the mean is taken.
        """
        assert is_isotropic(self)
        return float(np.hypot(self.radial_m / np.sqrt(readings), self.errors.nest.standard))

    def _reading_covariance(self, points: Array) -> Array:
        if self.kind in _ISOTROPIC:
            return np.broadcast_to(np.eye(3), (*points.shape, 3)) * self.radial_m**2
        reach = np.linalg.norm(points, axis=-1)[..., None, None]
        ray = points[..., :, None] * points[..., None, :] / reach**2
        along = (self.radial_m + self.radial_per_m * reach) ** 2
        across = (self.transverse_m + self.transverse_per_m * reach) ** 2
        return np.asarray(along * ray + across * (np.eye(3) - ray))

    def _one_reading(self, points: Array, rng: np.random.Generator) -> Array:
        if self.kind == "uniform":
            half_width = np.sqrt(3) * self.radial_m
            return points + rng.uniform(-half_width, half_width, points.shape)
        draw = rng.standard_normal(points.shape)
        if self.kind == "gaussian":
            return points + self.radial_m * draw
        reach = np.linalg.norm(points, axis=-1, keepdims=True)
        ray = points / reach
        sideways = _sideways(ray)
        along = (self.radial_m + self.radial_per_m * reach) * draw[..., :1]
        across = self.transverse_m + self.transverse_per_m * reach
        error: Array = along * ray + across * (draw[..., 1:2] * sideways + draw[..., 2:] * np.cross(ray, sideways))
        return points + error


@dataclass(frozen=True, eq=False, repr=False)
class PoseInstrument(Instrument):
    """An instrument that also measures the orientation of a frame.

    Attributes:
        rotation_rad: standard deviation of a measured orientation about each axis.
    """

    rotation_rad: float = 0.0

    def sample_rotations(self, rotations: Array, rng: np.random.Generator, readings: int = 1) -> Array:
        """Draw noisy rotations ``(..., 3, 3)``: each turned by the mean of some readings' small rotation vectors."""
        numbers = Instrument("", self.kind if self.kind in ("exact", "uniform") else "gaussian", self.rotation_rad)
        return np.asarray(rotations @ exp(numbers.sample(np.zeros(rotations.shape[:-1]), rng, readings)))


@dataclass(frozen=True, eq=False, repr=False)
class LineCameras(PoseInstrument):
    """Three line CCDs on a bar that faces each point, level.

    Two at the bar's ends, ``baseline_m`` apart, see a point's direction along the bar, one in the middle its
    elevation, each with standard deviation ``angle_rad``.
    """

    baseline_m: float = 1.0
    angle_rad: float = 0.0

    def _reading_covariance(self, points: Array) -> Array:
        axes, sigmas = _sight_axes(points), self._sigmas(points)
        return np.asarray((axes * (sigmas**2)[..., None, :]) @ axes.swapaxes(-1, -2))

    def _one_reading(self, points: Array, rng: np.random.Generator) -> Array:
        draw = self._sigmas(points) * rng.standard_normal(points.shape)
        return np.asarray(points + (_sight_axes(points) @ draw[..., None])[..., 0])

    def _sigmas(self, points: Array) -> Array:
        """Return standard deviations ``(..., 3)`` (m) along the line of sight, along the bar, and up.

        The outer two see azimuths a, b of a point at range R in front of a bar of length B:
        da, db = (R dy -+ B/2 dx) / D with D = R^2 + B^2/4, so that dx = D (db - da) / B and dy = D (da + db) / (2 R);
        the middle one sees its elevation, R de.
        """
        reach = np.linalg.norm(points, axis=-1)
        spread = reach**2 + self.baseline_m**2 / 4
        along, sideways = np.sqrt(2) * spread / self.baseline_m, spread / (np.sqrt(2) * reach)
        return self.angle_rad * np.stack([along, sideways, reach], axis=-1)


def is_isotropic(device: Instrument) -> bool:
    """Decide whether the noise is the same along all axes, wherever a point is."""
    return device.kind in _ISOTROPIC and all(term.name == "nest" for term in device.errors.placement)


def observers(kind: str) -> tuple[str, ...]:
    """Return the names of the instruments for a kind of observation, as in ``--observe``."""
    return tuple(name for name in INSTRUMENTS if name in _IDEAL or kind in _OBSERVES.get(name, _POINTS))


def observing(device: Instrument, kind: str) -> Instrument:
    """Return an instrument if it makes one kind of observation.

    Args:
        device: a preset, or one of points.
        kind: as in ``--observe``.

    Raises:
        LabError: it does not; the message lists the instruments that do.
    """
    of_points = (*_POINTS, "pose") if isinstance(device, PoseInstrument) else _POINTS
    able = device.observes or _OBSERVES.get(device.name, of_points)
    if device.name not in _IDEAL and kind not in able:
        *others, last = observers(kind)
        raise LabError(
            f"instrument {device.name} measures {', '.join(able)}, not {kind}: take {', '.join(others)} or {last}"
        )
    return device


def _sideways(ray: Array) -> Array:
    """Return horizontal unit vectors ``(..., 3)`` of growing azimuth; y for a line of sight straight up."""
    level = np.hypot(ray[..., :1], ray[..., 1:2])
    straight_up = level < 1e-12
    left = np.stack([-ray[..., 1], ray[..., 0], np.zeros_like(ray[..., 0])], axis=-1) / np.where(
        straight_up, 1.0, level
    )
    return np.asarray(np.where(straight_up, np.array([0.0, 1.0, 0.0]), left))


def _sight_axes(points: Array) -> Array:
    """Return axes ``(..., 3, 3)``, as columns: along the line of sight, sideways, and up."""
    ray = points / np.linalg.norm(points, axis=-1, keepdims=True)
    sideways = _sideways(ray)
    return np.stack([ray, sideways, np.cross(ray, sideways)], axis=-1)


# One standard deviation is the stated maximum permissible error over k = 2. docs/reference/trackers.md has the noise of
# each preset beside it, and the sources. They include the maker's own reflector, but no nest: 3 um is representative of
# a magnetic one. The AT960's range is its interferometer's, whose zero its distance meter sets again where the beam was
# broken. Representative, not of a data sheet, are also laser-tracker, which stands for any make, all orientations
# (the AT960's with a probe that it tracks in six degrees of freedom; uniform-8um's as if from three points on a circle
# of 70 mm), the line cameras (which with these angles read a point at 2.5 m to 57 um in depth, 11 um along the bar,
# 12 um up), the optical CMM, the draw-wire, the ball in its socket and the touched plane.
_MICRON = 1e-6
# Fields of view. The trackers' ranges are the part that a robot cell uses, and their elevations, like the camera's
# sight, are representative, not a data sheet's; the Vantage's vertical range is 130 degrees in all (a maker's
# calibration certificate). Trackers are given the common corner cube, which takes beams up to 30 degrees off its
# axis; a cell's file names another reflector. The two ideal instruments see everything that is not occluded.
_LEICA = FieldOfView(0.8, 20.0, np.deg2rad(-45.0), np.deg2rad(90.0), np.deg2rad(30.0))
_VANTAGE = FieldOfView(0.8, 20.0, np.deg2rad(-52.0), np.deg2rad(78.0), np.deg2rad(30.0))
_CAMERA = FieldOfView(1.0, 5.0, np.deg2rad(-45.0), np.deg2rad(45.0), np.deg2rad(60.0))
_NEST = Uncertain(3 * _MICRON)
_LINE_CAMERAS = FieldOfView(1.5, 6.0, np.deg2rad(-17.0), np.deg2rad(17.0), np.deg2rad(60.0))
INSTRUMENTS = {
    instrument.name: instrument
    for instrument in (
        PoseInstrument("exact", "exact"),
        PoseInstrument("uniform-8um", "uniform", radial_m=8 * _MICRON / np.sqrt(3), rotation_rad=54e-6),
        PoseInstrument(
            "leica-at960",
            "spherical",
            0.0,
            0.25 * _MICRON,
            7.5 * _MICRON,
            3 * _MICRON,
            _LEICA,
            TrackerErrors(nest=_NEST, lock_on=Uncertain(5 * _MICRON)),
            rotation_rad=87e-6,
        ),
        Instrument(
            "leica-at500",
            "spherical",
            5 * _MICRON,
            0.15 * _MICRON,
            7.5 * _MICRON,
            3 * _MICRON,
            _LEICA,
            TrackerErrors(nest=_NEST),
        ),
        Instrument(
            "faro-vantage",
            "spherical",
            8 * _MICRON,
            0.4 * _MICRON,
            10 * _MICRON,
            2.5 * _MICRON,
            _VANTAGE,
            TrackerErrors(nest=_NEST),
        ),
        Instrument(
            "laser-tracker",
            "spherical",
            10 * _MICRON,
            0.5 * _MICRON,
            10 * _MICRON,
            3 * _MICRON,
            _VANTAGE,
            TrackerErrors(nest=_NEST),
        ),
        PoseInstrument("optical-cmm", "gaussian", radial_m=30 * _MICRON, field_of_view=_CAMERA, rotation_rad=200e-6),
        LineCameras(
            "krypton-k600",
            "line-cameras",
            field_of_view=_LINE_CAMERAS,
            rotation_rad=200e-6,
            baseline_m=0.8,
            angle_rad=5e-6,
        ),
        Instrument("draw-wire", "gaussian", radial_m=50 * _MICRON),
        Instrument("ball-in-socket", "gaussian", radial_m=20 * _MICRON),
        Instrument("touch-probe", "gaussian", radial_m=10 * _MICRON),
        Instrument("dial-indicator", "gaussian", radial_m=5 * _MICRON),
    )
}
_KIND.taken = tuple(INSTRUMENTS)
_POINTS = ("points",)
_IDEAL = ("exact", "uniform-8um")  # read every sensor
_OBSERVES = {
    **{name: ("points", "pose") for name, device in INSTRUMENTS.items() if isinstance(device, PoseInstrument)},
    "draw-wire": ("cable",),
    "ball-in-socket": ("socket", "sphere-plate", "ball-bar"),
    "touch-probe": ("plane", "cube"),
    "dial-indicator": ("dial",),
}


def instrument(name: str) -> Instrument:
    """Return an instrument by its name: a preset, or one that a package adds.

    Raises:
        LabError: there is none (the message lists all), or its package cannot be imported.
    """
    device: Instrument = INSTRUMENTS[name] if name in INSTRUMENTS else _KIND.named(name)
    return device


def is_named(name: str) -> bool:
    """Decide whether a preset, or an instrument that a package adds, has this name."""
    return name in _KIND.names
