"""Terms that a page explains at its end, where it uses them."""

import re
from collections.abc import Iterable

__all__ = ["explained"]

_TERMS = {
    "95 % interval": "A range that holds the true value in 95 of 100 such campaigns.",
    "aliased": "An error of this parameter looks exactly like errors of others, so only these are fitted.",
    "BIC": "Bayesian information criterion: how badly a model fits, with a charge for each parameter; less is better.",
    "condition number": "How much worse the worst observed combination of parameters is known than the best one.",
    "cross-validation": "Each pose is predicted by a fit to the others.",
    "degrees of freedom": "How many more numbers were measured than fitted.",
    "gate": "The largest mean error that is acceptable, given by whoever asked for the calibration.",
    "hold-out": "Poses that are measured, but not fitted: the model is validated on them.",
    "identifiable": "Such measurements can tell an error of the parameter from errors of all others.",
    "lack of fit": "The residuals are larger than the noise explains: the model leaves something out.",
    "NEES": "Normalized estimation error squared: near 1 where the stated intervals are right.",
    "nominal": "The model of the drawing, before calibration.",
    "p": "The chance of so large a deviation by noise alone.",
    "residual": "What was measured less what the fitted model predicts.",
    "RMS": "Root mean square.",
    "validation poses": "Poses that were not used to identify.",
    "weakly observable": "Identified, but known no better than to a millimetre or milliradian.",
    "σ": "One standard deviation.",
}


def explained(texts: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """The terms that texts use, each with its explanation, in alphabetical order."""
    whole = "\n".join(texts)
    return tuple(
        (term, words)
        for term, words in sorted(_TERMS.items(), key=lambda pair: pair[0].casefold())
        if re.search(rf"(?<!\w){re.escape(term)}s?(?!\w)", whole)
    )
