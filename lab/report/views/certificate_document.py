"""Certificate of a calibration, as a document."""

from collections.abc import Mapping, Sequence

from lab.certification.budget import Budget, BudgetLine
from lab.certification.characteristics import Accuracy, Conformity
from lab.certification.lack_of_fit import LackOfFit
from lab.compensation.iso9283 import CYCLES
from lab.core.errors import LabError
from lab.core.number_text import capital, digits_of, fixed, sentence, short
from lab.core.se3 import Array
from lab.core.significance import CERTIFICATE_VALIDATION
from lab.core.units import MICRONS, MM
from lab.core.whole_folder import CHECKSUMS
from lab.library.certificate_result import Certificate, called, missing_text, not_measured
from lab.phrases.phrase import in_one_line
from lab.report import document as doc
from lab.report.blocks import error_table
from lab.report.charts.marks import Axes
from lab.report.comparison_plots import rows_picture
from lab.report.style import AFTER, GATE, INK, MUTED

__all__ = ["certificate_document", "main_picture"]

_MEASURANDS = {"position": "a calibrated position", "distance": "a distance between two calibrated positions"}
_STATISTICS = {"mean": "mean", "p95": "95th percentile", "max": "largest"}
_VALIDATED = {
    "fresh": "at validation poses of the virtual robot, without noise",
    "holdout": "of the hold-out set",
    "file": "of the validation measurements",
    "cross-validation": "by cross-validation",
}
_DECISIONS = {
    "conforms": doc.Badge("conforms", "good"),
    "does not conform": doc.Badge("does not conform", "bad"),
    "not decided": doc.Badge("not decided", "doubtful"),
}
_TOGETHER = (("Calibration", "Robot", "Environment"), ("Certificate",), ("Instrument", "Reflector"))  # in a table
_MOST_DIGITS = 6
_LEAST_P = 1e-4  # that is given in figures
_ENDLESS = 10_000  # degrees of freedom: from there on Student's t is normal to three digits
_METHOD = (
    "The instrument measured points on the robot in its own frame; the result is the robot's model with the positions "
    "that it predicts. A calibrated position is the model's prediction of the first target at a pose of the workspace. "
    "It depends on the quantities of the budget, each with a standard uncertainty u. Sensitivities follow from the "
    "fit's linear map and from closed forms of the instrument's errors. Each line of the budget is the root mean "
    "square over 200 random poses of the workspace, also outside the measured region.",
    "The law of propagation sums the variances (JCGM 100:2008); the effective degrees of freedom follow Welch and "
    "Satterthwaite. 95 % of the errors do not exceed the expanded uncertainty, over poses and calibrations like this "
    "one. The factor k is its ratio to the combined standard uncertainty. A position is a vector: k is 1.61 where its "
    "three coordinates are equally uncertain. A Monte Carlo simulation draws the quantities from their distributions "
    "(JCGM 101:2008); where the two differ in the digits given, its result is stated. Whole calibrations are drawn as "
    "well, and their parameters propagated through the full kinematics.",
)
_SIGNATURE = doc.Section(
    "Signature", (doc.Table(("", ""), (("date", "_" * 24), ("signature", "_" * 40)), shown_in=doc.PAGE),)
)
_EXAMPLE = "EXAMPLE"  # across the pages of a certificate of a virtual robot


def certificate_document(result: Certificate) -> doc.Document:
    """Build the certificate: results with uncertainty, statement, robot and session, budgets, ISO 9283, signature."""
    name = result.details.certificate.number
    what = f"EXAMPLE of a calibration certificate{f' {name}' if name else ''} (virtual robot)"
    if not result.is_example:
        what = f"calibration certificate{f' {name}' if name else ''}"
    return doc.Document(
        f"{result.calibrated.called}: {what}",
        (
            *_card(result).everywhere,
            *_withheld(result),
            doc.Section("Results", (doc.Paragraph(_lead(result), "lead", shown_in=doc.NARROW), *_results(result))),
            doc.Section("Statement of conformity", _statement(result)),
            doc.Section("Calibrated robot and measurement", _details(result)),
            doc.Warnings(result.warnings),
            *((doc.Section("Validation against the budget", _validated(result)),) if result.validation else ()),
            *(
                doc.Section(f"Uncertainty budget of {_MEASURANDS[each.measurand]}", _budget(each))
                for each in result.budgets
            ),
            *((doc.Section("Effects not included in the uncertainty", _unseen(result)),) if result.unseen else ()),
            doc.Section("Characteristics of ISO 9283:1998", _characteristics(result)),
            doc.Section(
                "Evaluation of the uncertainty", tuple(doc.Paragraph(text, shown_in=doc.PAGE) for text in _METHOD)
            ),
            doc.Section("Data that this certificate is of", _data(result)),
            *(() if result.is_example else (_SIGNATURE,)),
        ),
        _EXAMPLE if result.is_example else "",
    )


