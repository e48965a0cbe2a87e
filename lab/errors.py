"""The one error a user of the lab sees."""


class LabError(ValueError):
    """Input that cannot be used: one line that says what, where and how to mend it."""
