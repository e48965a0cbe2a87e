"""Which poses to measure: candidates' information, exchange and ascent, certificate, promise, tour."""
