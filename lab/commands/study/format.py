"""Factors, metrics, and effects with their intervals, as a person reads them."""

from collections.abc import Mapping, Sequence
from math import floor, isfinite, log10
from typing import Any

from lab.studies.analysis import Analysis, Comparison, Kind, Mean, Pair, Rank
from lab.studies.grid import ANY, FACTORS, Cell

__all__ = [
    "behind_text",
    "circumstances",
    "comparison_sentence",
    "effect_text",
    "factor_text",
    "level_text",
    "mean_text",
    "metric_text",
    "rank_text",
    "sentences",
    "varying",
]

METRICS = {
    "fresh_mean_mm": ("mean error on validation poses", "mm"),
    "fresh_p95_mm": ("95 % of the errors on validation poses", "mm"),
    "fresh_worst_mm": ("worst error on validation poses", "mm"),
    "length_rms_mm": ("RMS error of the lengths", "mm"),
    "angle_rms_mrad": ("RMS error of the angles", "mrad"),
    "mixed_rms": ("RMS error of all parameters", "mm and rad"),
    "nees": ("NEES per parameter, 1 expected", ""),
    "before_mm": ("mean error on validation poses before the calibration", "mm"),
    "steps": ("Gauss-Newton steps", ""),
}
_UNITS = {"poses": " poses", "position_sigma_mm": " mm", "rotation_sigma_mrad": " mrad", "noise": " times the noise"}
_AXES = {
    "poses": "number of poses",
    "position_sigma_mm": "position σ of the arm, mm",
    "rotation_sigma_mrad": "rotation σ of the arm, mrad",
}
_WIDE = 10  # a ratio's upper end over its lower
_MOST_DIGITS = 9  # after the point, to show a bound that is not zero
_NAMED = {"position_sigma_mm": "σ ", "rotation_sigma_mrad": "σ ", "scaling": "scaling "}


def metric_text(metric: str, unit: bool = True) -> str:
    """A metric as people read it, e.g. "mean error on validation poses, mm"."""
    text, its_unit = METRICS.get(metric, (metric, ""))
    return f"{text}, {its_unit}" if unit and its_unit else text


def factor_text(factor: str) -> str:
    """A factor as an axis names it."""
    return _AXES.get(factor, factor)


def circumstances(shared: Mapping[str, Any]) -> str:
    """Describe levels shared by a group's cells, e.g. "10 poses, scaling whitened"; empty if nothing else varies."""
    shown = [(name, level) for name, level in shared.items() if level != ANY]
    return ", ".join(f"{_NAMED.get(name, '')}{level}{_UNITS.get(name, '')}" for name, level in shown)


def level_text(cell: Cell, factors: Sequence[str]) -> str:
    """A cell's levels of some factors, e.g. "10 poses"."""
    return " ".join(f"{getattr(cell, name)}{_UNITS.get(name, '')}" for name in factors)


def varying(cells: Sequence[Cell]) -> tuple[str, ...]:
    """The factors of which there is more than one level."""
    return tuple(name for name in FACTORS if len({getattr(cell, name) for cell in cells}) > 1)


def effect_text(pair: Pair, kind: Kind) -> str:
    """Format the excess of a pair's second cell over the first, e.g. "4.1 % (3.7 to 4.6)".

    A ratio from 2 on, or one with a wide interval, is printed as "2.1 times (2.0 to 2.2)".
    """
    ends = (pair.effect, pair.lower, pair.upper)
    if not isfinite(pair.effect):
        return "not known"
    if kind == "difference":
        return _with_interval(ends, "")
    if pair.upper > _WIDE * pair.lower:  # few robots: hardly the order of magnitude is known
        value, lower, upper = (f"{float(f'{end:.2g}'):,.10g}" for end in ends)
        return f"{value} times ({lower} to {upper})"
    return _with_interval(ends, " times") if pair.effect >= 2 else _with_interval([100 * (e - 1) for e in ends], " %")


def mean_text(mean: Mean) -> str:
    """A mean with its interval, e.g. "0.00512 (0.00498 to 0.00526)"."""
    return _with_interval((mean.mean, mean.lower, mean.upper), "")