@doc.guarded
def _data(result: Certificate) -> tuple[doc.Block, ...]:
    """Tie the printed page to the files of the run, by their digests."""
    rows: tuple[doc.Row, ...] = tuple((name, doc.Code(digest)) for name, digest in result.digests.items())
    text = (
        f"These SHA-256 are of the files of the run {result.calibrated.folder.name}, which hold the measurements and "
        "the identified parameters. "
    )
    if CHECKSUMS in result.digests:
        text += (
            f"{CHECKSUMS} has those of all its other files. A file that was changed later, and listed anew, has "
            "another digest than the one on this page."
        )
    return (
        doc.Table(("file", "SHA-256"), rows, shown_in=doc.PAGE),
        doc.Paragraph(text, "note", shown_in=doc.PAGE),
    )


@doc.guarded
def _card(result: Certificate) -> doc.Card:
    run, conformity = result.calibrated.result, result.conformity
    position, distance = result.budgets
    numbers = [("U of a position", _expanded(position), ""), ("U of a distance", _expanded(distance), "")]
    if run.after_mm is not None:
        statistic = result.options.statistic
        numbers.insert(0, (f"{_STATISTICS[statistic]} error", short(run.after_mm[statistic], "mm"), ""))
    verdict: tuple[doc.Inline, ...]
    if not result.issued:
        verdict = (doc.Badge("not issued", "bad"), ": details that cannot be right")
    elif conformity is None:
        verdict = (doc.Badge("no statement"), " of conformity: nothing to compare with")
    else:
        verdict = (_DECISIONS[conformity.decision], f" with the tolerance of {short(MM.of(conformity.tolerance_m))} mm")
    if result.is_example:
        verdict = (doc.Badge("EXAMPLE", "doubtful"), " virtual robot, nothing was measured. Result: ", *verdict)
    about = (
        f"{result.calibrated.called}, calibration {run.description}. U: expanded uncertainty, 95 % coverage over the "
        "workspace."
    )
    figure = doc.Figure("errors-figure", _errors_picture(result), _ERRORS)
    return doc.Card(verdict, tuple(numbers), about, _next_step(result), (figure,))


def _next_step(result: Certificate) -> str:
    conformity = result.conformity
    if not result.issued:
        return "Correct the details named below, or measure again."
    if result.is_example:
        return "Measure the real arm, identify it with lab identify, and certify that run."
    if conformity is None:
        return "Give --tolerance-mm for a statement of conformity."
    if conformity.decision == "does not conform":
        return "Calibrate again with more poses or another model, or give a larger tolerance."
    if conformity.decision == "not decided":
        largest = _largest(result)
        return f"Reduce the uncertainty: {100 * largest.share:.0f} % of its variance is of {largest.quantity.label}."
    if result.details.missing:
        return f"State what is missing in --details, then sign: {missing_text(result.details.missing)}."
    return "Print and sign."


_ERRORS = (
    "Position errors from mean to largest, and the expanded uncertainty U of a position. Dashed: the tolerance. "
    "Logarithmic axis."
)


