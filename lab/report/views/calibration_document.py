"""Documents and tables of a calibration for the terminal, the page and the recording."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lab.calibration.estimator import LEAST_SQUARES
from lab.calibration.identifiability import Direction
from lab.calibration.observation import observation_of, only_positions
from lab.calibration.prior import ActingPrior
from lab.calibration.statistics.model_selection import GroupTrial
from lab.core.checks import Check
from lab.core.errors import counted
from lab.core.limits import called
from lab.core.number_text import capital, digits_of, fixed, plus_minus, sentence, short
from lab.core.significance import VARIANCE_COMPONENTS
from lab.core.units import MICRONS, MM, MRAD
from lab.kinematics.parameter import Parameter
from lab.library.calibration_result import CalibrationResult
from lab.library.result import ErrorStatistics
from lab.phrases.fit_phrases import UNKNOWN_HEAD, model_name, range_text, standing
from lab.phrases.phrase import in_one_line, phrase, phrases, reason_texts
from lab.phrases.verdict_phrases import gate_text, next_step, region_text, without_figures
from lab.prediction.estimate import EstimatedParameter
from lab.report import document as doc
from lab.report.blocks import error_table, verdict_badge
from lab.report.plots import singular_value_picture
from lab.report.scene import drawn_rows
from lab.report.views.calibration_figures import (
    correction_pictures,
    correlation_picture,
    error_histograms,
    has_correction,
    residual_figures,
    where_figures,
)
from lab.report.views.calibration_scene import page_scene
from lab.verdict.fitted import one_each
from lab.verdict.remaining_error import ExplainedError
from lab.verdict.verdict import Answer, rotation_noise_rad

__all__ = ["document_of", "parameters_table"]

_MOST_LISTED = 12  # rows of a table
_MOST_PARTS = 5  # parameters of a direction
_MOST_ALIASES = 4
_EXPLAINED = (
    "A group explains the error (RMS) that a measured coordinate would have without it, all other parameters refitted. "
    "The percentage is its share of the mean square error of geometry alone. Overlapping effects each look small alone."
)
_CORRELATIONS = (
    "The blocks show the correlations of the identified parameters by link. Blue: both rise together; vermilion: "
    "one falls as the other rises. Dark cells off the diagonal mark parameters that these poses barely separate."
)
_SPREAD = "Errors before calibration (orange, hatched) and after it (blue), on a logarithmic axis; dashed: the means."
_ARM = "The arm at the fitted poses."
_ERRORS = (
    "Arrows show measured less predicted position, orange before calibration, blue after. "
    "The point's colour is the error after: the darker, the larger."
)
_SINGULAR_VALUES = (
    "The plot shows the singular values of the Jacobian (whitened rows, unit columns) of the identified "
    "parameters. The measurements barely determine a direction that is far below the others."
)
_VALIDATED = {
    "fresh": "on {count} points at validation poses without noise",
    "holdout": "on {count} points of the hold-out set",
    "file": "on {count} points of the validation measurements",
    "cross-validation": "by cross-validation on {count} points",
}
_NAMED = 5  # rejected groups that a terminal names
_GOOD = ("holds", "does not matter")  # an answer's standing; the others come first
_STATUS = {
    "identified": "identified",
    "held": "fixed at nominal on request",
    "not seen": "not observable at these poses",
    "fixed": "fixed at nominal",
}


def document_of(result: CalibrationResult) -> doc.Document:
    """Build the document of a calibration, from the verdict to the parameters and the poses."""
    reasons = phrases(result.verdict.reasons)
    if result.state.misread:  # of which no fit is to be believed
        word = doc.Paragraph(("Verdict: ", verdict_badge(result.verdict.word)), shown_in=doc.NARROW)
        return doc.Document(_title(result), (_card(result), word, _diagnosis(result), _residuals_as_read(result)))
    return doc.Document(
        _title(result),
        (
            _card(result),
            _diagnosis(result),
            *_verdict_blocks(result),
            doc.Warnings(tuple(each for each in result.warnings if each not in reasons)),
            _errors(result),
            doc.Section("Errors over the workspace", where_figures(result)),
            doc.Section("Uncertainty and goodness of fit", (*_uncertainty(result), *residual_figures(result))),
            _outliers(result),
            _parameters(result),
            doc.Section("Identifiability and conditioning", _identifiability(result)),
        ),
    )


@doc.guarded
def _diagnosis(result: CalibrationResult) -> doc.Section:
    """List what is wrong with the measurements; no section where nothing was found."""
    found = tuple(sentence(phrase(each.check)) for each in result.diagnosis)
    return doc.Section("What is wrong with the measurements", (doc.Bullets(found),))


@doc.guarded
def _residuals_as_read(result: CalibrationResult) -> doc.Section:
    """Draw the errors of misread measurements, in which rows and joints show that are read wrongly."""
    lead = doc.Paragraph(
        f"The geometry was fitted to the {result.poses:,} poses as read; nothing else was searched or validated."
    )
    return doc.Section("The fit of the measurements as read", (lead, *residual_figures(result)[1:]))


def _title(result: CalibrationResult) -> str:
    """Robot, errors before and after, verdict."""
    name, before, after = called(result.robot.name, result.options.serial), result.before, _reached(result)
    if result.state.misread:
        return f"{name}: misread measurements, {result.verdict.word}"
    if not result.validated:
        return f"{name}: identified, {result.verdict.word}"
    return f"{name}: {short(before.mean)} → {short(after.mean)} mm, {result.verdict.word}"


def _reached(result: CalibrationResult) -> ErrorStatistics:
    """Return the errors after calibration: of the poses that are no outliers, where some are."""
    return result.after_without_outliers or result.after


@doc.guarded
def _card(result: CalibrationResult) -> doc.Card:
    """Summarise on the page's first screen: the verdict, the errors before and after, the next step."""
    before, reached, verdict = result.before, _reached(result), result.verdict
    numbers: tuple[tuple[str, str, str], ...] = ()
    about = "The accuracy at other poses was not validated."
    if result.state.misread:
        first, last = result.diagnosis[0], result.diagnosis[-1]
        sizes = (("as read", first.before_m, "before"), ("undone", last.after_m, "after"))
        numbers = tuple((name, short(MM.of(size), "mm"), kind) for name, size, kind in sizes)
        about = "Root mean square error of the arm, with the measurements as read and with the mistakes undone."
    if result.validated:
        caption = "after" if result.after_without_outliers is None else "after, without outliers"
        numbers = (("before", short(before.mean, "mm"), "before"), (caption, short(reached.mean, "mm"), "after"))
        if before.mean > reached.mean > 0:
            numbers += (("smaller by a factor of", short(before.mean / reached.mean), ""),)
        about = f"Mean {_judged_error(result).rstrip(',')} {_validated_on(result)}."
    gate = f" ({gate_text(result.options.gate_mm)})"
    spread = doc.Figure("errors-figure", error_histograms(result, _judged_error(result).rstrip(",")), _SPREAD)
    return doc.Card(
        ("Verdict: ", verdict_badge(verdict.word), gate),
        numbers,
        about,
        next_step(
            verdict,
            with_outliers=bool(result.state.outliers) and not result.state.left_out,
            in_instrument_frame=result.kind.in_instrument_frame,
        ),
        (spread,),
    )


