"""Document of an arm's dynamics: how well the parameters explain torques, their values, and how they are grouped."""

import numpy as np

from lab.core.limits import called
from lab.core.number_text import digits_of, fixed, sentence, short
from lab.core.significance import PAYLOAD_RESIDUALS
from lab.extensions.dynamics.arm.dynamics_result import DynamicsResult
from lab.extensions.dynamics.arm.identify_dynamics import DynamicsEstimate
from lab.extensions.dynamics.dynamics_phrases import phrase
from lab.extensions.dynamics.payload.payload_document import (
    FIT_BADGES,
    IMPLAUSIBLE,
    fit_figures,
    share_figure,
    true_values,
)
from lab.extensions.dynamics.payload.payload_result import parameter_rows
from lab.report import document as doc
from lab.report.page_scene import ArmScene, moving_arm
from lab.report.plots import singular_value_picture
from lab.report.scene import drawn_rows
from lab.report.view import View

__all__ = ["VIEW", "dynamics_document", "main_picture"]

VIEW = View(f"{__name__}:dynamics_document", f"{__name__}:main_picture")

_ROUNDING = 1e-12  # of true values, SI


def main_picture(result: DynamicsResult) -> doc.Picture:
    """Return the torques of the first drive, or without measurements the singular values."""
    estimate = result.estimate
    return (
        singular_value_picture(result.singular_values)[0]
        if estimate is None
        else _fits(result, estimate)[0].pictures[0]
    )


def dynamics_document(result: DynamicsResult) -> doc.Document:
    """Summarise an arm's dynamics: how well the parameters explain torques, their values, and how they are grouped."""
    base, estimate = result.base, result.estimate
    grouping = (doc.Paragraph(_counts(result)), _formulas(result), doc.Paragraph(_without(result)))
    name = called(result.robot.name, result.options.serial)
    only = doc.EVERYWHERE if estimate is None else doc.PAGE
    fit = () if estimate is None else (FIT_BADGES[estimate.adequate], f" {sentence(phrase(estimate.verdict))}")
    return doc.Document(
        f"{name}: {base.size} base parameters of {len(base.names)} standard ones",
        (
            _card(result),
            doc.Paragraph(fit, shown_in=doc.NARROW),
            doc.Warnings(result.warnings),
            *(() if estimate is None else _identified(result, estimate)),
            doc.Section("Base parameters", grouping, shown_in=only, folded=estimate is not None),
            doc.Section("Inverse dynamics in letters", _letters(result), folded=estimate is not None),
            *(() if estimate is None else (doc.Section("Conditioning", (_conditioning(result),), shown_in=doc.PAGE),)),
        ),
    )


@doc.guarded
def _card(result: DynamicsResult) -> doc.Card:
    """Summarise the dynamics: whether the model explains the torques, how far, and what to do next."""
    base, estimate = result.base, result.estimate
    condition = result.singular_values[0] / result.singular_values[-1]
    if estimate is None:
        numbers = (
            ("base parameters", f"{base.size} of {len(base.names)}", ""),
            ("of links and motors", f"{base.inertial}", ""),
            ("condition number", f"{condition:.0f}", ""),
        )
        about = "Torques along a motion determine the base parameters alone: the other ones are grouped into them."
        step = "Record a motion with torques and give its file; or rehearse it with --simulate."
        return doc.Card(("Motion: ", doc.Badge("not measured")), numbers, about, step, (_conditioning(result),))
    named = [("torques left unexplained", short(100 * estimate.relative_error, "%"), "after")]
    named += [
        (f"error on {each.of}", short(100 * each.total_relative, "%"), "after") for each in estimate.predictions[:1]
    ]
    if (count := int(np.isfinite(estimate.values).sum())) < base.size or estimate.load is None:
        named.append(("base parameters", f"{count} of {base.size}", ""))
    if estimate.load is not None and np.isfinite(estimate.load.mass_kg):
        named.append(("payload", _interval_text(estimate.load.mass_kg, estimate.load.mass_half_width_kg) + " kg", ""))
    about = f"{sentence(phrase(estimate.verdict))} {_noise(result, estimate)}"
    figures = (share_figure(_drives(result), estimate.measured, estimate.residual, "torque"),)
    badge = IMPLAUSIBLE if result.implausible else FIT_BADGES[estimate.adequate]
    return doc.Card(("Fit: ", badge), tuple(named), about, _next(result, estimate), figures)