def _errors_picture(result: Certificate) -> tuple[doc.Picture, ...]:
    """Draw the errors of the nominal and the calibrated model, U and the tolerance on one axis."""
    run = result.calibrated.result
    rows = [
        (name, errors["mean"], errors["max"], colour)
        for name, errors, colour in (
            ("nominal model", run.before_mm, MUTED),
            ("calibrated model", run.after_mm, AFTER),
        )
        if errors is not None and errors["mean"] > 0
    ]
    if not rows:
        return ()
    expanded = MM.of(result.budgets[0].expanded_m)
    tolerance = None if result.conformity is None else MM.of(result.conformity.tolerance_m)
    sizes = [*(size for row in rows for size in row[1:3]), expanded, *([] if tolerance is None else [tolerance])]
    names = [*(row[0] for row in rows), "U of a position"]

    def draw(axes: Axes, at: Array) -> None:
        for row, (_, mean, largest, colour) in zip(at, rows, strict=False):
            axes.hlines([row], mean, largest, color=colour, linewidth=3)
            axes.plot([mean], [row], "o", color=colour, markersize=7)
        axes.plot([expanded], [at[-1]], "D", color=INK, markersize=7)
        if tolerance is not None:
            axes.axvline(tolerance, color=GATE, linewidth=1.4, linestyle="--")
            axes.annotate(
                f"tolerance {short(tolerance)} mm", (tolerance, 1.02), xycoords=("data", "axes fraction"), ha="center"
            )

    stated = ", ".join(f"{name} {short(mean)} mm (mean)" for name, mean, *_ in rows)
    label = f"Position errors: {stated}; U {expanded:.2g} mm"
    ends = min(sizes) / 1.5, max(sizes) * 1.5
    return (rows_picture("errors", label, names, draw, "mm (logarithmic)", ends=ends, step=0.35, above=0.3),)


def main_picture(result: Certificate) -> doc.Picture:
    """Return the errors beside U and the tolerance.

    Raises:
        LabError: the run was not validated.
    """
    for picture in _errors_picture(result):
        return picture
    raise LabError("the run was not validated, so there are no errors to draw")


@doc.guarded
def _withheld(result: Certificate) -> tuple[doc.Block, ...]:
    if result.issued:
        return ()
    why = in_one_line(each for each in result.implausible if each.outcome == "failed")
    badge = doc.Badge("not issued", "bad")
    return (doc.Paragraph(("This certificate is ", badge, f": {why}. Correct --details, or measure again.")),)


def _lead(result: Certificate) -> str:
    position, distance = result.budgets
    return (
        f"The expanded uncertainty of {_MEASURANDS['position']} is {_uncertainty(position)}, that of "
        f"{_MEASURANDS['distance']} {_uncertainty(distance)}; both with 95 % coverage over the workspace."
    )


def _expanded(budget: Budget) -> str:
    return f"{fixed(MM.of(budget.expanded_m), digits_of(MM.of(budget.expanded_m), _MOST_DIGITS))} mm"


def _uncertainty(budget: Budget) -> str:
    return f"{_expanded(budget)} (k = {budget.coverage_factor:.2f})"


@doc.guarded
def _details(result: Certificate) -> tuple[doc.Block, ...]:
    targets = ", ".join(result.calibrated.estimate.arm.targets)
    parts: dict[str, list[tuple[str, str]]] = {
        "Calibration": [
            ("robot model", result.calibrated.robot.name),
            ("measured", f"{result.poses} poses, targets {targets}"),
            ("measured on", str(result.calibrated.options.date or "not stated")),
            ("instrument", "unknown" if result.device is None else result.device.name),
        ]
    }
    for part, values in result.details.to_dict().items():
        rows = [
            (called(key), short(value) if isinstance(value, float) else str(value)) for key, value in values.items()
        ]
        parts[part.capitalize()] = [*rows, *_not_stated(result, part)]
    return tuple(
        doc.Table(
            ("", "", ""),
            tuple(("" if i else part, *row) for part in together for i, row in enumerate(parts.get(part, []))),
        )
        for together in _TOGETHER
    )


def _not_stated(result: Certificate, part: str) -> list[tuple[str, str]]:
    """Return a row for each detail that is missing of a part."""
    names = [name.partition(".")[2] for name in result.details.missing if name.partition(".")[0] == part]
    return [(called(name), "not stated") for name in names]


@doc.guarded
def _results(result: Certificate) -> tuple[doc.Block, ...]:
    run, distances = result.calibrated.result, result.distances
    rows: list[tuple[str, Mapping[str, float]]] = []
    where = "not validated"
    if run.before_mm is not None and run.after_mm is not None:
        where = _VALIDATED.get(run.judged_by or "", "")
        rows += [("position, nominal model", run.before_mm), ("position, calibrated model", run.after_mm)]
    names = "distance, nominal model", "distance, calibrated model"
    rows += [(name, each.to_dict()) for name, each in zip(names, distances, strict=True) if each is not None]
    caption = f"Errors, mm. Positions {where}; distances between measured poses, which need no base"
    return (error_table(rows, caption, counted="count"),)


