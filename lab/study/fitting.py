"""What a set of measurements says: the model asked for or found, the poses that are off, and how far to trust it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lab.calibration.assess import kept_together
from lab.calibration.identifiability import WEAK_CONDITION
from lab.calibration.identify import Identification, Wishes, identify
from lab.calibration.prior import Tolerance
from lab.calibration.sightings.poses import Poses, balanced
from lab.calibration.sightings.sequential import fit_sequentially
from lab.calibration.sightings.sighted import Observing, sighted
from lab.calibration.sightings.sighting import Sighting, sighting_of
from lab.calibration.solver import Fit, Observations
from lab.calibration.statistics.adequacy import Adequacy, adequacy, isotropy, sandwich
from lab.calibration.statistics.lag import lagging
from lab.calibration.statistics.null import Shape, linearized
from lab.calibration.statistics.outliers import Outliers, find_outliers, would_matter
from lab.calibration.statistics.readings import by_readings, rounding
from lab.calibration.statistics.selection import Selection, follow, select
from lab.calibration.weights import Noise, weighed
from lab.frames import Array
from lab.geometry.model import Model
from lab.measurements import Measurements
from lab.seeds import stream
from lab.study.advice import changes
from lab.study.option_groups import Fitting
from lab.study.robots import Robot


@dataclass(frozen=True)
class Named:
    """A pose that the test of outliers names.

    Attributes:
        id, line: of its row; no line where there is no file.
        size_m: how far its farthest target is from where the other poses say it is.
        p: the chance that noise alone makes any pose of a campaign stand out as far.
    """

    id: str
    line: int | None
    size_m: float
    p: float


@dataclass(frozen=True)
class Fitted:
    """What a set of measurements says.

    Attributes:
        rows: those that the parameters come from.
        groups: of the model.
        unshown: parameters of these that the selection found the poses not to show: held at zero.
        outliers: poses that are off: left out if asked for, else fitted all the same.
        left_out: whether they were.
        selection: of the model's groups, where that was asked for.
    """

    identification: Identification
    rows: Measurements
    groups: tuple[str, ...]
    unshown: tuple[str, ...]
    outliers: tuple[Named, ...]
    left_out: bool
    adequacy: Adequacy
    selection: Selection | None
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Fitter:
    """How measurements of one arm are fitted.

    Attributes:
        targets: of the arm, measured or (of a cable, a socket, a plane) the one that is tied.
        data: all measurements, by which what is observed is known.
    """

    robot: Robot
    targets: tuple[str, ...]
    data: Measurements
    observing: Observing
    noise: Noise
    options: Fitting
    sequential: bool
    seed: int

    def model_with(self, groups: Sequence[str]) -> Model:
        """The arm with groups of effects, as it is observed."""
        arm = self.robot.arm_with(self.targets, groups, self.sessions)
        return sighted(arm, self.data, arm.nominal(self.robot.tool), self.observing)[0]

    @property
    def sessions(self) -> tuple[str, ...]:
        """Of the measurements, in their order."""
        return tuple(dict.fromkeys(self.data.sessions))

    def observed(self) -> Measurements:
        """What is observed of the measurements."""
        arm = self.robot.arm(self.targets)
        return sighted(arm, self.data, arm.nominal(self.robot.tool), self.observing)[1]

    def nominal(self, model: Model) -> Array:
        """The drawing's parameters of one of these models."""
        arm = self.robot.arm(self.targets)
        drawn = dict(zip(arm.names, arm.nominal(self.robot.tool), strict=True))
        return np.array([drawn.get(name, 0.0) for name in model.names])

    @property
    def wishes(self) -> Wishes:
        """What is asked of the identification."""
        chosen = self.options
        tolerance = self.tolerance if chosen.prior else None
        return Wishes(chosen.fix, chosen.free, tolerance, _sequentially if self.sequential else None)

    @property
    def tolerance(self) -> Tolerance:
        """Of manufacture."""
        return Tolerance(self.options.tolerance_mm / 1e3, self.options.tolerance_mrad / 1e3)

    def identified(
        self, rows: Measurements, groups: Sequence[str], held: Sequence[str] = ()
    ) -> tuple[Identification, Measurements]:
        """One identification of the arm with these groups, and the rows that it comes from.

        Args:
            held: parameters of the groups that the selection found these poses not to show.
        """
        model = self.model_with(groups)
        wishes = replace(self.wishes, fix=(*self.wishes.fix, *held))
        found = self._identify(model, rows, wishes)
        if not self.options.robust:
            return found, rows
        off = self._outliers(found, rows).rows
        clean = rows.take(np.setdiff1d(np.arange(len(rows)), off))
        return self._identify(model, clean, wishes), clean

    def __call__(self, rows: Measurements, held: Measurements | None = None) -> Fitted:
        """Everything that the rows say.

        Args:
            rows, held: some of what is observed; ``held`` are poses held out, by which adequacy can be judged.
        """
        selection = self._selected(rows)
        groups, unshown = (selection.chosen, selection.held) if selection else ((), ())
        identification, clean = self.identified(rows, groups, unshown)
        outliers = self._outliers(identification, rows)
        judged = self._adequacy(identification, clean, held)
        trusted, warnings = self._said_of_noise(identification, clean, outliers, judged)
        warnings += self._said_of_weakness(groups, identification, clean) + self._said_of_joints(identification, clean)
        named = _named(rows, outliers)
        return Fitted(trusted, clean, groups, unshown, named, self.options.robust, judged, selection, tuple(warnings))

    def _selected(self, rows: Measurements) -> Selection | None:
        """The groups that the rows call for, or that are asked for; None for geometry alone."""
        if self.options.model == "geometric":
            return None
        if self.options.model == "auto":
            _, clean = self.identified(rows, ())
            return select(self.model_with, clean, self.nominal, self.noise, self.wishes, seed=self.seed)
        groups = self.options.groups
        _, clean = self.identified(rows, groups)
        return follow(self.model_with, clean, self.nominal, groups, self.noise, self.wishes, seed=self.seed)

    @property
    def _shape(self) -> Shape:
        """Of the noise that is assumed."""
        device = self.noise.instrument
        uniform = device is not None and device.kind == "uniform" and self.noise.sigma_m is None
        return Shape("uniform", self.noise.readings) if uniform else Shape()

    def _identify(self, model: Model, rows: Measurements, wishes: Wishes) -> Identification:
        if isinstance(model, Poses) and self.observing.ratio is None:
            model = balanced(model, rows, self.nominal(model), wishes)
        return identify(model, rows, self.nominal(model), self.noise, wishes)

    def _outliers(self, start: Identification, rows: Measurements) -> Outliers:
        sight = sighting_of(start.model)
        seen, known = weighed(sight, rows, self.noise)
        return find_outliers(
            start.model,
            seen,
            start.fit.free,
            start.before,
            known=known,
            rng=stream(self.seed, "null"),
            shape=self._shape,
            further=start.further,
            things=sight.positions or None,
        )

    def _adequacy(self, found: Identification, rows: Measurements, held: Measurements | None) -> Adequacy:
        sight = sighting_of(found.model)
        seen, known = weighed(sight, rows, self.noise)
        return adequacy(
            found.model,
            seen,
            found.fit,
            known=known,
            shape=self._shape,
            labels=kept_together(found.model, rows),
            held=weighed(sight, held, self.noise)[0] if held is not None and sight.positions else None,
            further=found.further,
        )

    def _said_of_noise(
        self, found: Identification, rows: Measurements, outliers: Outliers, judged: Adequacy
    ) -> tuple[Identification, list[str]]:
        """The identification with intervals to be trusted, and what is to be said of outliers and of the noise."""
        seen, known = weighed(sighting_of(found.model), rows, self.noise)
        if len(outliers.rows) and not self.options.robust:
            moved = would_matter(found.model, seen, found.values, outliers.fit.values)
            count = f"{len(outliers.rows)} poses are" if len(outliers.rows) > 1 else "1 pose is"
            inadequate = [judged.words] if judged.adequate is False else []
            return found, [
                *inadequate,
                f"{count} off by more than noise explains, {1e3 * outliers.sizes_m[0]:.3g} mm "
                f"the worst: --robust would leave them out, and move what is predicted by {1e3 * moved:.2g} mm",
            ]
        if judged.adequate is False:
            return found, [judged.words]
        device = self.noise.instrument
        if self.observing.kind != "points" or (device is not None and device.kind == "spherical"):
            return found, []
        words = isotropy(found.model, seen, found.fit).words
        if not words or known or found.freedom < 1:
            return found, [words] if words else []
        own = sandwich(linearized(found.model, seen, found.values, found.fit.free))
        trusted = replace(found, covariance=own.covariance, freedom_each=own.freedom)
        return trusted, [f"{words}; the intervals given are those of the poses' own residuals"]

    def _said_of_weakness(self, groups: tuple[str, ...], found: Identification, rows: Measurements) -> list[str]:
        """What would show what is barely seen."""
        if self.observing.kind != "points" or found.fit.condition <= WEAK_CONDITION or found.unseen:
            return []
        settings = rows.settings(found.model.conditions)
        wanted = changes(self.robot, self.targets, groups, found.values, settings)[0]
        return [
            f"some parameters are nearly unidentifiable (weak_directions in result.json): with {wanted.words} the "
            f"same poses would have a condition of {wanted.condition:.0f} instead of {found.fit.condition:.0f}"
        ]

    def _said_of_joints(self, found: Identification, rows: Measurements) -> list[str]:
        """Readings that are rounded, or that do not follow the arm."""
        model, said = found.model, []
        sight = sighting_of(model)
        seen, _ = weighed(sight, rows, self.noise)
        if (coarse := rounding(model, rows, found.values, sight.positions or None)) is not None:
            said.append(
                f"joint readings are rounded to {np.rad2deg(coarse.step_rad):g}°, which alone makes "
                f"{1e3 * coarse.rms_m:.3g} mm (root mean square) of what is observed"
            )
        derivative = by_readings(model, seen.settings, found.values, self.robot.chain.size)
        for lag in lagging(model, seen, found.fit, rows.joints, derivative, rows.sessions):
            shares = [
                f"{name} {share:.2g}"
                for name, share, sure in zip(rows.joint_names, lag.fractions, lag.significant, strict=True)
                if sure
            ]
            where = f"session {lag.session}: " if lag.session else ""
            said.append(
                f"{where}the joint values do not follow the arm: residuals lag behind the moves by a share of "
                f"{', '.join(shares)} (F test, p = {lag.p:.1g}); read the joints when the arm has settled"
            )
        return said


def _sequentially(sight: Sighting, seen: Observations, free: Sequence[int], start: Array) -> Fit:
    assert isinstance(sight, Poses)  # the options see to it
    return fit_sequentially(sight, seen, free, start)


def _named(rows: Measurements, found: Outliers) -> tuple[Named, ...]:
    lines = [rows.lines[i] if rows.lines else None for i in found.rows]
    parts = zip(found.rows, lines, found.sizes_m, found.p_values, strict=True)
    return tuple(Named(rows.ids[i], line, float(size), float(p)) for i, line, size, p in parts)
