"""Phrases of the checks of a fit: the notes and warnings beside the verdict, by the name of each check."""

from collections.abc import Callable, Mapping, Sequence

from lab.calibration.statistics.model_selection import GroupTrial
from lab.core.checks import Check
from lab.core.errors import be, counted
from lab.core.units import DEGREES, MICRONS, MM
from lab.kinematics.effects.registry import describe_term

__all__ = ["PHRASES", "listed", "model_name", "standing"]

_MOST_LISTED = 6  # groups of single joints in a sentence


def listed(groups: Sequence[str]) -> tuple[str, ...]:
    """The names of groups; many groups of single joints as one."""
    terms = [name for name in groups if describe_term(name)]
    if len(terms) <= _MOST_LISTED:
        return tuple(groups)
    return (*(name for name in groups if name not in terms), f"{len(terms)} groups of single joints")


def model_name(groups: Sequence[str]) -> str:
    """Geometry and the groups."""
    return " + ".join(("geometric", *listed(groups)))


def standing(group: GroupTrial) -> str:
    """Describe whether a group is in the model, its meaning for the robot, and any objection to it."""
    description = describe_term(group.name)
    chosen = (f"chosen: {description}" if description else "chosen") if group.chosen else ""
    return ", but ".join(part for part in (chosen, group.infeasibility_reason) if part)


def _note(check: Check) -> str:
    text: str = check.data["text"]
    return text


def _retained_outliers(check: Check) -> str:
    data, several = check.data, check.data["count"] > 1
    first = "" if data["searched"] or not several else "--model auto first searches for effects that explain them; "
    count = f"{data['count']} poses are outliers" if several else "1 pose is an outlier"
    return (
        f"{count}, with a residual of {'up to ' if several else ''}{MM.text(data['largest_m'])}, kept in the "
        f"fit: {first}--robust would exclude {'them' if several else 'it'}, which moves the predicted points "
        f"by {MM.text(data['moved_m'], 2)}"
    )


def _held_out_outliers(check: Check) -> str:
    count = check.data["count"]
    outliers = "are outliers" if count > 1 else "is an outlier"
    return f"{counted(count, 'pose')} of the hold-out set {outliers}: the validation error includes {_them(count)}"


def _them(count: int) -> str:
    return "them" if count > 1 else "it"


def _excluded_outliers(check: Check) -> str:
    named = [f"pose {name} ({MM.text(size)})" for name, size in check.data["sizes_m"].items()]
    return f"--robust excludes {counted(len(named), 'outlier')} from fit and verdict: {', '.join(named)}"


def _outlier_search(check: Check) -> str:
    return (
        f"the fit without outliers did not converge in {check.data['iterations']} steps, so the list of outliers is "
        "uncertain; --prior on helps if parameters are weakly observable"
    )


def _search_advice(check: Check, before: str) -> str:
    """Propose to search effects of the arm, after a punctuation mark; nothing where they were searched."""
    return "" if check.data["searched"] else f"{before}--model auto searches for effects of the arm"


def _undecided(check: Check) -> str:
    return (
        "errors within a pose are correlated and repeat with joint position: joint scatter and model discrepancy are "
        "confounded, so the intervals are cluster-robust by pose"
    ) + _search_advice(check, "; ")


def _uneven(check: Check) -> str:
    ratio = f"residuals across the line of sight are {check.statistic:.2g} times those along it"
    if check.data["of_instrument"]:
        text = (
            f"{ratio} (F test, p = {check.p:.1g}): the noise is not isotropic, so intervals and outlier test are "
            "biased; state the instrument with --instrument"
        )
    else:
        text = f"{ratio} (F test, p = {check.p:.1g}); arm or instrument may cause this{_search_advice(check, ': ')}"
    return f"{text}; the intervals are cluster-robust by pose" if check.data["clustered"] else text


