"""`lab payload`: identify the payload at the flange."""
