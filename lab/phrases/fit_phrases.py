"""Phrases of the checks of a fit: the notes and warnings beside the verdict, by the name of each check."""

from collections.abc import Mapping, Sequence

from lab.calibration.statistics.model_selection import GroupTrial
from lab.core.checks import Check
from lab.core.errors import be, counted
from lab.core.units import MICRONS, MM, PPM
from lab.diagnosis.range_constant import FittedRange
from lab.kinematics.effects.effect_registry import describe_term
from lab.phrases.template import PRIOR, Phrase

__all__ = ["PHRASES", "UNKNOWN_HEAD", "listed", "model_name", "range_text", "standing"]

UNKNOWN_HEAD = (
    "If a tracker measured these points in its own frame, name it by --instrument (laser-tracker for one of any make): "
    "its range constant is then fitted, which otherwise shifts the base along the line of sight."
)

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


def range_text(found: FittedRange) -> str:
    """Return the range errors of a fit as sentences."""
    stated = "fitted" if found.prior_m is None else f"fitted, {MICRONS.text(found.prior_m, 2)} (1σ) stated"
    return (
        f"The range constant of the instrument is {MM.text(found.constant_m)} ± {MM.text(found.half_width_95_m, 2)} "
        f"(95 %, {stated}). An error of it displaces the arm in the instrument's frame by {found.in_frame:.2f} of "
        f"itself, along the line of sight, and relative to the base by {found.in_shape:.2f}. The scale of the range "
        f"({PPM.of(found.scale_std):.2g} ppm, 1σ) is confounded with the arm's lengths, whose intervals include it."
    )


def _retained_outliers(check: Check) -> str:
    data = check.data
    pictures = data.get("pictures", 0)
    several = data["count"] + pictures > 1
    first = "" if data["searched"] or not several else "--model auto first searches for effects that explain them; "
    single = "corner" if data.get("in_pictures") else "pose"
    named = [counted(number, what) for number, what in ((pictures, "picture"), (data["count"], single)) if number]
    count = f"{' and '.join(named)} {'are outliers' if several else 'is an outlier'}"
    return (
        f"{count}, with a residual of {'up to ' if several else ''}{MM.text(data['largest_m'])}, kept in the "
        f"fit: {first}--robust would exclude {'them' if several else 'it'}, which moves the predicted points "
        f"by {MM.text(data['moved_m'], 2)}"
    )


def _held_out_outliers(check: Check) -> str:
    count = check.data["count"]
    outliers, them = ("are outliers", "them") if count > 1 else ("is an outlier", "it")
    named = counted(count, check.data.get("what", "pose"))
    return f"{named} of the hold-out set {outliers}: the validation error includes {them}"


def _excluded_outliers(check: Check) -> str:
    named = [f"pose {name} ({MM.text(size)})" for name, size in check.data["sizes_m"].items()]
    return f"--robust excludes {counted(len(named), 'outlier')} from fit and verdict: {', '.join(named)}"


def _search_advice(check: Check, before: str) -> str:
    """Propose to search effects of the arm, after a punctuation mark; nothing where they were searched."""
    return "" if check.data["searched"] else f"{before}--model auto searches for effects of the arm"


def _undecided(check: Check) -> str:
    return (
        "errors within a pose are correlated and repeat with joint position: joint scatter and model discrepancy are "
        "confounded, so the intervals are cluster-robust by pose"
    ) + _search_advice(check, "; ")


def _between_poses(check: Check) -> str:
    shared = f"what readings of one pose share varies {check.statistic:.3g} times as much as the rest"
    text = f"{shared} (F test, p = {check.p:.1g}): joints or pictures are in error"
    if check.data["clustered"]:
        return f"{text}, so the intervals are cluster-robust by pose"
    poses = check.data["poses"]
    return (
        f"{text}; {poses} poses are too few for cluster-robust intervals, which may be too narrow: measure more poses"
    )


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


def _geometry_alone(check: Check) -> str:
    groups = ", ".join(listed(check.data["groups"]))
    error = MM.text(check.data["off_m"], 2)
    return f"{check.data['file']} cannot store {groups}; used alone it is {error} off at these poses"


def _artefact_size(check: Check) -> str:
    data = check.data
    share, half, stated = (f"{100 * data[key]:.2g} %" for key in ("share", "half_width_95", "stated"))
    if not data["corrected"]:
        return (
            f"the arm's size rests on that of {data['artefact']}, whose standard uncertainty is {stated}; "
            f"--size-u-percent states another one"
        )
    change = "larger" if data["share"] > 0 else "smaller"
    return (
        f"{data['artefact']} is {share.removeprefix('-')} {change} than stated (95 %: ±{half}), by the arm's "
        f"tolerances and all readings; its own standard uncertainty is {stated} (--size-u-percent)"
    )


def _stalled(check: Check) -> str:
    weak = ", ".join(check.data["weak"])
    return (
        f"the fit stalled after {check.data['iterations']} steps on an ill-conditioned problem"
        f"{weak and f' (weakest: {weak})'}: do not use the result; measure poses that differ more, or give {PRIOR}"
    )


def _condition(check: Check) -> str:
    weak = ", ".join(check.data["weak"])
    prior = "" if check.data["with_prior"] else f", or use tolerances ({PRIOR})"
    return (
        f"condition number {check.statistic:.0f}: these measurements barely separate the parameters"
        f"{weak and f'; {weak} uncertain by more than 1 mm or 1 mrad'}. Positions near the measured ones are "
        "accurate, single parameters are not: move every joint through more of its range, or mount the target "
        f"elsewhere{prior}"
    )


