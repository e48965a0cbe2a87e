"""Criteria of your own: poses for the parameter that is known worst, and for the lengths of the links alone."""

import numpy as np

import lab


class WorstParameter(lab.Criterion):
    """The largest standard deviation of a parameter, in the units of the scaling: as small as can be."""

    name = "worst"

    def score(self, information):
        """Larger is better; information matrices ``(..., p, p)`` give scores ``(...)``."""
        variances = np.diagonal(self.covariance(information), axis1=-2, axis2=-1)
        return -np.log(variances.max(axis=-1))


class LinkLengths(lab.Criterion):
    """The trace of the covariance of the links' lengths: base, tool and angles do not count."""

    name = "lengths"

    def score(self, information):
        """``names`` says which row is which parameter."""
        lengths = [name.startswith("link") and name.endswith((".a", ".d")) for name in self.names]
        return -np.log(self.covariance(information)[..., lengths, lengths].sum(axis=-1))


own = WorstParameter(), LinkLengths()
for criterion in ("O1", "A", *own):
    plan = lab.design("irb120", poses=14, candidates=100, starts=1, criterion=criterion)
    worst, lengths = (np.exp(-each.with_names(plan.parameter_names).score(plan.information) / 2) for each in own)
    name = plan.to_dict()["criterion"]
    print(f"{name:7} worst parameter {worst:.4f} of its tolerance, lengths {lengths:.4f}, O1 {plan.indices.o1:.0f}")
