"""Charts of pages as SVG, without a drawing library: what draws into matplotlib's axes draws into these as well."""