PHRASES: Mapping[str, Phrase] = {
    "note": "{text}",
    "convergence.valley": _stalled,
    "convergence.failed": (
        "Gauss-Newton did not converge in {iterations} steps: do not use the result; if parameters are weakly "
        f"observable, {PRIOR} adds the nominal model's tolerances"
    ),
    "parameters.unobservable": (
        "{parameters:list} not identifiable from these poses: fixed at nominal; move every joint through more of its "
        "range, and vary the causes of effects (payload, approach, time)"
    ),
    "parameters.condition": _condition,
    "outliers.kept": _retained_outliers,
    "outliers.held_out": _held_out_outliers,
    "outliers.search": (
        "the fit without outliers did not converge in {iterations} steps, so the list of outliers is uncertain; "
        f"{PRIOR} helps if parameters are weakly observable"
    ),
    "outliers.excluded": _excluded_outliers,
    "intervals.between_poses": _between_poses,
    "intervals.undecided": _undecided,
    "intervals.uneven": _uneven,
    "payload.assumed": "no column payload_kg: the flange is assumed to carry nothing in any pose",
    "group.incomplete": "{group} not tested: {why}",
    "group.alternative": _alternative,
    "group.not_in_validation": "{group} not tested: in the validation rows {why}",
    "backlash.some": _some_backlash,
    "selection.thinned": "groups were selected with {used:,} of the {count:,} poses, evenly spaced",
    "prior.strained": (
        "{parameter} is {statistic:.0f} tolerances from its nominal value, so --prior on biases it; give larger "
        "--tolerance-mm and --tolerance-mrad, or --prior auto"
    ),
    "size.nominal": (
        "these readings do not determine the arm's size: {parameter} is fixed at nominal, and all lengths are relative "
        "to it; give a measured distance of sockets (--socket-distance-mm), touch opposite faces of a cube, or use a "
        "board of known size, or a cable's length"
    ),
    "size.artefact": _artefact_size,
    "instrument.uneven": (
        "{source} states {best_m:µm 2} in one direction and {worst_m:µm 2} in another, so errors of the reflector's "
        "nest get too much weight: state nest_um and lock_on_um in [systematic]"
    ),
    "weak.setup": (
        "some parameters are weakly observable (weak_directions in result.json): {change} would lower the condition "
        "number of these poses from {statistic:.0f} to {condition_then:.0f}"
    ),
    "joints.counts": (
        "quantization of the encoders causes errors of {rms_m:mm} (RMS); more poses average them, more readings do not"
    ),
    "joints.rounded": "joint positions are rounded to {step_rad:deg 6}, which causes errors of {rms_m:mm} (RMS)",
    "joints.still": lambda check: (
        f"{', '.join(check.data['joints'])} never moved: errors of a joint that stands still and of links around it "
        "are not told apart; measure poses in which every joint moves"
    ),
    "joints.limits": (
        "joint {joint}: {outside} of {count:n pose} {outside:be} beyond its limits; check units, signs and offsets"
    ),
    "twist.confounded": (
        "link{link}.gj (twist of the link about its joint's axis) is confounded with the compliance of joint {link} "
        "for every pose and payload"
    ),
    "residual.offsets": (
        "residual: joint offsets are not significant in these measurements (p = {p:.2g}); leave the group out"
    ),
    "residual.thinned": "residual: {used} of {count} poses, evenly spaced, determine the joint offsets",
    "export.geometry": _geometry_alone,
    "sessions.one_setup": (
        "sessions {sessions:list} are fitted with one base and one tool: --model sessions if the tracker or the arm "
        "was bumped between them; fit each alone if one was set up anew"
    ),
    "rows.blank": "{blank} of {count} rows {blank:be} left out: they have no {reading}",
    "extrapolated": (
        "{extrapolated} of {count} {what} {extrapolated:be} extrapolated: not covered ({first} first); no fitted pose "
        "is near, and the model has a discrepancy. The predicted error there is scaled from cross-validation by region"
    ),
    "validation.beyond": (
        "{outside} of {count:n validation pose} {outside:be} beyond the fitted joint positions (first: pose {first}); "
        "expect up to {size_m:mm 2} more error there (1σ)"
    ),
    "validation.fold": "not validated: without a fold, {why}",
    "validation.unidentified": "not validated: without a fold, the other poses do not identify all parameters",
    "validation.poses": "not validated: too few poses to hold any out; about {wanted} are needed",
    "validation.convergence": (
        "{stuck} of the {count} fits of the cross-validation did not converge: the errors at their poses may be too "
        f"large; {PRIOR} helps if parameters are weakly observable"
    ),
    "validation.references": (
        "the validation file has reference rows, which only --refit uses: sessions set up anew need it"
    ),
    "validation.placement": (
        "{where}: the reference rows do not determine {parameters:list}, which keep their values; the validated errors "
        "do not depend on them"
    ),
    "validation.unplaced": "{what} {name} is not used for validation: it was not fitted, so its frame is unknown",
    "validation.frame": (
        "the validation file is judged in the frame of the campaign's start; use --refit base if it has moved since"
    ),
    "validation.payload": (
        "the validation file has no column payload_kg: the flange is assumed to carry nothing in any pose"
    ),
    "validation.improvement": "no improvement: {after_m:mm} after, {before_m:mm} before",
    "validation.singular": (
        "{lost} of {count} {what} left out (first: {first}): the real robot cannot take them in the nominal assembly "
        "mode, beyond a parallel singularity"
    ),
    "workspace.extrapolated": (
        "{share:%} of the workspace is extrapolated: the verdict holds where poses were measured (95 % error "
        "{measured_95_m:mm}). Elsewhere {elsewhere_95_m:mm} is predicted; give the region of the task with --region"
    ),
    "truth.aliased": (
        "parameters confounded on the nominal model are not confounded on this robot, so they have no true value"
    ),
}
