"""Sentences and short texts on the levels of a study and their comparisons."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from math import floor, isfinite, log10

from lab.studies.analysis import LEAST_ROBOTS, Comparison, Kind, Pair
from lab.studies.grid import FACTORS, GridCell, is_any
from lab.studies.study import (
    circumstances,
    level_text,
)

__all__ = [
    "METRICS",
    "behind_best",
    "comparison_sentence",
    "effect_text",
    "factor_sentence",
    "factor_text",
    "metric_text",
    "varying",
    "with_interval",
]

METRICS = {
    "fresh_mean_mm": ("mean error on validation poses", "mm"),
    "fresh_p95_mm": ("95 % of the errors on validation poses", "mm"),
    "fresh_worst_mm": ("worst error on validation poses", "mm"),
    "length_rms_mm": ("RMS error of the lengths", "mm"),
    "angle_rms_mrad": ("RMS error of the angles", "mrad"),
    "link_length_rms_mm": ("RMS error of the arm's own lengths", "mm"),
    "link_angle_rms_mrad": ("RMS error of the arm's own angles", "mrad"),
    "mixed_rms": ("RMS error of all parameters", "mm and rad"),
    "nees": ("NEES per parameter, 1 expected", ""),
    "before_mm": ("mean error on validation poses before the calibration", "mm"),
    "steps": ("Gauss-Newton steps", ""),
}
_AXES = {
    "poses": "number of poses",
    "position_sigma_mm": "position σ of the arm, mm",
    "sampler": "sampler of the arms",
    "rotation_sigma_mrad": "rotation σ of the arm, mrad",
    "model": "fitted model",
    "robust": "robust fit",
    "prior": "prior of the tolerances",
    "observe": "what is measured",
    "plan": "poses of a plan",
    "targets": "number of targets",
    "payload_kg": "payload, kg",
}
_WORDS = {
    "observe": "what is measured",
    "targets": "number of targets",
    "payload_kg": "payload",
    "model": "fitted model",
}
_WIDE = 10  # a ratio's upper end over its lower
_EQUAL = 1e-5  # ratios are equal within this, as fits end so near to their minimum
_TOO_FEW = "too few robots for an interval"
_MOST_DIGITS = 9  # after the point, to show a bound that is not zero


def metric_text(metric: str, unit: bool = True) -> str:
    """A metric as people read it, e.g. "mean error on validation poses, mm"."""
    text, its_unit = METRICS.get(metric, (metric, ""))
    return f"{text}, {its_unit}" if unit and its_unit else text


def factor_text(factor: str) -> str:
    """A factor as an axis names it."""
    return _AXES.get(factor, factor)


def varying(cells: Sequence[GridCell]) -> tuple[str, ...]:
    """The factors of which there is more than one level."""
    return tuple(
        name for name in FACTORS if len({level for cell in cells if not is_any(name, level := getattr(cell, name))}) > 1
    )


def effect_text(pair: Pair, kind: Kind, *, note: bool = True) -> str:
    """Format the excess of a pair's second cell over the first, e.g. "4.1 % (3.7 to 4.6)".

    A ratio from 2 on, or one with a wide interval, is printed as "2.1 times (2.0 to 2.2)".

    Args:
        note: whether the text says that robots are too few for an interval.
    """
    ends = (pair.effect, pair.lower, pair.upper)
    if not isfinite(pair.effect):
        return "not known"
    if _is_equal(pair, kind):
        return f"equal (within {100 * _EQUAL:g} %)"
    if kind == "difference":
        return with_interval(ends, "", note=note)
    if pair.upper > _WIDE * pair.lower:  # few robots: hardly the order of magnitude is known
        value, lower, upper = (f"{float(f'{end:.2g}'):,.10g}" for end in ends)
        return f"{value} times ({lower} to {upper})"
    if pair.effect >= 2:
        return with_interval(ends, " times", note=note)
    return with_interval([100 * (end - 1) for end in ends], " %", note=note)


def _is_equal(pair: Pair, kind: Kind) -> bool:
    """Decide whether a ratio differs from one by rounding alone: of fits that end in the same minimum."""
    ends = [end for end in (pair.effect, pair.lower, pair.upper) if isfinite(end)]
    return kind == "ratio" and all(abs(end - 1) < _EQUAL for end in ends)


def comparison_sentence(comparison: Comparison, cells: Sequence[GridCell]) -> str:
    """Describe which cell of a group is best, by how much, and which do not differ significantly."""
    group = comparison.group
    names = {i: level_text(cells[i], group.free) for i in group.cells}
    where = circumstances(group.shared)
    head = f"{where + ', ' if where else ''}by {' and '.join(_WORDS.get(name, name) for name in group.free)}"
    if not comparison.ranks:
        return f"{head}: no simulated calibration converged in two of them, so nothing can be compared"
    ranked = [each.cell for each in comparison.ranks]
    behind = [comparison.against(ranked[0], cell) for cell in ranked[1:]]
    messages = [f"best is {names[ranked[0]]}"]
    messages += [f"{names[pair.second]} {_behind_text(pair, comparison.kind)}" for pair in behind]
    messages += _alike(comparison, names)
    messages += _few_robots(behind)
    messages += [f"{names[i]} never converged where another did" for i in group.cells if i not in ranked]
    return f"{head}: {'; '.join(messages)}"


def _behind_text(pair: Pair, kind: Kind) -> str:
    """Format how much worse the second cell of a pair is, and whether that is significant."""
    size = effect_text(pair, kind, note=False)
    if _is_equal(pair, kind):
        return size
    size += " as much" if kind == "ratio" and pair.effect >= 2 else " worse"
    return size + (", not significantly" if isfinite(pair.lower) and not pair.is_significant else "")


def _alike(comparison: Comparison, names: Mapping[int, str]) -> list[str]:
    """Return a message on pairs of levels behind the best that do not differ significantly; none without any."""
    best = comparison.ranks[0].cell
    pairs = [each for each in comparison.pairs if not each.is_significant and isfinite(each.lower)]
    alike = [f"{names[p.first]} and {names[p.second]}" for p in pairs if best not in (p.first, p.second)]
    return [f"no significant difference: {', '.join(alike)}"] if alike else []


def _few_robots(pairs: Iterable[Pair]) -> list[str]:
    """Return a message where robots are too few for an interval; none else."""
    few = [pair.robots for pair in pairs if not isfinite(pair.lower)]
    return [f"{_TOO_FEW}: {min(few)}, and {LEAST_ROBOTS} or more are needed"] if few else []


def behind_best(comparison: Comparison) -> list[Pair]:
    """Return each level that is not the best one, as its pair with the best."""
    return [comparison.against(comparison.ranks[0].cell, rank.cell) for rank in comparison.ranks[1:]]


def factor_sentence(comparisons: Sequence[Comparison], cells: Sequence[GridCell]) -> str:
    """Describe over all settings of the other factors which level is best, and how much worse the others are."""
    ranked = [each for each in comparisons if each.ranks]
    if len(comparisons) == 1 or not ranked:
        return comparison_sentence(comparisons[0], cells)
    free, count = comparisons[0].group.free, len(ranked)
    best = Counter(level_text(cells[each.ranks[0].cell], free) for each in ranked)
    head = f"by {' and '.join(_WORDS.get(name, name) for name in free)}, in {count} settings of the other factors"
    (first, times), *rest = best.most_common()
    messages = [f"best is {first}{'' if times == count else f' in {times}'}"]
    messages += [f"{name} is best in {number}" for name, number in rest]
    behind = _behind_by_level(ranked, cells, first)
    ordered = sorted(behind.items(), key=lambda item: min(pair.effect for pair in item[1]))
    messages += [f"{name} {_range_text(pairs, comparisons[0].kind)}" for name, pairs in ordered]
    messages += _few_robots(pair for pairs in behind.values() for pair in pairs)
    return f"{head}: {'; '.join(messages)}"


def _behind_by_level(comparisons: Sequence[Comparison], cells: Sequence[GridCell], first: str) -> dict[str, list[Pair]]:
    """Return the pairs of each level with the best one, of the settings in which that is the level ``first``."""
    behind: dict[str, list[Pair]] = {}
    for each in comparisons:
        if level_text(cells[each.ranks[0].cell], each.group.free) == first:
            for pair in behind_best(each):
                behind.setdefault(level_text(cells[pair.second], each.group.free), []).append(pair)
    return behind


def _range_text(pairs: Sequence[Pair], kind: Kind) -> str:
    """Format by how much a level is worse, from the least to the most over some settings, and where it is not."""
    known = [pair.effect for pair in pairs if isfinite(pair.effect)]
    tied = sum(not pair.is_significant for pair in pairs if isfinite(pair.lower))
    equal = f", not significantly in {tied}" if tied else ""
    if not known:
        return f"not known{equal}"
    low, high = min(known), max(known)
    if kind == "difference":
        text, unit = [f"{end:.3g}" for end in (low, high)], " more"
    elif high < 2:
        text, unit = [f"{100 * (end - 1):.2g}" for end in (low, high)], " % worse"
    else:
        text, unit = [f"{end:.2g}" for end in (low, high)], " times as much"
    return f"{' to '.join(dict.fromkeys(text))}{unit}".replace("-", "−") + equal


def with_interval(ends: Sequence[float], unit: str, *, note: bool = True) -> str:
    """A value and its interval, to the digits that it leaves, and that show on which side of zero it ends."""
    value, lower, upper = ends
    if not isfinite(lower):
        return f"{value:.3g}{unit}{f' ({_TOO_FEW})' if note else ''}".replace("-", "−")
    half = (upper - lower) / 2
    size = 10.0 ** floor(log10(half)) if half > 0 else 1e-3
    digits = max(0, round(-log10(size)) + (half < 2 * size))
    while digits < _MOST_DIGITS and any(end and not float(f"{end:.{digits}f}") for end in ends):
        digits += 1
    shown = [f"{end + 0:.{digits}f}" for end in ends]
    return f"{shown[0]}{unit} ({shown[1]} to {shown[2]})".replace("-", "−")