def _extrapolated(check: Check) -> str:
    count = check.data["extrapolated"]
    return (
        f"{count} of {check.data['count']} {check.data['what']} {be(count)} extrapolated: not covered "
        f"({check.data['first']} first); no fitted pose is near, and the model has a discrepancy. The predicted error "
        "there is scaled from cross-validation by region"
    )


def _beyond(check: Check) -> str:
    data, outside = check.data, check.data["outside"]
    return (
        f"{outside} of {counted(data['count'], 'validation pose')} {be(outside)} beyond the fitted joint "
        f"positions (first: pose {data['first']}); expect up to {MM.text(data['size_m'], 2)} more error there (1σ)"
    )


def _workspace(check: Check) -> str:
    data = check.data
    return (
        f"{100 * data['share']:.0f} % of the workspace is extrapolated: the verdict holds where poses were measured "
        f"(95 % error {MM.text(data['measured_95_m'])}). Elsewhere {MM.text(data['elsewhere_95_m'])} is predicted; "
        "give the region of the task with --region"
    )


def _residual_offsets(check: Check) -> str:
    return f"residual: joint offsets are not significant in these measurements (p = {check.p:.2g}); leave the group out"


def _residual_thinned(check: Check) -> str:
    return f"residual: {check.data['used']} of {check.data['count']} poses, evenly spaced, determine the joint offsets"


def _instrument(check: Check) -> str:
    data = check.data
    return (
        f"{data['source']} states {MICRONS.text(data['best_m'], 2)} in one direction and "
        f"{MICRONS.text(data['worst_m'], 2)} in another, so errors of the reflector's nest get too much weight: "
        "state nest_um and lock_on_um in [systematic]"
    )


def _setup(check: Check) -> str:
    return (
        f"some parameters are weakly observable (weak_directions in result.json): {check.data['change']} would lower "
        f"the condition number of these poses from {check.statistic:.0f} to {check.data['condition_then']:.0f}"
    )


def _strained_prior(check: Check) -> str:
    return (
        f"{check.data['parameter']} is {check.statistic:.0f} tolerances from its nominal value, so --prior on biases "
        "it; give larger --tolerance-mm and --tolerance-mrad, or --prior auto"
    )


def _far_from_nominal(check: Check) -> str:
    far = (DEGREES if check.data["is_angle"] else MM).text(check.statistic)
    name = check.data["parameter"]
    return f"{name} is estimated {far} from its nominal value: is the nominal model that of this robot?"


def _size(check: Check) -> str:
    return (
        f"contacts do not determine the arm's size: {check.data['parameter']} is fixed at nominal, and all lengths are "
        "relative to it; give a measured distance of sockets (--socket-distance-mm) or measure a cable's length"
    )


def _counts(check: Check) -> str:
    return (
        f"quantization of the encoders causes errors of {MM.text(check.data['rms_m'])} (RMS); more poses average "
        "them, more readings do not"
    )


def _rounded(check: Check) -> str:
    return (
        f"joint positions are rounded to {DEGREES.text(check.data['step_rad'], 6)}, which causes errors of "
        f"{MM.text(check.data['rms_m'])} (RMS)"
    )


def _lag(check: Check) -> str:
    data = check.data
    shares = ", ".join(f"{name} {abs(share):.2g}" for name, share in data["shares"].items())
    where = f"session {data['session']}: " if data["session"] else ""
    which = "they lag behind it" if data["behind"] else "it lags behind them"
    return (
        f"{where}the recorded joint positions do not follow the arm: {which} by shares of the last move "
        f"of {shares} (F test, p = {check.p:.1g}); read the joints when the arm has settled"
    )


def _assumed_payload(_: Check) -> str:
    return "no column payload_kg: the flange is assumed to carry nothing in any pose"


def _incomplete(check: Check) -> str:
    return f"{check.data['group']} not tested: {check.data['why']}"


def _not_in_validation(check: Check) -> str:
    return f"{check.data['group']} not tested: in the validation rows {check.data['why']}"