def _lead(result: CalibrationResult) -> doc.Paragraph:
    terms = result.kind.terms
    fit, before, after, targets = result.identification.fit, result.before, _reached(result), result.fitted.targets
    of = f" of target{'s' * (len(targets) > 1)} {', '.join(targets)}" if terms.names_targets else ""
    status = "stalled after" if fit.status == "in a valley" else f"{fit.status} in"
    how = f"{status} {counted(fit.iterations, 'step')}"
    if (estimator := result.options.fitting.estimator) != LEAST_SQUARES:
        how = f"estimator {estimator}"
    begun = (
        f"From {terms.measured}{of} measured in {result.poses:,} poses, {fit.rank} of "
        f"{len(result.parameters)} parameters were identified ({how})."
    )
    if not result.validated:
        return doc.Paragraph(f"{begun} The accuracy at other poses was not validated.", "lead")
    without = "" if result.after_without_outliers is None else ", without the outliers"
    text = (
        f"{begun} The mean {_judged_error(result)} {_validated_on(result)} was {short(before.mean)} mm with "
        f"the nominal model and is {short(after.mean)} mm with the calibrated one{without}."
    )
    return doc.Paragraph(text, "lead")


def _judged_error(result: CalibrationResult) -> str:
    """Name the validation's errors; a virtual arm placed by fixtures is validated by positions."""
    if result.validation.judged_by == "fresh" and not result.kind.in_instrument_frame:
        return f"position error, the {' and '.join(result.identification.unplaced)} placed anew,"
    return result.kind.terms.error


