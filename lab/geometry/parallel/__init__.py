"""Classical models of three parallel robots (2-RPR, 3-RPR, Delta): inverse, direct, differential, singular, reachable.

An RPR leg is a slide between two hinges. Where there are fewer modes than room, or none, the rest is NaN.
"""
