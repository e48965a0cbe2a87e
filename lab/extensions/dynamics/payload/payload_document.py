"""Document of a payload: its parameters with their intervals, and how well they explain the measurements."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lab.core.limits import called
from lab.core.number_text import capital, digits_of, fixed, sentence, short
from lab.core.se3 import Array
from lab.core.units import MICRONS, MM
from lab.extensions.dynamics.dynamics_phrases import phrase
from lab.extensions.dynamics.payload.payload_estimate import LoadEstimate, equivalent_ellipsoid
from lab.extensions.dynamics.payload.payload_result import PayloadResult, channels_of, parameter_rows, wild_sample
from lab.kinematics.dynamics.rigid_body import inertia_about_centre
from lab.report import document as doc
from lab.report.charts.chart import axes_picture
from lab.report.charts.marks import Axes
from lab.report.comparison_plots import bars_picture, rows_picture
from lab.report.page_scene import ArmScene, moving_arm, posed_arm
from lab.report.scene import drawn_rows
from lab.report.style import GRID, MEASURED, PREDICTED, REFERENCE, RGB_PAYLOAD
from lab.report.view import View
from lab.simulation.meshes import Shell

__all__ = [
    "FIT_BADGES",
    "IMPLAUSIBLE",
    "VIEW",
    "fit_figures",
    "main_picture",
    "payload_document",
    "share_figure",
    "true_values",
]

VIEW = View(f"{__name__}:payload_document", f"{__name__}:main_picture")

_ROUNDING = 1e-9  # of true values, kg cm^2 or mm

_MAX_DRAWN = 600  # rows
_UNITS = {"s": (1e3, "ms"), "rad": (180 / np.pi, "°")}  # by which a person reads a number of a unit
FIT_BADGES = {
    True: doc.Badge("no lack of fit", "good"),
    False: doc.Badge("lack of fit", "bad"),
    None: doc.Badge("not judged"),
}
IMPLAUSIBLE = doc.Badge("implausible", "bad")


def main_picture(result: PayloadResult) -> doc.Picture:
    """Return the first channel, as measured and as predicted."""
    return _fits(result)[0].pictures[0]


def _fits(result: PayloadResult) -> tuple[doc.Figure, doc.Figure]:
    estimate = result.estimate
    return fit_figures(channels_of(result), estimate.time_s, estimate.measured, estimate.residual, "channel", _CAPTION)


def payload_document(result: PayloadResult) -> doc.Document:
    """Summarise a payload: its parameters with their intervals, what they cost, and how well they explain the data."""
    estimate = result.estimate
    mass = (
        f"{estimate.mass_kg:.4g} kg at the flange"
        if np.isfinite(estimate.mass_kg)
        else "a payload whose mass is not identifiable"
    )
    shown = result.samples is not None and bool(np.isfinite(estimate.com_m).all())
    scene = (doc.Scene("payload-scene", lambda: _page_scene(result), _SCENE),) * shown
    lead = f"{capital(estimate.method)}: {estimate.rank} of {estimate.columns} parameters identified."
    fit = (FIT_BADGES[estimate.adequate], f" {sentence(phrase(estimate.verdict))}")
    return doc.Document(
        f"{called(result.robot.name, result.options.serial)}: {mass}",
        (
            _card(result),
            doc.Paragraph(lead, "lead", shown_in=doc.NARROW),
            doc.Paragraph(fit, shown_in=doc.NARROW),
            doc.Warnings(result.warnings),
            doc.Section(
                "The payload",
                (
                    *scene,
                    doc.Paragraph(f"{lead} {sentence(phrase(estimate.verdict))}", shown_in=doc.PAGE),
                    *_payload(result),
                    *_intervals(result),
                ),
            ),
            doc.Section("Error due to its uncertainty", (doc.Paragraph(_cost(result)),), shown_in=doc.NARROW),
            doc.Section("Not identifiable", (doc.Bullets(tuple(map(sentence, estimate.unidentified))),)),
            doc.Section("Parameters fitted with it", (_nuisance_table(estimate),)),
            doc.Section("Measured and predicted", _fits(result)),
        ),
    )


@doc.guarded
def _card(result: PayloadResult) -> doc.Card:
    """Summarise the payload: whether it is to be trusted, its mass and centre, and what to do with it."""
    estimate, numbers = result.estimate, list[tuple[str, str, str]]()
    if np.isfinite(estimate.mass_kg):
        numbers.append(("mass", f"{' ± '.join(_rounded(estimate.mass_kg, estimate.mass_half_width_kg))} kg", ""))
    if np.isfinite(estimate.com_m).all():
        widest = float(MM.of(estimate.com_half_width.max()))
        centre = ", ".join(fixed(value, digits_of(widest, 3)) for value in MM.of(estimate.com_m))
        numbers.append((f"centre of mass (± {short(widest)}), mm", centre, ""))
    if not numbers:
        numbers.append(("parameters identified", f"{estimate.rank} of {estimate.columns}", ""))
    badge = FIT_BADGES[estimate.adequate]
    if result.implausible:
        badge = IMPLAUSIBLE
    elif estimate.adequate is not False and not np.isfinite(estimate.com_m).all():
        badge = doc.Badge("incomplete", "doubtful")
    about = f"With 95 % intervals, in the frame of the {estimate.frame}, by {estimate.method}. {_cost(result)}".rstrip()
    share = share_figure(channels_of(result), estimate.measured, estimate.residual, "signal")
    return doc.Card(("Fit: ", badge), tuple(numbers), about, _next(result), (share,))


def _next(result: PayloadResult) -> str:
    """Return what to do with an identified payload."""
    estimate = result.estimate
    if result.implausible:
        return "Mend what the first warning names; then identify again."
    if wild_sample(estimate):
        return "Mend or leave out the sample that the warning names; then identify again."
    if estimate.adequate is False:
        return "Find the cause that the fit names: --friction, --delay, --tilt or --turn also fit it."
    if not np.isfinite(estimate.com_m).all():
        return "Measure more poses or another motion (see what is not identifiable); then identify again."
    return "Give this run to identify, calibrate or compensate with --load."


def _page_scene(result: PayloadResult) -> ArmScene:
    """The arm along the loaded run, with the payload as the solid ellipsoid of its mass and inertia."""
    import trimesh

    estimate, samples, robot = result.estimate, result.samples, result.robot
    assert samples is not None
    run = samples.run(True)
    arm = robot.serial_arm(("p1",))
    values = arm.nominal(robot.tool)
    rows = drawn_rows(len(run))
    if run.time_s is None:
        posed = posed_arm(robot.model, arm, values, run.joints[rows], [str(row + 1) for row in rows])
        posed = replace(posed, all_text="")
    else:
        posed = moving_arm(robot.model, arm, values, run.joints[rows], run.time_s[rows], (0,), ("start",))
    T_world_flange = robot.model.T_world_frame0 @ arm.flange(run.joints[rows], values)
    half, axes = equivalent_ellipsoid(estimate.mass_kg, estimate.inertia_com_kgm2)
    ball = trimesh.creation.icosphere(3)
    surface = (ball.vertices * half) @ axes.T + estimate.com_m
    tint = np.tile(np.array([*RGB_PAYLOAD, 255], np.uint8), (len(surface), 1))
    load = Shell(
        _LOAD, surface.astype(np.float32), np.asarray(ball.faces, np.uint32), np.zeros((0, 3), np.float32), tint
    )
    return replace(posed, shells=(*posed.shells, load), bodies={**posed.bodies, _LOAD: T_world_flange})


_LOAD = "payload"  # body of the scene
_SCENE = (
    "The arm with the payload (green): the solid ellipsoid that has its mass, centre of mass and inertia, or a ball of "
    "steel where the inertia is not known."
)
_GROUPS = {
    "mass": "mass",
    "centre of mass": "centre of mass",
    "I": "inertia about it",
}  # by what their names begin with


def _intervals(result: PayloadResult) -> tuple[doc.Figure, ...]:
    """Draw the parameters with their 95 % intervals, and the true values of a simulated payload."""
    rows = parameter_rows(result.estimate)
    truth = {} if result.truth is None else true_values(result.truth)
    groups = [(title, [row for row in rows if row[0].startswith(start)]) for start, title in _GROUPS.items()]
    pictures = tuple(_interval_picture(title, part, truth) for title, part in groups if part)
    caption = "Estimates with 95 % intervals" + ("; crosses: the true values." if truth else ".")
    return (doc.Figure("intervals-figure", pictures, caption),) if pictures else ()


def _interval_picture(
    title: str, rows: Sequence[tuple[str, float, float, str]], truth: Mapping[str, float]
) -> doc.Picture:
    """Draw intervals about their estimates, which are written beside them."""
    short_names = [name.removeprefix("centre of mass, ").removesuffix(" about the centre of mass") for name, *_ in rows]
    names = [f"{name} {_rounded(*row[1:3])[0]}" for name, row in zip(short_names, rows, strict=True)]
    values, widths = (np.array([row[i] for row in rows]) for i in (1, 2))
    unit = rows[0][3]

    def draw(axes: Axes, at: Array) -> None:
        axes.hlines(at, -widths, widths, color=PREDICTED, linewidth=3)
        axes.plot(np.zeros(len(rows)), at, "o", color=PREDICTED, markersize=6)
        if truth:
            axes.plot(np.array([truth[row[0]] for row in rows]) - values, at, "x", color=REFERENCE, markersize=7)
        axes.locator_params(nbins=5, axis="x")

    name, label = f"interval-{title.split()[0]}", f"{capital(title)} with 95 % intervals"
    axis = f"from the estimate, {unit}"
    return rows_picture(name, label, names, draw, axis, width=4.2, title=f"{title}, {unit}")


def share_figure(channels: Sequence[tuple[str, str]], measured: Array, residual: Array, what: str) -> doc.Figure:
    """Draw what share of each channel's measurements ``(n, d)`` is left unexplained.

    Args:
        what: the measurements are, in a word.
    """
    names = [name for name, _ in channels]
    shares = 100 * np.sqrt((residual**2).mean(axis=0) / np.maximum((measured**2).mean(axis=0), 1e-300))
    texts = [f"{short(share)} %" for share in shares]
    label, axis = f"Share of each {what} left unexplained", f"{what} left unexplained, %"
    picture = bars_picture("shares", label, names, shares.tolist(), texts, axis)
    caption = f"Residuals as shares of each measured {what}, by root mean squares."
    return doc.Figure("shares-figure", (picture,), caption)


_CAPTION = (
    "What the payload adds: measured (dots), and predicted by the payload and all that was fitted with it (line)."
)


def true_values(phi: Array) -> dict[str, float]:
    """Return the true values of a simulated payload, by the names of ``parameter_rows`` and in their units."""
    inertia = inertia_about_centre(phi)
    values = {"mass": float(phi[0])}
    values |= {f"centre of mass, {axis}": float(MM.of(phi[1 + i]) / phi[0]) for i, axis in enumerate("xyz")}
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    names = {(i, j): f"I{'xyz'[i]}{'xyz'[j]} about the centre of mass" for i, j in pairs}
    return values | {name: float(1e4 * inertia[cell]) for cell, name in names.items()}


def fit_figures(
    channels: Sequence[tuple[str, str]], time_s: Array | None, measured: Array, residual: Array, key: str, caption: str
) -> tuple[doc.Figure, doc.Figure]:
    """Draw each channel as measured and predicted over time, and its residuals.

    Args:
        channels: names and units.
        time_s: ``(n,)`` of the rows, which begins anew with each run; None of static poses.
        measured, residual: ``(n, d)``.
        key: of the pictures, before their number.
        caption: of the first figure.
    """
    times, starts = _one_after_the_other(time_s, len(measured))
    every = max(1, len(measured) // _MAX_DRAWN)
    axis = "pose" if time_s is None else "time, s"
    fits, lefts = list[doc.Picture](), list[doc.Picture]()
    for i, (name, unit) in enumerate(channels):
        shown = _Channel(name, unit, axis, times[::every], starts, measured[::every, i], residual[::every, i])
        fits.append(shown.fit(f"{key}{i}", legend=i == 0))
        lefts.append(shown.residuals(f"{key}{i}-residuals", _rms(residual[:, i]), _rms(measured[:, i])))
    parted = " The vertical line parts the runs, one after the other." if starts else ""
    return (
        doc.Figure(f"{key}s", tuple(fits), caption + parted),
        doc.Figure(f"{key}s-residuals", tuple(lefts), f"Residuals: measured less predicted.{parted}"),
    )


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))


@dataclass(frozen=True)
class _Channel:
    """A channel over time, as far as it is drawn."""

    name: str
    unit: str
    axis: str  # what the times are
    times: Array  # (n,)
    starts: Sequence[float]  # of further runs
    measured: Array  # (n,)
    residual: Array  # (n,)

    def fit(self, picture: str, *, legend: bool) -> doc.Picture:
        """Draw what is measured and predicted."""

        def draw(axes: Axes) -> None:
            axes.plot(self.times, self.measured, ".", color=MEASURED, markersize=4, label="measured")
            predicted = self.measured - self.residual
            axes.plot(self.times, predicted, "-", color=PREDICTED, linewidth=1, label="predicted")
            self._finish(axes, self.name)
            if legend:
                axes.legend(loc="best", frameon=True)

        return self._picture(picture, f"{self.name}, measured and predicted", draw)

    def residuals(self, picture: str, rms: float, whole: float) -> doc.Picture:
        """Draw the residuals; the title has their root mean square, and its share of that of what is measured."""
        share = f", {short(100 * rms / whole)} %" if whole > 0 else ""

        def draw(axes: Axes) -> None:
            axes.plot(self.times, self.residual, ".", color=MEASURED, markersize=3)
            axes.axhline(0.0, color=PREDICTED, linewidth=1)
            self._finish(axes, f"{self.name}: {short(rms)} {self.unit} (RMS){share}")

        return self._picture(picture, f"{self.name}, residuals", draw)

    def _finish(self, axes: Axes, title: str) -> None:
        for start in self.starts:
            axes.axvline(start, color=GRID, linewidth=1.5, zorder=0)
        axes.set(title=title, xlabel=self.axis, ylabel=self.unit)

    def _picture(self, name: str, label: str, draw: Callable[[Axes], None]) -> doc.Picture:
        return axes_picture(name, label, (4.2, 2.0), draw, (0.75, 0.45, 0.1, 0.3))


def _one_after_the_other(time_s: Array | None, count: int) -> tuple[Array, list[float]]:
    """Return times ``(n,)`` that go on from run to run, and those at which a further run begins; of poses numbers."""
    if time_s is None:
        return np.arange(1.0, count + 1), []
    begins = np.flatnonzero(np.diff(time_s) <= 0) + 1
    times, step = time_s - time_s[0], float(np.median(np.diff(time_s)))
    starts = []
    for row in begins.tolist():
        times[row:] += times[row - 1] + step - times[row]
        starts.append(float(times[row] - step / 2))
    return times, starts


@doc.guarded
def _payload(result: PayloadResult) -> tuple[doc.Block, ...]:
    parameters = parameter_rows(result.estimate)
    rows: tuple[tuple[str, ...], ...] = tuple(
        (name, *_rounded(value, width), unit) for name, value, width, unit in parameters
    )
    columns: tuple[str, ...] = ("", "value", "±", "unit")
    if result.truth is not None:
        columns = (*columns, "true")
        truth = true_values(result.truth)
        rows = tuple((*row, short(truth[row[0]] if abs(truth[row[0]]) > _ROUNDING else 0.0)) for row in rows)
    caption = f"About and along the frame of the {result.estimate.frame}, with half-widths of 95 % intervals."
    physical = "No body has what least squares found: these are the nearest parameters that one has."
    note = doc.Paragraph(physical if result.estimate.moved else "", "note")
    return doc.Table(columns, rows, caption), note


def _rounded(value: float, half_width: float) -> tuple[str, str]:
    """Round a value to the second digit of its half-width."""
    digits = max(0, 1 - int(np.floor(np.log10(half_width)))) if half_width > 0 else 6
    return f"{value:.{min(digits, 9)}f}".replace("-", "−"), f"{half_width:.{min(digits, 9)}f}"


def _cost(result: PayloadResult) -> str:
    """Report the position error from the payload's uncertainty; empty where its weight was not identified."""
    if not np.isfinite(result.cost.rms_m):
        return ""
    soft = result.cost.compliance[result.cost.compliance > 0]
    alike = len(soft) and np.ptp(soft) < 1e-9 * soft[0]
    stiffness = f"joints of {1 / soft[0]:,.6g} Nm/rad" if alike else "joints of the identified stiffness"
    return (
        f"Its uncertainty moves a point that is corrected for it by {MICRONS.text(result.cost.rms_m, 2)} (1σ, root "
        f"mean square over the workspace, {stiffness})."
    )


def _nuisance_table(estimate: LoadEstimate) -> doc.Table:
    rows = []
    for each in estimate.nuisance:
        scale, unit = _UNITS.get(each.unit, (1.0, each.unit))
        rows.append((each.name, short(scale * each.value), short(scale * each.half_width), unit))
    return doc.Table(("", "value", "±", "unit"), tuple(rows))