def _validated_on(result: CalibrationResult) -> str:
    assert result.validation.judged_by is not None
    return _VALIDATED[result.validation.judged_by].format(count=f"{result.after.count:,}")


@doc.guarded
def _verdict_blocks(result: CalibrationResult) -> tuple[doc.Block, ...]:
    """Word the verdict with its gate, the reasons where it is not good, and the three answers, nothing twice."""
    verdict = result.verdict
    above = [phrase(each.check) for each in result.diagnosis]
    reasons = doc.Bullets(tuple(capital(each) for each in reason_texts(verdict.reasons) if each not in above))
    because = (doc.Paragraph("Because:"), reasons) if reasons.items else ()
    answers = tuple(
        (doc.Strong(f"{capital(name)}: {each.standing}."), f" {_answer_text(each, verdict.reasons)}")
        for name, each in sorted(verdict.answers.items(), key=lambda pair: pair[1].standing in _GOOD)
    )
    word = ("Verdict: ", verdict_badge(verdict.word), f" ({gate_text(result.options.gate_mm)})")
    blocks = (*because, doc.Bullets(answers), _lead(result))
    count, fitted = len(drawn_rows(len(result.fitted))), len(result.fitted)
    which = _ARM if count == fitted else f"The arm at {count} of the {fitted:,} fitted poses, evenly spaced."
    caption = f"{which} {_ERRORS}" if observation_of(result.identification.model).positions else which
    arm = doc.Scene("arm-scene", lambda: page_scene(result), caption)
    return (
        doc.Paragraph(word, shown_in=doc.NARROW),
        *(replace(each, shown_in=doc.NARROW) for each in blocks),
        doc.Section("Errors and reasons", (arm, *blocks), shown_in=doc.PAGE),
    )


def _answer_text(answer: Answer, reasons: Sequence[Check]) -> str:
    """The figures of an answer, but where a reason above has them already."""
    above = [each.name for each in reasons]
    if "determination.limit" in above:  # whose phrase begins with the predicted errors
        above.append("determination.error")
    return "See above." if {each.name for each in answer.checks} <= set(above) else sentence(in_one_line(answer.checks))


@doc.guarded
def _errors(result: CalibrationResult) -> doc.Section:
    title, before, after = "Before and after calibration", result.before, result.after
    if not result.validated:
        return doc.Section(title, (doc.Paragraph("Too few poses for a hold-out set: the accuracy was not validated."),))
    robust = result.after_without_outliers
    stated = [("before", before), ("after", after), *([] if robust is None else [("after, without outliers", robust)])]
    rows = [(name, each.to_dict()) for name, each in stated]
    error = _judged_error(result)
    caption = f"{capital(error.rstrip(','))}, mm, {_validated_on(result)}"
    note = (
        f"Before: the nominal model, with {result.kind.terms.placed} fitted to the same measurements. "
        "After: all parameters estimated."
    )
    return doc.Section(
        title,
        (
            error_table(rows, caption, ("before", "after", "quiet")[: len(rows)]),
            _predictions(result),
            doc.Paragraph(note, "note", shown_in=doc.PAGE),
        ),
    )


def _predictions(result: CalibrationResult) -> doc.Table:
    """Tabulate the predicted errors of the arm, and at the validation poses the observed ones beside them."""
    region, elsewhere, bounds = result.verdict.region, result.verdict.elsewhere, result.state.bounds
    rows: list[doc.Row] = []
    if np.isfinite(region.p95_m):
        rows.append((region_text(region), short(MM.of(region.mean_m)), short(MM.of(region.p95_m)), "", ""))
    if elsewhere is not None and np.isfinite(elsewhere.p95_m):
        where = f"extrapolated: {100 * elsewhere.extrapolated_share:.0f} % of the workspace"
        rows.append((where, short(MM.of(elsewhere.mean_m)), short(MM.of(elsewhere.p95_m)), "", ""))
    if bounds is not None:
        sizes = (short(MM.of(size)) for size in (bounds.predicted_95_m, bounds.observed_95_m))
        rows.append(("at the validation poses", "", *sizes, f"{100 * bounds.inside_share:.0f} %"))
    columns = ("predicted", "mean", "95 %", "observed 95 %", "below their own 95 %")
    return doc.Table(columns, tuple(rows), "Predicted position error of the arm, mm", shown_in=doc.PAGE)


