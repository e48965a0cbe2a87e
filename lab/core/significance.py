"""Significance levels: the chance at which each test of the lab rejects although nothing is wrong.

Every level has the name of the decision that it belongs to, so that one is never changed in place of another.
"""

__all__ = [
    "CAMPAIGN_OUTLIERS",
    "CERTIFICATE_VALIDATION",
    "CHANGE_IN_TIME",
    "EXTRAPOLATION",
    "LACK_OF_FIT",
    "MODEL_GROUPS",
    "PAYLOAD_RESIDUALS",
    "PREDICTION_EXCEEDED",
    "STUDY_COMPARISON",
    "TERM_SEARCH",
    "TREND_YEAR",
    "UNSOLICITED_WARNING",
    "VARIANCE_COMPONENTS",
    "VERDICT_LACK_OF_FIT",
    "VERIFICATION",
]

LACK_OF_FIT = 0.05
"""Whether a calibrated model leaves more in the residuals than noise does."""

VERDICT_LACK_OF_FIT = 0.01
"""Whether lack of fit makes a calibration doubtful."""

PAYLOAD_RESIDUALS = 0.05
"""Whether the residuals of a payload follow anything, of all tests together (Bonferroni)."""

STUDY_COMPARISON = 0.05
"""Whether two criteria or settings of a study differ, of all pairs together (Holm)."""

MODEL_GROUPS = 0.01
"""Whether a group of parameters belongs into the model, of all groups together (Bonferroni)."""

TERM_SEARCH = 0.005
"""Whether any of the single joints' groups that are searched belongs into the model, of the whole search."""

CAMPAIGN_OUTLIERS = 0.01
"""Whether any pose of a campaign is an outlier."""

CHANGE_IN_TIME = 0.005
"""Whether anything changed during a campaign: base, tool, a joint's zero, the size of the errors; of the whole scan."""

PREDICTION_EXCEEDED = 0.01
"""Whether errors at poses that were not fitted are larger than was predicted of them."""

VARIANCE_COMPONENTS = 0.01
"""Whether errors beside the instrument's are shared: by a pose's joints, or from pose to pose."""

CERTIFICATE_VALIDATION = 0.05
"""Whether validation shows larger errors than a certificate's budget explains."""

EXTRAPOLATION = 0.01
"""Whether the edges of the measured joint positions are off by more than noise makes them."""

VERIFICATION = 0.01
"""Whether an arm has changed since it was calibrated."""

UNSOLICITED_WARNING = 1e-3
"""Whether to warn of something that nobody asked about: joints that lag, noise that is not isotropic."""

TREND_YEAR = 0.01
"""Whether a robot has changed, of all tests that a year's calibrations are put to."""
