"""The arm as equations: chains and mechanisms, parameters, derivatives."""
