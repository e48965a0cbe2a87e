"""``lab verify``: new points of a calibrated arm, or its daily touches of a socket."""
