"""A learned corrector of your own: scikit-learn learns what the fitted geometry leaves, over the joint positions."""

import numpy as np
import tyro

import lab

try:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
except ImportError as error:
    raise SystemExit("scikit-learn is missing: pip install scikit-learn") from error


class LearnedCorrector:
    """Add to the predictions of an estimate what a Gaussian process learned from the residuals of its measurements."""

    def __init__(self, estimate, measurements, kernel=None):
        self.estimate, how = estimate, None  # a given kernel stays as it is; else the likelihood chooses its scales
        if kernel is None:
            kernel, how = ConstantKernel() * RBF() + WhiteKernel(1.0, (1e-8, 10)), "fmin_l_bfgs_b"
        self.process = GaussianProcessRegressor(kernel, normalize_y=True, optimizer=how)
        self.process.fit(self._features(measurements.joints), self._residuals(measurements))

    def predict(self, joints):
        """Return corrected positions ``(n, 3)`` of the target in m."""
        return self.estimate.predict(joints).points[:, 0] + self.process.predict(self._features(joints))

    def _residuals(self, data):
        return (data.points - self.estimate.predict(data.joints).points)[:, 0]

    @staticmethod
    def _features(joints):
        return np.concatenate([np.sin(joints), np.cos(joints)], axis=1)  # the same after a whole turn


def main():
    """Use it."""
    day = lab.simulate("irb120", poses=200, seed=7, harmonic_mrad=0.3, stiffness_nm_per_rad=1e5)
    estimate = lab.identify(day.measurements, instrument="uniform-8um").estimate
    corrector, truth = LearnedCorrector(estimate, day.measurements), day.validation
    predictions = {"geometry": estimate.predict(truth.joints).points[:, 0], "learned": corrector.predict(truth.joints)}
    for name, points in predictions.items():
        error = np.linalg.norm(points - truth.points[:, 0], axis=1)
        print(f"{name}: {1e3 * error.mean():.3f} mm at poses never measured")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
