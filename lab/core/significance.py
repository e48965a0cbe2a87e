"""Significance levels, each named for the decision that it belongs to."""

__all__ = [
    "CAMPAIGN_OUTLIERS",
    "CERTIFICATE_VALIDATION",
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

LACK_OF_FIT = 0.05  # lack of fit of a calibrated model
VERDICT_LACK_OF_FIT = 0.01  # lack of fit that makes a calibration doubtful
PAYLOAD_RESIDUALS = 0.05  # structure in the residuals of a payload, of all tests together (Bonferroni)
STUDY_COMPARISON = 0.05  # difference of two criteria or settings of a study, of all pairs together (Holm)
MODEL_GROUPS = 0.01  # a group of parameters in the model, of all groups together (Bonferroni)
TERM_SEARCH = 0.005  # groups of single joints in the model, of the whole search
CAMPAIGN_OUTLIERS = 0.01  # any outlier among the poses of a campaign
PREDICTION_EXCEEDED = 0.01  # errors at poses that were not fitted above their prediction
VARIANCE_COMPONENTS = 0.01  # errors common to a pose, or autocorrelated from pose to pose
CERTIFICATE_VALIDATION = 0.05  # errors in validation above a certificate's budget
EXTRAPOLATION = 0.01  # errors at the edges of the measured joint range above noise
VERIFICATION = 0.01  # change of an arm since its calibration
UNSOLICITED_WARNING = 1e-3  # warnings about effects without an option: anisotropic noise
TREND_YEAR = 0.01  # change of a robot, of all tests of a year's calibrations
