"""Name the conventions for three angles a, b, c about x, y, z, and their rotation R.

``intrinsic-xyz``: R = Rx(a) Ry(b) Rz(c). ``fixed-xyz``: R = Rz(c) Ry(b) Rx(a). ``rotation-vector``: R = exp(a, b, c).
Command lines are parsed by them without numpy.
"""

from typing import Literal, get_args

__all__ = ["ANGLE_CONVENTIONS", "ORDERS", "AngleConvention", "Order"]

AngleConvention = Literal["intrinsic-xyz", "fixed-xyz", "rotation-vector"]
ANGLE_CONVENTIONS: tuple[AngleConvention, ...] = get_args(AngleConvention)

Order = Literal["xyz", "xzy", "yxz", "yzx", "zxy", "zyx", "xyx", "xzx", "yxy", "yzy", "zxz", "zyz"]
ORDERS: tuple[Order, ...] = get_args(Order)
