"""Extensions of the core, registered by entry points as those of other packages are."""
