"""Which rows repeat one another, so that their scatter is noise alone."""

import numpy as np
from numpy.typing import NDArray

from lab.calibration.validation import configurations
from lab.core.measurements import FIXTURE, Measurements

__all__ = ["repeats"]


def repeats(rows: Measurements) -> NDArray[np.int_]:
    """``(n,)`` labels: rows that share one are repeats of the same, whose scatter is noise alone.

    They agree in joints, payload, approach, session, station and place; the time is passed over, or nothing would
    repeat.
    """
    told = [column for name, column in rows.conditions.items() if name.startswith(("payload_", "approach_", FIXTURE))]
    columns = [rows.sessions, *(rows.other.get(name, rows.sessions) for name in ("station", "location", "socket"))]
    texts = list(zip(*columns, strict=True))
    kinds = {text: float(i) for i, text in enumerate(dict.fromkeys(texts))}
    group = np.array([kinds[text] for text in texts])
    return configurations(np.column_stack([rows.joints, *(np.nan_to_num(column) for column in told), group]))