@doc.guarded
def _statement(result: Certificate) -> tuple[doc.Block, ...]:
    conformity = result.conformity
    if not result.issued:
        return (doc.Paragraph("None: the certificate is not issued."),)
    if conformity is None:
        why = "no tolerance was given" if result.calibrated.result.after_mm is not None else "nothing was validated"
        return (doc.Paragraph(f"None: {why}."),)
    comparison = f" {_comparison(result, conformity)}"
    rule = sentence(f"rule: {conformity.rule_text}")
    note = ""
    if result.device is None and result.unseen:
        note = (
            "No instrument is named, so the measurements are not traceable to the metre: the uncertainty includes the "
            "effects that they cannot show."
        )
    return (
        doc.Paragraph((_DECISIONS[conformity.decision], comparison)),
        doc.Paragraph(note, "note"),
        doc.Paragraph(rule, "note"),
    )


@doc.guarded
def _validated(result: Certificate) -> tuple[doc.Block, ...]:
    validation = result.validation
    assert validation is not None
    rows: list[doc.Row] = [
        ("root mean square", short(MM.of(validation.observed_rms_m)), short(MM.of(validation.expected_rms_m))),
        ("95 %", short(MM.of(validation.observed_95_m)), short(MM.of(validation.expected_95_m))),
    ]
    poses = f"{validation.poses:,} poses {_VALIDATED.get(result.calibrated.result.judged_by or '', '')}"
    text = (
        f"On {poses} the errors are as large as the budget predicts, with the noise of their measurements "
        f"(p = {validation.p:.2g})."
    )
    if _is_wide(validation):
        times = short(validation.expected_rms_m / validation.observed_rms_m)
        largest = _largest(result).quantity.label
        chance = f"p = {1 - validation.p:.2g}" if 1 - validation.p >= _LEAST_P else f"p < {_LEAST_P:g}"
        text = (
            f"On {poses} the errors are smaller than the budget predicts, {times} times ({chance}). U is on the safe "
            f"side there, and may be too wide: check the largest line, {largest}."
        )
    if validation.sigma_m:
        text = (
            f"On {poses} the errors are larger than the rest of the budget predicts (p = {validation.p:.2g}). The "
            "budget "
            f"has a line for this lack of fit: {short(MM.of(validation.sigma_m))} mm in each coordinate."
        )
    caption = "Errors, mm. Predicted by the budget without the line for lack of fit"
    return doc.Table(("error", "observed", "predicted"), tuple(rows), caption), doc.Paragraph(text)


def _largest(result: Certificate) -> BudgetLine:
    """Return the largest contribution to the uncertainty of a position."""
    return max(result.budgets[0].lines, key=lambda line: line.share)


def _is_wide(lack_of_fit: LackOfFit) -> bool:
    """Decide whether validation errors are smaller than chance makes them, as where a budget is too wide."""
    return not lack_of_fit.sigma_m and 1 - lack_of_fit.p < CERTIFICATE_VALIDATION


@doc.guarded
def _unseen(result: Certificate) -> tuple[doc.Block, ...]:
    rows: tuple[doc.Row, ...] = tuple((each.description, each.remedy) for each in result.unseen)
    digits = [short(MM.of(each)) for each in result.with_unseen_m]
    text = (
        "Neither the measurements nor the instrument's specification cover these effects. With them the expanded "
        f"uncertainty would be {digits[0]} mm of a position and {digits[1]} mm of a distance."
    )
    return doc.Table(("not contained in U", "remedy"), rows), doc.Paragraph(text)


def _comparison(result: Certificate, conformity: Conformity) -> str:
    value, tolerance, expanded = (
        short(MM.of(each)) for each in (conformity.value_m, conformity.tolerance_m, conformity.expanded_m)
    )
    return (
        f"The {_STATISTICS[result.options.statistic]} position error on validation poses is {value} mm, with an "
        f"expanded uncertainty of {expanded} mm; the tolerance is {tolerance} mm."
    )