@doc.guarded
def _uncertainty(result: CalibrationResult) -> tuple[doc.Block, ...]:
    stiffness = tuple(
        (each.joint, f"{each.stiffness:,.0f}", f"± {each.std:,.0f}" if np.isfinite(each.std) else "–")
        for each in result.stiffnesses
    )
    groups = (*result.state.groups, *["residual"] * (result.state.process is not None))
    return (
        doc.Paragraph(f"Model: {model_name(groups)}. {sentence(without_figures(result.state.adequacy))}"),
        doc.Paragraph(_noise(result)),
        doc.Paragraph("" if result.state.range is None else range_text(result.state.range)),
        doc.Paragraph(UNKNOWN_HEAD if _lacks_head(result) else "", "note", shown_in=doc.PAGE),
        doc.Paragraph("" if result.state.remaining is None else result.state.remaining.description, shown_in=doc.PAGE),
        doc.Paragraph("" if result.state.gain is None else result.state.gain.description, shown_in=doc.PAGE),
        doc.Paragraph(_truth(result)),
        *_model_selection(result),
        doc.Paragraph(_EXPLAINED if result.state.explained else "", "note", shown_in=doc.PAGE),
        doc.Table(("joint", "stiffness, Nm/rad", "1σ"), stiffness),
    )


def _noise(result: CalibrationResult) -> str:
    identification = result.identification
    sigma_m, rotation, region = identification.sigma_m, rotation_noise_rad(identification), result.verdict.region
    if not np.isfinite(sigma_m):
        return "The noise is unknown, so the parameters have no uncertainty."
    rotations = f" and {short(MRAD.of(rotation))} mrad" if np.isfinite(rotation) else ""
    how = "given" if identification.sigma_given else "estimated from the residuals"
    sizes = " and ".join(
        f"{short(unit.of(size))} {unit.name}"
        for unit, size in result.kind.noises(identification.model, sigma_m).items()
    )
    text = f"The noise per axis is {sizes}{rotations} (1σ, {how})."
    if (shared := result.state.noise.shared) is not None:
        found_by = f"by restricted likelihood, level {100 * VARIANCE_COMPONENTS:g} %"
        found_by = "given in the robot's table" if shared.is_given else found_by
        text += f" Further errors ({found_by}): {'; '.join(shared.descriptions)}."
        text += " Weights, intervals and tests account for both."
    if result.state.instrument is not None and result.state.adequacy.name != "lack_of_fit.distances":
        text += f" {capital(result.state.instrument.description)}."
    if np.isfinite(region.rms_m):
        text += (
            f" The parameters' covariance alone predicts a position error of {short(MM.of(region.rms_m))} mm "
            f"(RMS {region_text(region)})."
        )
    return text


def _lacks_head(result: CalibrationResult) -> bool:
    """Decide whether positions were measured by an instrument of which nothing is known, not even where it was."""
    positions = only_positions(observation_of(result.identification.model))
    return positions and result.kind.in_instrument_frame and result.truth is None and result.options.instrument is None


def _truth(result: CalibrationResult) -> str:
    truth = result.truth
    if truth is None or (comparison := truth.comparison) is None or not np.isfinite(comparison.z).all():
        return ""
    text = (
        f"Compared with the truth of the virtual robot, the largest error is {np.abs(comparison.z).max():.2f} σ, the "
        f"NEES per parameter is {comparison.nees_per_parameter:.2f} (1 is expected), and "
        f"{100 * comparison.coverage_95:.0f} % of the 95 % intervals contain the true value."
    )
    if truth.outliers:
        text += f" {result.detected_outliers} of {len(truth.outliers)} simulated outliers are detected."
    return text


