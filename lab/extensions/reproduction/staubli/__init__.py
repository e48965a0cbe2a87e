"""A thesis on the geometric calibration of an RX 130 and the dynamic parameters of a TX 40; it breaks off at 1.4."""
