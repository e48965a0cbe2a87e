"""An extended Kalman filter as an estimator of your own, beside the lab's least squares."""

import numpy as np
import tyro

import lab


class KalmanFilter(lab.Estimator):
    """Update the parameters pose by pose, with derivatives at the end of the pass before (iterated), or on the way."""

    name, widest = "kalman", 0.1  # standard deviation (m, rad) of base and tool, which have no prior

    def __init__(self, passes=2):
        self.passes = passes  # 0 is the textbook's: one pass, with derivatives at each pose's own estimate

    def estimate(self, problem):
        """Return values and covariance after the last pass; each starts from the prior again."""
        unknown = np.diag(np.where(np.diag(problem.prior_information) > 0, 0, self.widest**-2))
        values = problem.start
        for _ in range(self.passes or 1):
            last, values = values, problem.start
            covariance = np.linalg.inv(problem.prior_information + unknown)
            for pose in range(len(problem.points)):
                around = last if self.passes else values
                residuals, jacobian = problem.linearized(around, [pose])
                innovation = residuals - jacobian @ (values - around)
                spread = jacobian @ covariance @ jacobian.T + np.eye(len(residuals))
                gain = np.linalg.solve(spread, jacobian @ covariance).T
                values = values + gain @ innovation
                kept = np.eye(len(values)) - gain @ jacobian
                covariance = kept @ covariance @ kept.T + gain @ gain.T  # Joseph's form stays positive definite
        return values, covariance


def main():
    """Use it."""
    day = lab.simulate("irb120", poses=40, seed=7)
    for estimator in ("least-squares", KalmanFilter()):
        result = lab.identify(day.measurements, instrument="uniform-8um", estimator=estimator)
        found = result.to_dict()
        print(f"{found['estimator']}: {found['after_mm']['mean']:.5f} mm by cross-validation, {found['verdict']}")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