@doc.guarded
def _model_selection(result: CalibrationResult) -> tuple[doc.Block, ...]:
    """Tabulate the groups; a terminal shows those that were chosen, and names the first that were rejected."""
    rows = tuple(_group_row(result, group) for group in result.groups)
    kinds = tuple("" if group.chosen else "quiet" for group in result.groups)
    explains = doc.Column("explains, mm", doc.PAGE), doc.Column("explains, %", doc.PAGE)
    columns = ("group", "parameters", "hold-out error, mm", "p", "BIC", *explains, "")
    chosen = tuple(row for row, group in zip(rows, result.groups, strict=True) if group.chosen)
    names = [group.name for group in result.groups if not group.chosen]
    named = ", ".join([*names[:_NAMED], *["…"] * (len(names) > _NAMED)])
    rejected = f"{counted(len(names), 'group')} rejected: {named}; see the page." if names else ""
    return (
        doc.Table(columns, rows, "Model selection", kinds, shown_in=doc.PAGE | doc.RECORDING),
        doc.Table(
            columns, chosen, "Model selection", most_rows=_MOST_LISTED, rest_in="the page", shown_in=doc.TERMINAL
        ),
        doc.Paragraph(rejected, shown_in=doc.TERMINAL),
    )


def _group_row(result: CalibrationResult, group: GroupTrial) -> doc.Row:
    sizes = ((short, MM.of(group.holdout_m)), (short, group.f_p), (lambda bic: fixed(bic, 0), group.bic))
    return (
        group.name,
        str(group.parameters),
        *(text(size) if np.isfinite(size) else "" for text, size in sizes),
        *_explained(result.state.explained.get(group.name)),
        standing(group),
    )


def _explained(explained: ExplainedError | None) -> tuple[str, str]:
    """Format the prediction error without a group (mm) and its share of the error of geometry alone (%)."""
    return ("", "") if explained is None else (short(MM.of(explained.size_m)), f"{100 * explained.share:.2g}")


@doc.guarded
def _outliers(result: CalibrationResult) -> doc.Section:
    outliers = one_each(result.state.outliers)
    fitted = "excluded from the fit" if result.state.left_out else "kept in the fit"
    held_out = "hold-out set, kept in the validation"
    rows = tuple(
        (
            pose.id if pose.whole < 0 else f"{pose.id} and all of its picture",
            "" if pose.line is None else str(pose.line),
            short(MM.of(pose.size_m)),
            short(pose.p),
            held_out if pose.held_out else fitted,
        )
        for pose in outliers
    )
    in_file = any(pose.line is not None for pose in outliers)
    columns = ("pose", doc.Column("line", doc.EVERYWHERE if in_file else frozenset()), "residual, mm", "p", "")
    return doc.Section(f"Outliers: {len(outliers)}", (doc.Table(columns, rows, most_rows=_MOST_LISTED),))


@doc.guarded
def _parameters(result: CalibrationResult) -> doc.Section:
    caption = (
        "Corrections of the nominal values, with 95 % intervals (often smaller than the dot). "
        "Blue: the interval excludes zero; grey: it does not, or is unknown. Intervals beyond the axis are weakly "
        "observable and written as numbers."
    )
    offsets = result.robot.chain.offset_lengths
    note = (
        f"{capital(result.kind.terms.placed)} have no nominal value: the column shows their fit with the nominal "
        "dimensions. A fixed parameter stays at its nominal value; its error biases those that it is aliased with."
        + (f" A leg's length is its joint position plus its offset ({', '.join(offsets)})." if offsets else "")
    )
    return doc.Section(
        "Parameters",
        (
            parameters_table(result),
            doc.Paragraph(note, "note"),
            doc.Figure("corrections", correction_pictures(result), caption),
        ),
        shown_in=doc.PAGE,
    )


def parameters_table(result: CalibrationResult) -> doc.Table:
    """Tabulate all parameters with their 95 % intervals, or the reason for having none."""
    rows, parameters = result.parameters, result.identification.model.parameters
    kinds = tuple("" if row.identified and not row.weakly_observable else "quiet" for row in rows)
    columns = ("parameter", "correction", "95 % interval", "unit", "estimated", "nominal", "status")
    return doc.Table(columns, tuple(map(_parameter_row, parameters, rows)), row_kinds=kinds)