def _next(result: DynamicsResult, estimate: DynamicsEstimate) -> str:
    """Return what to do with identified dynamics."""
    if result.implausible:
        return "Mend what the first warning names; then identify again."
    if estimate.adequate is False:
        return "Find the cause that the fit names; then identify again."
    if not np.isfinite(estimate.values).all():
        return "Record a motion that moves more joints at a time and faster; then identify again."
    if not estimate.predictions:
        return "Predict another motion with --validate, before the parameters are used."
    return "Use the parameters of result.json in the controller's or the simulation's model."


def _drives(result: DynamicsResult) -> list[tuple[str, str]]:
    chain = result.robot.chain
    return [(name, "N" if slides else "Nm") for name, slides in zip(chain.joint_names, chain.prismatic, strict=True)]


def _fits(result: DynamicsResult, estimate: DynamicsEstimate) -> tuple[doc.Figure, doc.Figure]:
    caption = "Torques of the drives: measured (dots), and predicted by the parameters (line)."
    return fit_figures(_drives(result), estimate.time_s, estimate.measured, estimate.residual, "torque", caption)


def _page_scene(result: DynamicsResult) -> ArmScene:
    """The arm on the first run's path."""
    samples, robot = result.samples, result.robot
    assert samples is not None
    run = samples.run(bool(samples.loaded.all()))
    assert run.time_s is not None
    arm = robot.serial_arm(("p1",))
    rows = drawn_rows(len(run))
    return moving_arm(robot.model, arm, arm.nominal(robot.tool), run.joints[rows], run.time_s[rows], (0,), ("start",))


@doc.guarded
def _letters(result: DynamicsResult) -> tuple[doc.Block, ...]:
    """Tabulate the steps of Newton and Euler's recursion."""
    in_letters = result.in_letters
    if in_letters is None:
        return ()
    letters = ", ".join(f"{name} = {value:.6g}" for name, value in in_letters.letters.items()).replace("-", "−")
    count = f"{in_letters.multiplications} multiplications and {in_letters.additions} additions"
    units = "q1, qd1 and qdd1 are joint 1's position, speed and acceleration (SI, rad)"
    torques = tuple((f"torque {j}", each) for j, each in enumerate(in_letters.torques, 1))
    return (
        doc.Paragraph(f"Newton and Euler's recursion with the base parameters: {count}. Here {units}. {letters}."),
        doc.Table(("", ""), (*in_letters.steps, *torques)),
    )


@doc.guarded
def _identified(result: DynamicsResult, estimate: DynamicsEstimate) -> tuple[doc.Section, ...]:
    return (
        doc.Section("Measured and predicted", _fits(result, estimate), shown_in=doc.PAGE),
        doc.Section(
            "The motion and the predicted torques",
            (
                doc.Scene("motion-scene", lambda: _page_scene(result), "The arm on the path of the first run."),
                _predictions(result, estimate),
                doc.Paragraph(_physical(result)),
            ),
            shown_in=doc.PAGE,
        ),
        doc.Section(
            "Identified parameters",
            (_values(result, estimate), doc.Paragraph(_noise(result, estimate), shown_in=doc.NARROW)),
        ),
        doc.Section("Physical consistency", (doc.Paragraph(_physical(result)),), shown_in=doc.NARROW),
        doc.Section("Predicted torques", (_predictions(result, estimate),), shown_in=doc.NARROW),
        doc.Section("The load", _loads(result, estimate)),
    )


def _values(result: DynamicsResult, estimate: DynamicsEstimate) -> doc.Table:
    """Round values to the second digit of their half-widths."""
    units = result.arm.units([formula.name for formula in result.formulas])
    rows: list[tuple[str, ...]] = []
    for name, unit, value, half, relative in zip(
        estimate.names, units, result.values, estimate.half_width, estimate.relative_sigma, strict=True
    ):
        if not np.isfinite(value):
            rows.append((name, "–", "–", "–", unit))
            continue
        digits = digits_of(half, 9)
        rows.append((name, fixed(value, digits), fixed(half, digits), f"{short(100 * relative)} %", unit))
    caption = "With half-widths of 95 % intervals and relative standard deviations."
    columns: tuple[str, ...] = ("base parameter", "value", "±", "relative σ", "unit")
    if result.session is not None:
        columns = (*columns, "true")
        rows = [
            (*row, short(true if abs(true) > _ROUNDING else 0.0))
            for row, true in zip(rows, result.session.truth.tolist(), strict=True)
        ]
    return doc.Table(columns, tuple(rows), caption)