def _alternative(check: Check) -> str:
    data = check.data
    text = (
        f"{data['chosen']} and {data['other']} are confounded at these poses (with {data['other']} instead, chi2 "
        f"changes by {check.statistic:+.1f}); "
    )
    if not data["can_be_told"]:
        return text + f"no pose and payload would separate them: they differ by at most {MM.text(data['differ_m'], 2)}"
    joints = ", ".join(f"{value:.3g}" for value in data["joints"])
    return text + (
        f"measure near joints {joints} (rad, m) with {data['payload_kg']:.3g} kg: there they differ "
        f"by {MM.text(data['differ_m'], 2)}"
    )


def _some_backlash(check: Check) -> str:
    joints, missing = check.data["joints"], check.data["missing"]
    of, are = ("joint" if len(joints) == 1 else "joints"), be(len(missing))
    return (
        f"backlash is {'tested' if check.data['searched'] else 'fitted'} for {of} {', '.join(joints)} only: "
        f"{'column' if len(missing) == 1 else 'columns'} {', '.join(missing)} {are} missing"
    )


def _thinned_selection(check: Check) -> str:
    return f"groups were selected with {check.data['used']:,} of the {check.data['count']:,} poses, evenly spaced"


def _twist(check: Check) -> str:
    link = check.data["link"]
    return (
        f"link{link}.gj (twist of the link about its joint's axis) is confounded with the compliance of joint {link} "
        "for every pose and payload"
    )


def _geometry_alone(check: Check) -> str:
    groups = ", ".join(listed(check.data["groups"]))
    error = MM.text(check.data["off_m"], 2)
    return f"{check.data['file']} cannot store {groups}; used alone it is {error} off at these poses"


def _sessions(check: Check) -> str:
    return (
        f"sessions {', '.join(check.data['sessions'])} are fitted with one base and one tool: --model sessions if the "
        "tracker or the arm was bumped between them; fit each alone if one was set up anew"
    )


def _limits(check: Check) -> str:
    data, outside = check.data, check.data["outside"]
    return (
        f"joint {data['joint']}: {outside} of {counted(data['count'], 'pose')} {be(outside)} beyond its limits; "
        "check units, signs and offsets"
    )


def _blank_rows(check: Check) -> str:
    blank = check.data["blank"]
    return f"{blank} of {check.data['count']} rows {be(blank)} left out: they have no {check.data['reading']}"


def _no_improvement(check: Check) -> str:
    after, before = check.data["after_m"], check.data["before_m"]
    return f"no improvement: {MM.text(after)} after, {MM.text(before)} before"


def _unplaced(check: Check) -> str:
    return (
        f"{check.data['what']} {check.data['name']} is not used for validation: it was not fitted, so its frame is "
        "unknown"
    )


def _frame_at_start(check: Check) -> str:
    return "the validation file is judged in the frame of the campaign's start; use --refit base if it has moved since"


def _validation_payload(_: Check) -> str:
    return "the validation file has no column payload_kg: the flange is assumed to carry nothing in any pose"


def _stalled(check: Check) -> str:
    weak = ", ".join(check.data["weak"])
    return (
        f"the fit stalled after {check.data['iterations']} steps on an ill-conditioned problem"
        f"{weak and f' (weakest: {weak})'}: do not use the result; measure poses that differ more, or give --prior on"
    )


def _not_converged(check: Check) -> str:
    return (
        f"Gauss-Newton did not converge in {check.data['iterations']} steps: do not use the result; if parameters are "
        "weakly observable, --prior on adds the nominal model's tolerances"
    )


def _unobservable(check: Check) -> str:
    return (
        f"{', '.join(check.data['parameters'])} not identifiable from these poses: fixed at nominal; move every joint "
        "through more of its range, and vary the causes of effects (payload, approach, time)"
    )


def _condition(check: Check) -> str:
    weak = ", ".join(check.data["weak"])
    prior = "" if check.data["with_prior"] else ", or use tolerances (--prior on)"
    return (
        f"condition number {check.statistic:.0f}: these measurements barely separate the parameters"
        f"{weak and f'; {weak} uncertain by more than 1 mm or 1 mrad'}. Positions near the measured ones are "
        "accurate, single parameters are not: move every joint through more of its range, or mount the target "
        f"elsewhere{prior}"
    )


