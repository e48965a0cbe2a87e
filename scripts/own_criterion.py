"""A criterion of your own: poses for the parameter that is known worst, beside those for all parameters alike."""

import numpy as np

import lab


class WorstParameter(lab.Criterion):
    """The largest standard deviation of a parameter, in the units of the scaling: as small as can be."""

    name = "worst"

    def score(self, information):
        """Larger is better; information matrices ``(..., p, p)`` give scores ``(...)``."""
        size = np.sqrt(np.maximum(np.diagonal(information, axis1=-2, axis2=-1), 1e-300))
        whole = information / size[..., :, None] / size[..., None, :]
        singular = np.linalg.eigvalsh(whole)[..., 0] < 1e-12
        whole[singular] = np.eye(whole.shape[-1])
        variances = np.diagonal(np.linalg.inv(whole), axis1=-2, axis2=-1) / size**2
        return np.where(singular, -np.inf, -np.log(variances.max(axis=-1)))


own = WorstParameter()
for criterion in ("O1", "A", own):
    plan = lab.design("irb120", poses=14, candidates=100, starts=1, criterion=criterion)
    jacobian = plan.design.jacobian.reshape(-1, plan.design.jacobian.shape[-1])
    worst = np.exp(-0.5 * own.score((jacobian.T @ jacobian)[None])[0])
    name = plan.to_dict()["criterion"]
    print(f"{name:6} worst parameter {worst:.4f} of its tolerance, O1 {plan.indices.o1:.0f}")
