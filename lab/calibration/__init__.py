"""Fit an arm to measurements: guess, fit, select, weigh by the noise, and give intervals.

Read ``identification`` first: ``identify`` fits one model to one set of measurements, and names what it uses.

1. *Observe*: ``observation`` is the model of a measurement, ``sensor`` finds its readings in a file.
2. *Guess*: ``guess`` places base, targets and stations without initial values.
3. *Fit*: ``gauss_newton`` solves the whitened least squares; ``fit_options``, ``prior`` (tolerances of manufacture) and
   ``estimator`` (a method of your own) change what is solved; ``identifiability`` says what the poses determine, and
   ``most_likely`` which of the equivalent arms is exported.
   ``batched_fits`` solves many campaigns at once, ``alike_campaigns`` identifies those at the same poses by it.
4. *Select*: ``fitter`` fits one arm again and again: models with groups of effects (``statistics.model_selection``),
   without outliers (``statistics.outliers``), on groups of rows (``row_groups``).
5. *Weigh*: ``weights`` whitens by an instrument; ``noise_search`` finds the errors that measurements share.
6. *Intervals*: ``statistics.goodness_of_fit`` tests the fit and chooses the covariance that its residuals support;
   ``residual`` predicts what no group explains.

Validation and predicted errors are in ``lab.prediction``, the judgement in ``lab.verdict``.
"""