def _noise(result: DynamicsResult, estimate: DynamicsEstimate) -> str:
    noise = ", ".join(short(sigma) for sigma in estimate.noise)
    units = "Nm" if not any(result.robot.chain.prismatic) else "Nm (N of a slide)"
    late = ""
    if estimate.delay is not None:
        value, half = (short(1e3 * each) for each in (estimate.delay.value, estimate.delay.half_width))
        late = f" The torques are {value} ± {half} ms later than the positions."
    return (
        f"What is left of the torques is {short(100 * estimate.relative_error)} % of them. The noise of one reading is "
        f"{noise} {units} (1σ, estimated).{late}"
    )


def _physical(result: DynamicsResult) -> str:
    """State whether the parameters are physically consistent."""
    fit = result.physical
    if fit is None:
        return ""
    if fit.physical:
        return "Links, motors and joints can have these parameters."
    noise = "which the noise explains" if fit.p > PAYLOAD_RESIDUALS else "which the noise does not explain"
    taken = "the table has these" if result.options.physical else "--physical takes these"
    return (
        f"No arm has exactly what least squares found; the nearest that one has is {short(fit.distance)} standard "
        f"deviations away, {noise} (p = {fit.p:.2g}); {taken}."
    )


def _predictions(result: DynamicsResult, estimate: DynamicsEstimate) -> doc.Table:
    """Return a row for each predicted path, and for each drive of it."""
    rows = []
    for each in estimate.predictions:
        rows.append((each.of, "all", short(100 * each.total_relative, "%"), short(each.total_noise_ratio)))
        for name, relative, ratio in zip(result.robot.chain.joint_names, each.relative, each.noise_ratio, strict=True):
            rows.append(("", name, short(100 * relative, "%"), short(ratio)))
    return doc.Table(("torques of", "drive", "relative error", "error / noise"), tuple(rows))


@doc.guarded
def _loads(result: DynamicsResult, estimate: DynamicsEstimate) -> tuple[doc.Block, ...]:
    """Compare the load by both methods."""
    if estimate.load is None:
        return ()
    first = parameter_rows(estimate.load)
    difference = () if estimate.by_difference is None else parameter_rows(estimate.by_difference)
    if not first:
        return (doc.Paragraph("The motion does not identify the load."),)
    by_difference = {row[0]: _interval_text(row[1], row[2]) for row in difference}
    rows: list[doc.Row] = [
        (name, _interval_text(value, width), by_difference.get(name, "–"), unit) for name, value, width, unit in first
    ]
    columns: tuple[str, ...] = ("", "with the arm at once", "by difference of the runs", "unit")
    if result.session is not None and result.session.load is not None:
        true = true_values(result.session.load)
        columns, rows = (
            (*columns, "true"),
            [(*row, short(true[name])) for row, (name, *_) in zip(rows, first, strict=True)],
        )
    caption = "About and along the frame of the flange, with half-widths of 95 % intervals."
    return (doc.Table(columns, tuple(rows), caption),)


def _interval_text(value: float, half_width: float) -> str:
    if not np.isfinite(half_width):
        return f"{short(value)} ± –"
    digits = digits_of(half_width, 6)
    return f"{fixed(value, digits)} ± {fixed(half_width, digits)}"


def _counts(result: DynamicsResult) -> str:
    base, others = result.base, result.base.size - result.base.inertial
    left = f" ({', '.join(result.options.without)} left out)" if result.options.without else ""
    return (
        f"The torques determine {base.inertial} parameters of links and motors, and {others} of friction and offsets"
        f"{left}. The rest is grouped into them, with these coefficients of the table's lengths:"
    )


def _formulas(result: DynamicsResult) -> doc.Table:
    names = [formula.name for formula in result.formulas]
    units = result.arm.units(names)
    rows = tuple((formula.label, formula.text(), unit) for formula, unit in zip(result.formulas, units, strict=True))
    caption = (
        "XX to ZZ: inertia about and along the frame on the joint's axis; MX MY MZ: first moments; M: mass; Ia: motor "
        "inertia; Fc, Fv: Coulomb and viscous friction; off: offset. R: others are grouped into it."
    )
    return doc.Table(("base parameter", "is", "unit"), rows, caption)


def _without(result: DynamicsResult) -> str:
    names = [result.base.names[i] for i in result.base.without_effect]
    return f"No torque depends on {', '.join(names)}." if names else ""


def _conditioning(result: DynamicsResult) -> doc.Figure:
    condition = result.singular_values[0] / result.singular_values[-1]
    caption = f"Over random states, columns of unit length; the condition number is {condition:.0f}."
    return doc.Figure("singular-values-figure", singular_value_picture(result.singular_values), caption)