@doc.guarded
def _budget(budget: Budget) -> tuple[doc.Block, ...]:
    columns: Sequence[str | doc.Column] = (
        "quantity",
        doc.Column("source", doc.PAGE),
        doc.Column("distribution", doc.PAGE),
        "u",
        doc.Column("sensitivity, µm per unit", doc.PAGE),
        "µm",
        "ν",
        "%",
    )
    rows = tuple(_line(line) for line in budget.lines)
    drawn = digits_of(MM.of(budget.tolerance_m), _MOST_DIGITS)
    parts = (
        f"Combined standard uncertainty {short(MM.of(budget.combined_m))} mm, effective degrees of freedom "
        f"{_dof_text(budget.dof)}, "
        f"k = {budget.coverage_factor:.2f}: ",
        doc.Strong(f"U = {_uncertainty(budget)}, 95 % coverage."),
        f" By Monte Carlo, {budget.draws:,} draws: {fixed(MM.of(budget.drawn_m), drawn)} mm, which "
        f"{'confirms it' if budget.agrees else 'differs and is stated instead'}. {_of_kinematics(budget)}",
    )
    caption = (
        f"Standard uncertainty u, contribution in µm, degrees of freedom ν (∞: over {_ENDLESS:,}), "
        "share of the variance in %"
    )
    return doc.Table(tuple(columns), rows, caption), doc.Paragraph(parts)


def _of_kinematics(budget: Budget) -> str:
    """Report whether the linear map of the parameters suffices."""
    kinematics, digits = budget.kinematics, digits_of(MM.of(budget.tolerance_m), _MOST_DIGITS)
    full, linear = (fixed(MM.of(each), digits) for each in (kinematics.full_m, kinematics.linear_m))
    return (
        f"Through the full kinematics {kinematics.draws:,} drawn calibrations give {full} mm, with the linear "
        f"map {linear} "
        "mm: " + ("the linear map suffices." if budget.is_linear else "U was multiplied by their ratio.")
    )


def _line(line: BudgetLine) -> doc.Row:
    quantity = line.quantity
    uncertainty = quantity.uncertainty
    return (
        capital(quantity.label),
        quantity.source,
        uncertainty.distribution,
        short(quantity.unit.of(uncertainty.standard), quantity.unit.name).replace(" ", "\u00a0"),
        short(MICRONS.of(line.sensitivity) / quantity.unit.factor),
        short(MICRONS.of(line.contribution_m)),
        _dof_text(uncertainty.dof),
        f"{100 * line.share:.1f}",
    )


@doc.guarded
def _characteristics(result: Certificate) -> tuple[doc.Block, ...]:
    robot, (distance_before, distance_after) = result.robot, result.distances
    rows: list[doc.Row] = [("pose accuracy AP, nominal model", *_two(robot.before.accuracy))]
    if robot.after is not None:
        rows.append(("pose accuracy AP, calibrated model", *_two(robot.after.accuracy)))
    if robot.repeats is not None:
        rows.append(("pose repeatability RP", *_two(robot.repeats.repeatability)))
    names = "nominal model", "calibrated model"
    for name, each in zip(names, (distance_before, distance_after), strict=True):
        if each is not None:
            rows.append((f"distance accuracy AD, {name}", short(each.mean), short(each.max)))
    of = "rows that were not fitted"
    if robot.of_fitted_rows:
        of = "the fitted rows, which cannot test the calibrated model"
        if result.calibrated.result.after_mm is None:
            of += ": hold poses out (--holdout)"
        else:
            of += f" (its errors {_VALIDATED.get(result.calibrated.result.judged_by or '', '')} are under Results)"
    note = (
        f"All values are of positions, in mm. Accuracy: {robot.before.poses} poses, {_visits(robot.before.cycles)} "
        f"each, from {of}. "
    )
    if (repeats := robot.repeats) is not None:
        note += (
            f"Repeatability: {repeats.poses} repeated poses, {_visits(repeats.cycles)} each, from "
            f"{' and '.join(robot.repeated_in)}; the scatter within a pose does not depend on the fit. "
        )
    note += (
        f"The standard asks for {CYCLES} visits to five poses of its test cube with rated load and velocity. These "
        "numbers include the instrument's noise."
    )
    return (
        doc.Table(("characteristic", "mean", "max"), tuple(rows)),
        doc.Paragraph(note, "note"),
        doc.Paragraph(f"Not measured: {', '.join(not_measured(robot))}; orientations."),
    )


def _visits(cycles: tuple[int, int]) -> str:
    few, many = cycles
    return f"{few} visit{'s' if few > 1 else ''}" if few == many else f"{few} to {many} visits"


def _two(accuracy: Accuracy) -> tuple[str, str]:
    return short(MM.of(accuracy.mean_m)), short(MM.of(accuracy.largest_m))


def _dof_text(count: float) -> str:
    """Degrees of freedom; so many that they make no difference are infinite (JCGM 100:2008, table G.2)."""
    return "∞" if count > _ENDLESS else short(count)
