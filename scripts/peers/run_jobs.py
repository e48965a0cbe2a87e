"""Run the three jobs of a package on the arrays of a file, and print what each found and its seconds as JSON."""

import json
import sys
import time

import numpy as np


def run(*jobs):
    """Run jobs; the last one takes no arrays."""
    with np.load(sys.argv[1]) as file:
        arrays = [file[name] for name in ("joints", "points", "new_joints", "new_points")]
    found = {}
    for job in jobs:
        began = time.perf_counter()
        result = job() if job.__name__ == "study" else job(*arrays)
        result = (
            {str(key): float(value) for key, value in result.items()} if isinstance(result, dict) else float(result)
        )
        found[job.__name__] = {"mm": result, "seconds": time.perf_counter() - began}
    print(json.dumps(found))