def _without_a_fold(check: Check) -> str:
    return f"not validated: without a fold, {check.data['why']}"


def _unidentified_without_a_fold(_: Check) -> str:
    return "not validated: without a fold, the other poses do not identify all parameters"


def _too_few_to_hold_out(check: Check) -> str:
    return f"not validated: too few poses to hold any out; about {check.data['wanted']} are needed"


def _stuck_folds(check: Check) -> str:
    return (
        f"{check.data['stuck']} of the {check.data['count']} fits of the cross-validation did not converge: the errors "
        "at their poses may be too large; --prior on helps if parameters are weakly observable"
    )


def _unused_references(_: Check) -> str:
    return "the validation file has reference rows, which only --refit uses: sessions set up anew need it"


def _unplaced_parameters(check: Check) -> str:
    return (
        f"{check.data['where']}: the reference rows do not determine {', '.join(check.data['parameters'])}, which keep "
        "their values; the validated errors do not depend on them"
    )


def _joint_sign(check: Check) -> str:
    name = check.data["joint"]
    return (
        f"with joint {name} negated these measurements fit to {MM.text(check.data['sigma_m'], 2)} (1σ per axis), near "
        f"the nominal model: does the controller count {name} in the other direction? Change its sign in the file, or "
        "in the model"
    )


def _singular(check: Check) -> str:
    return (
        f"{check.data['lost']} of {check.data['count']} {check.data['what']} left out (first: {check.data['first']}): "
        "the real robot cannot take them in the nominal assembly mode, beyond a parallel singularity"
    )


def _aliased_truth(_: Check) -> str:
    return "parameters confounded on the nominal model are not confounded on this robot, so they have no true value"


PHRASES: Mapping[str, Callable[[Check], str]] = {
    "note": _note,
    "mistake.joint_sign": _joint_sign,
    "convergence.valley": _stalled,
    "convergence.failed": _not_converged,
    "parameters.unobservable": _unobservable,
    "parameters.condition": _condition,
    "outliers.kept": _retained_outliers,
    "outliers.held_out": _held_out_outliers,
    "outliers.search": _outlier_search,
    "outliers.excluded": _excluded_outliers,
    "intervals.undecided": _undecided,
    "intervals.uneven": _uneven,
    "payload.assumed": _assumed_payload,
    "group.incomplete": _incomplete,
    "group.alternative": _alternative,
    "group.not_in_validation": _not_in_validation,
    "backlash.some": _some_backlash,
    "selection.thinned": _thinned_selection,
    "prior.strained": _strained_prior,
    "nominal.far": _far_from_nominal,
    "contact.size": _size,
    "instrument.uneven": _instrument,
    "weak.setup": _setup,
    "joints.counts": _counts,
    "joints.rounded": _rounded,
    "joints.lag": _lag,
    "joints.limits": _limits,
    "twist.confounded": _twist,
    "residual.offsets": _residual_offsets,
    "residual.thinned": _residual_thinned,
    "export.geometry": _geometry_alone,
    "sessions.one_setup": _sessions,
    "rows.blank": _blank_rows,
    "extrapolated": _extrapolated,
    "validation.beyond": _beyond,
    "validation.fold": _without_a_fold,
    "validation.unidentified": _unidentified_without_a_fold,
    "validation.poses": _too_few_to_hold_out,
    "validation.convergence": _stuck_folds,
    "validation.references": _unused_references,
    "validation.placement": _unplaced_parameters,
    "validation.unplaced": _unplaced,
    "validation.frame": _frame_at_start,
    "validation.payload": _validation_payload,
    "validation.improvement": _no_improvement,
    "validation.singular": _singular,
    "workspace.extrapolated": _workspace,
    "truth.aliased": _aliased_truth,
}
