"""Systematic errors of a laser tracker: closed forms of its misalignments, of refraction, and of the reflector.

A tracker turns a beam about a standing axis (azimuth H) and a transit axis (elevation E) and measures the range R.
What its parts are off by shows in R, H and E, to first order, as Loser & Kyle (1999, Alignment and field check
procedures for the Leica laser tracker LTD 500) and Muralikrishnan et al. (2009, J. Res. Natl. Inst. Stand. Technol.
114, 21-35) give it; they count the vertical angle from the zenith, here it is the elevation. The tracker's own
compensation takes out most of it: what remains is known within an uncertainty.

Positions are in the instrument's frame: the origin is its head, z its standing axis.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from lab.core.distributions import Uncertain
from lab.core.se3 import Array

__all__ = ["AIR_INDEX_PER_K", "PLACEMENT", "TERMS", "ErrorTerm", "TrackerErrors", "air_index"]


def air_index(celsius: float, pascal: float = 101325.0, wavelength_m: float = 633e-9) -> float:
    """Refractive index of dry air (Birch & Downs 1993, 1994, Metrologia 30 and 31: the updated formula of Edlen)."""
    square = (1e-6 / wavelength_m) ** 2
    dispersion = 1e-8 * (8342.54 + 2406147.0 / (130 - square) + 15998.0 / (38.9 - square))
    compressed = 1 + 1e-8 * (0.601 - 0.00972 * celsius) * pascal
    return float(1 + dispersion * pascal * compressed / (96095.43 * (1 + 0.003661 * celsius)))


AIR_INDEX_PER_K = air_index(20.5) - air_index(19.5)  # at 20 degrees and 1013.25 hPa: -0.93e-6


@dataclass(frozen=True)
class ErrorTerm:
    """What a systematic error is called.

    Attributes:
        name: of the attribute of ``TrackerErrors``.
        unit: in which a person states it; ``factor`` of these is one SI unit.
        words: what it is.
        components: how many independent quantities have this uncertainty.
    """

    name: str
    unit: str
    factor: float
    words: str
    components: int = 1

    @property
    def key(self) -> str:
        """What it is called in a file: its name with its unit."""
        return f"{self.name}_{self.unit.replace('µ', 'u').replace('/', '_per_').lower()}"


@dataclass(frozen=True)
class TrackerErrors:
    """How well the systematic errors of a tracker are known; a term that is not given is zero.

    Attributes:
        transit_offset: of the transit axis from the standing axis, m, towards where the beam goes.
        transit_tilt: of the transit axis from square to the standing axis, rad.
        collimation: of the beam from square to the transit axis, rad.
        beam_offset: of the beam from the standing axis, sideways, m.
        elevation_index: where the elevation's zero is, rad.
        azimuth_eccentricity, elevation_eccentricity: of the circles from their axes, over their radii, as their cosine
            and their sine, rad.
        range_offset: where the range's zero is, m.
        range_scale: of the range, relative.
        air_temperature: of the air along the beam, as the range is corrected for it, K.
        temperature_gradient: of the air, upwards, K/m.
        centring_depth: of the reflector's optical centre from its sphere's, along the beam, m.
        centring_lateral: the same across the beam, in each of two directions, m. The reflector is turned to the
            tracker anew in each pose, so that its direction is by chance.
        nest: of where the nest holds the sphere from one pose to the next, in each direction, m.
        lock_on: of the range's zero from one pose to the next, m: the absolute distance meter finds it anew wherever
            the beam was broken.
        two_face: whether each point is measured in both faces, and the mean is taken.
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

    def quantity(self, term: ErrorTerm) -> Uncertain:
        """How well one of them is known."""
        found: Uncertain = getattr(self, term.name)
        return found

    def displacements(self, term: ErrorTerm, points: Array) -> Array:
        """How far a unit of a term displaces what is measured of points ``(..., 3)`` m: ``(..., 3, components)``.

        A term of ``PLACEMENT`` has none: it is another error in each pose.
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
        """The systematic errors of one campaign at points ``(..., 3)`` m, those of ``PLACEMENT`` among them."""
        total: Array = np.zeros_like(points)
        if not self.stated:
            return total
        for term, own in zip(TERMS, rng.spawn(len(TERMS)), strict=True):  # one term leaves the others' draws alone
            quantity = self.quantity(term)
            if not quantity.standard:
                continue
            if term in PLACEMENT:
                total += self._placed(term, quantity, points, own)
            else:
                total += self.displacements(term, points) @ quantity.sample(own, term.components)
        return total

    @property
    def stated(self) -> tuple[ErrorTerm, ...]:
        """The terms that are not zero."""
        return tuple(term for term in TERMS if self.quantity(term).standard)

    @property
    def lasting(self) -> tuple[ErrorTerm, ...]:
        """The terms that are not zero and are one error in all poses of a campaign."""
        return tuple(term for term in self.stated if term not in PLACEMENT)

    @property
    def placement(self) -> tuple[ErrorTerm, ...]:
        """The terms that are not zero and are another error in each pose."""
        return tuple(term for term in self.stated if term in PLACEMENT)

    def times(self, factor: float) -> "TrackerErrors":
        """The errors with every uncertainty multiplied."""
        grown = {term.name: self.quantity(term) for term in self.stated}
        grown = {name: replace(each, standard=factor * each.standard) for name, each in grown.items()}
        return TrackerErrors(**grown, two_face=self.two_face)

    def placement_covariance(self, points: Array, terms: Sequence[ErrorTerm] = ()) -> Array:
        """Covariance ``(..., 3, 3)`` m^2 of what is another error in each pose: of some terms, by default of all."""
        total: Array = np.zeros((*points.shape, 3))
        for each in terms or PLACEMENT:
            variance = self.quantity(each).standard ** 2
            total += variance * _SHAPES[each.name](points)
        return total

    def _placed(self, term: ErrorTerm, quantity: Uncertain, points: Array, rng: np.random.Generator) -> Array:
        """Draw nest and range anew at each point; the reflector's offset once, turned about the beam by chance."""
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


