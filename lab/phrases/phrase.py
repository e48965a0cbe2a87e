"""The phrase of each check, by the check's name."""

from collections.abc import Iterable

from lab.core.checks import Check
from lab.phrases import diagnosis_phrases as diagnosis
from lab.phrases import fit_phrases as fit
from lab.phrases import verdict_phrases as verdict
from lab.phrases import verification_phrases as verify
from lab.phrases.template import Phrase, worded

__all__ = ["PHRASES", "in_one_line", "phrase", "phrases", "reason_texts"]

PHRASES: dict[str, Phrase] = {}
for _table in (verify.CERTIFICATE_PHRASES, fit.PHRASES, verdict.PHRASES, verify.PHRASES, diagnosis.PHRASES):
    if twice := sorted(set(PHRASES) & set(_table)):
        raise RuntimeError(f"check {twice[0]} has two phrases")
    PHRASES.update(_table)


def phrase(check: Check) -> str:
    """Return the clause that states a check: what came out, where, and what to do.

    A check without a phrase, which a step of one's own may add, is shown by its name, outcome and data.
    """
    if check.name not in PHRASES:
        data = ", ".join(f"{name} = {value}" for name, value in check.data.items())
        return f"{check.name}: {data or check.outcome}"
    return worded(PHRASES[check.name], check)


def phrases(checks: Iterable[Check]) -> tuple[str, ...]:
    """Return the phrases of checks in their order, each once."""
    return tuple(dict.fromkeys(map(phrase, checks)))


def reason_texts(reasons: Iterable[Check]) -> tuple[str, ...]:
    """Return the phrases of a verdict's reasons, with what to do where a phrase only states a test."""
    found = (
        f"{phrase(each)}. {verdict.LACK_OF_FIT_ADVICE}"
        if each.name.startswith("lack_of_fit") and each.outcome == "failed"
        else phrase(each)
        for each in reasons
    )
    return tuple(dict.fromkeys(found))


def in_one_line(checks: Iterable[Check]) -> str:
    """Return the phrases of checks as the clauses of one sentence."""
    return "; ".join(phrases(checks))