def _parameter_row(parameter: Parameter, row: EstimatedParameter) -> doc.Row:
    unit = parameter.unit
    half = unit.of(row.half_width_95)
    digits = digits_of(half, unit.decimals)
    return (
        doc.Code(row.name),  # what matters comes first: a telephone shows the first columns
        fixed(unit.of(row.estimate - row.nominal), digits, signed=True) if has_correction(parameter, row) else "",
        plus_minus(half, digits) if np.isfinite(half) else "",
        unit.name,
        fixed(unit.of(row.estimate), digits) if row.identified else "",
        fixed(unit.of(row.nominal), digits),
        _status(row),
    )


def _status(row: EstimatedParameter) -> str:
    """The status; of a parameter that is fixed, also what it is aliased with."""
    names = [name for name, _ in sorted(row.aliases.items(), key=lambda alias: -abs(alias[1]))]
    more = f" and {len(names) - _MOST_ALIASES} more" if len(names) > _MOST_ALIASES else ""
    aliased = f"; aliased with {', '.join(names[:_MOST_ALIASES])}{more}" if names else ""
    return f"{'weakly observable' if row.weakly_observable else _STATUS[str(row.status)]}{aliased}"


@doc.guarded
def _identifiability(result: CalibrationResult) -> tuple[doc.Block, ...]:
    """Report which parameters robot structure and measured poses leave unidentifiable or weakly observable."""
    identification = result.identification
    directions, pairs = result.weak_directions, result.correlated_pairs
    parameters = {each.name: each for each in identification.model.parameters}
    weak = tuple(
        (f"1/{1 / each.singular_value:,.0f}", _mixture(each, parameters), f"{short(MICRONS.of(each.moved))} µm")
        for each in directions
    )
    correlated = tuple((f"{one} and {other}", fixed(correlation, 3)) for one, other, correlation in pairs)
    none = "" if weak or pairs else " No parameters are strongly correlated, and no direction is weakly observable."
    return (
        doc.Paragraph(_identifiable(result) + none),
        doc.Table(
            ("relative singular value", "weakly observable: a change of", "moves the targets by"),
            weak,
            most_rows=_MOST_LISTED,
            shown_in=doc.PAGE,
        ),
        doc.Table(
            ("strongly correlated parameters", "correlation"), correlated, most_rows=_MOST_LISTED, shown_in=doc.PAGE
        ),
        doc.Figure(
            "singular-values-figure", singular_value_picture(identification.fit.singular_values), _SINGULAR_VALUES
        ),
        doc.Figure("correlations-figure", correlation_picture(result), _CORRELATIONS),
    )


def _identifiable(result: CalibrationResult) -> str:
    identification, condition = result.identification, result.identification.fit.condition
    count, rank = len(identification.base_set.identifiable), identification.fit.rank
    which = "all of them" if count == rank else str(rank)
    poorly = ", but some only weakly" if np.isfinite(condition) and identification.fit.ill_conditioned else ""
    number = f" (condition number {short(condition)})" if np.isfinite(condition) else ""
    with_prior = "" if identification.prior is None else ", with the tolerances as a prior,"
    return (
        f"Of {len(result.parameters)} parameters, {count} are identifiable on such a robot with such measurements; "
        f"these poses{with_prior} identify {which}{poorly}{number}.{_of_prior(identification.prior)}"
    )


def _of_prior(prior: ActingPrior | None) -> str:
    """Describe where tolerances take part in the fit, and the condition number without them; empty without."""
    if prior is None:
        return ""
    large = f"{short(prior.scale)} times as large as given, " if prior.scale > 1 else ""
    plain = f"{short(prior.plain_condition)}" if np.isfinite(prior.plain_condition) else "infinite"
    return (
        f" The tolerances, {large}act in {prior.acts_in} of {counted(prior.directions, 'direction')}"
        f"{', which these measurements barely determine' if prior.automatic else ''}; the condition number of the "
        f"measurements alone is {plain}."
    )


def _mixture(direction: Direction, parameters: dict[str, Parameter]) -> str:
    """A direction in words, in what a person reads."""
    parts = []
    for name, part in direction.parts[:_MOST_PARTS]:
        unit = parameters[name].unit
        parts.append(f"{short(unit.of(part))} {unit.name} of {name}")
    more = len(direction.parts) - _MOST_PARTS
    return ", ".join(parts) + (f" and {more} more" if more > 0 else "")
