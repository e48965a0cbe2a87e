"""A statement of conformity, by a decision rule that is stated with it."""

from dataclasses import dataclass
from typing import Literal

__all__ = ["Conformity", "DecisionRule", "conformity_of"]

DecisionRule = Literal["guard-band", "simple"]
Decision = Literal["conforms", "does not conform", "not decided"]
_WORDS = {
    "simple": (
        "simple acceptance (JCGM 106:2012, 8.2): it conforms where the value is not above the tolerance; the risk of a "
        "wrong statement is shared, and is up to 50 % for a value at the tolerance"
    ),
    "guard-band": (
        "guard band of the expanded uncertainty (JCGM 106:2012, 8.3; ILAC-G8:09/2019; stricter than the default of "
        "ISO 14253-1:2017, 1.65 standard uncertainties): it conforms where the value with the expanded uncertainty is "
        "not above the tolerance, and does not conform where the value without it is above; between, nothing is decided"
    ),
}


@dataclass(frozen=True)
class Conformity:
    """Whether a value conforms to a tolerance.

    Attributes:
        value_m: what was found.
        tolerance_m: the largest that is allowed.
        expanded_m: expanded uncertainty of the value.
    """

    value_m: float
    tolerance_m: float
    expanded_m: float
    rule: DecisionRule
    decision: Decision

    @property
    def words(self) -> str:
        """The rule, for a person."""
        return _WORDS[self.rule]


def conformity_of(value_m: float, tolerance_m: float, expanded_m: float, rule: DecisionRule) -> Conformity:
    """The statement on a value with an expanded uncertainty (m), by a rule."""
    guard = expanded_m if rule == "guard-band" else 0.0
    decision: Decision = "not decided"
    if value_m + guard <= tolerance_m:
        decision = "conforms"
    elif value_m - guard > tolerance_m:
        decision = "does not conform"
    return Conformity(value_m, tolerance_m, expanded_m, rule, decision)