def _with_interval(ends: Sequence[float], unit: str) -> str:
    """A value and its interval, to the digits that it leaves, and that show on which side of zero it ends."""
    value, lower, upper = ends
    if not isfinite(lower):
        return f"{value:.3g}{unit} (too few robots for an interval)".replace("-", "−")
    half = (upper - lower) / 2
    size = 10.0 ** floor(log10(half)) if half > 0 else 1e-3
    digits = max(0, round(-log10(size)) + (half < 2 * size))
    while digits < _MOST_DIGITS and any(end and not float(f"{end:.{digits}f}") for end in ends):
        digits += 1
    shown = [f"{end + 0:.{digits}f}" for end in ends]
    return f"{shown[0]}{unit} ({shown[1]} to {shown[2]})".replace("-", "−")


def rank_text(rank: Rank) -> str:
    """A rank with its 95 % set, where that has more than one."""
    return f"{rank.rank} ({rank.lowest} to {rank.highest})" if rank.lowest < rank.highest else str(rank.rank)


def behind_text(comparison: Comparison, rank: Rank) -> str:
    """Format the excess of a cell over the first of its comparison; empty for the first."""
    first = comparison.ranks[0].cell
    return "" if rank.cell == first else effect_text(comparison.against(first, rank.cell), comparison.kind)


def sentences(analysis: Analysis, metric: str) -> list[str]:
    """Return a sentence for each comparison by a metric, and one for simulated calibrations that did not converge."""
    found = [comparison_sentence(each, analysis.cells) for each in analysis.comparisons if each.metric == metric]
    return [*found, *_failures([mean for mean in analysis.means if mean.metric == metric], analysis.cells)]


def comparison_sentence(comparison: Comparison, cells: Sequence[Cell]) -> str:
    """Describe which cell of a group is best, by how much, and which do not differ significantly."""
    group = comparison.group
    names = {i: level_text(cells[i], group.free) for i in group.cells}
    where = circumstances(group.shared)
    head = f"{where + ', ' if where else ''}by {' and '.join(group.free)}"
    if not comparison.ranks:
        return f"{head}: no simulated calibration converged in two of them, so nothing can be compared"
    ranked = [each.cell for each in comparison.ranks]
    leaders = [each.cell for each in comparison.ranks if each.lowest == 1]
    messages = [_leading([names[i] for i in leaders])]
    than = f" than {names[ranked[0]]}" if len(leaders) > 1 else ""
    for cell in ranked[1:]:
        pair = comparison.against(ranked[0], cell)
        many = comparison.kind == "ratio" and pair.effect >= 2
        messages.append(f"{names[cell]} {effect_text(pair, comparison.kind)} {'as much' if many else 'worse'}{than}")
    same = [(p.first, p.second) for p in comparison.pairs if not p.is_significant and isfinite(p.effect)]
    apart = [f"{names[i]} and {names[j]}" for i, j in same if not {i, j} <= set(leaders)]
    messages += [f"no significant difference: {', '.join(apart)}"] if apart else []
    messages += [f"{names[i]} never converged where another did" for i in group.cells if i not in ranked]
    return f"{head}: {'; '.join(messages)}"


def _leading(names: Sequence[str]) -> str:
    if len(names) == 1:
        return f"best is {names[0]}"
    return f"best are {', '.join(names[:-1])} and {names[-1]}, which do not differ significantly"


def _failures(means: Sequence[Mean], cells: Sequence[Cell]) -> list[str]:
    campaigns, lost = sum(each.campaigns for each in means), sum(each.not_converged for each in means)
    if not lost:
        return []
    worst = max(means, key=lambda each: each.not_converged / max(each.campaigns, 1))
    where = circumstances({name: getattr(cells[worst.cell], name) for name in varying(cells)})
    return [
        f"{lost:,} of {campaigns:,} simulated calibrations did not converge and are left out, as are pairs with one "
        f"of them. If many fail, the results are too favourable; the most are {worst.not_converged:,} of "
        f"{worst.campaigns:,}{f' ({where})' if where else ''}"
    ]