TERMS = (
    ErrorTerm("transit_offset", "µm", 1e6, "transit axis beside the standing axis"),
    ErrorTerm("transit_tilt", "µrad", 1e6, "transit axis not square to the standing axis"),
    ErrorTerm("collimation", "µrad", 1e6, "beam not square to the transit axis"),
    ErrorTerm("beam_offset", "µm", 1e6, "beam beside the standing axis"),
    ErrorTerm("elevation_index", "µrad", 1e6, "zero of the elevation"),
    ErrorTerm("azimuth_eccentricity", "µrad", 1e6, "eccentricity of the azimuth circle", 2),
    ErrorTerm("elevation_eccentricity", "µrad", 1e6, "eccentricity of the elevation circle", 2),
    ErrorTerm("range_offset", "µm", 1e6, "zero of the range"),
    ErrorTerm("range_scale", "ppm", 1e6, "scale of the range"),
    ErrorTerm("air_temperature", "K", 1.0, "temperature of the air along the beam"),
    ErrorTerm("temperature_gradient", "K/m", 1.0, "vertical temperature gradient of the air: the beam bends"),
    ErrorTerm("centring_depth", "µm", 1e6, "centring of the reflector along the beam"),
    ErrorTerm("centring_lateral", "µm", 1e6, "centring of the reflector across the beam"),
    ErrorTerm("nest", "µm", 1e6, "repeatability of the reflector's nest"),
    ErrorTerm("lock_on", "µm", 1e6, "zero of the range, found anew in each pose"),
)
PLACEMENT = tuple(term for term in TERMS if term.name in ("centring_lateral", "nest", "lock_on"))
"""Terms that are another error in each pose."""
assert [term.name for term in TERMS] == [each.name for each in fields(TrackerErrors)][:-1]


def _directions(azimuth: Array, elevation: Array) -> tuple[Array, Array, Array]:
    """Unit vectors ``(..., 3)``: along the beam, where the azimuth grows, where the elevation grows.

    They are those of the mechanical angles: in the second face the last two point the other way.
    """
    ch, sh, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    along = np.stack([ce * ch, ce * sh, se], axis=-1)
    sideways = np.stack([-sh, ch, np.zeros_like(ch)], axis=-1)
    upwards = np.stack([-se * ch, -se * sh, ce], axis=-1)
    return along, sideways, upwards


def _displaced(name: str, reach: Array, azimuth: Array, elevation: Array) -> Array:
    """How far a unit of a term displaces a measured point, at its mechanical angles: ``(..., 3, components)``.

    An azimuth error h is R cos(E) h sideways: a transit tilt's tan(E), a collimation's 1 / cos(E) and a beam's
    1 / (R cos(E)) are finite displacements, also straight up.
    """
    parts = _components(name, reach, azimuth, elevation)
    directions = np.stack(_directions(azimuth, elevation), axis=-1)  # (..., 3, 3)
    return np.asarray(np.einsum("...ij,...jc->...ic", directions, parts))


def _components(name: str, reach: Array, azimuth: Array, elevation: Array) -> Array:
    """The same along the beam, sideways and upwards: ``(..., 3, components)``."""
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
    """The projection ``(..., 3, 3)`` onto the beam."""
    along: Array = points[..., :, None] * points[..., None, :] / np.sum(points**2, axis=-1)[..., None, None]
    return along


_SHAPES: dict[str, Callable[[Array], Array]] = {
    "centring_lateral": lambda points: np.eye(3) - _along(points),
    "nest": lambda points: np.broadcast_to(np.eye(3), (*points.shape, 3)),
    "lock_on": _along,
}  # the covariance of a unit of each term of PLACEMENT, (..., 3, 3)
