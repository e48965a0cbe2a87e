"""Run the work of one package in its environment: answer requests from the standard input, a line of JSON each.

A package's script gives its jobs (``fit``, ``own_residual``, ``study``) and its works: functions from the arrays of the
folder to measures by name, each a call that is timed, and a function from what it returns to the answer as an array.
"""

import json
import os
import sys
import time
from pathlib import Path

import numpy as np

LEAST_S = 0.05  # processor time of one measurement: faster calls are repeated
LONG_S = 2.0


def arrays_of(name="arrays"):
    """Read arrays of the folder, in which the file lies that the package's script is given."""
    with np.load(Path(sys.argv[1]).with_name(f"{name}.npz")) as file:
        return dict(file)


def run(*jobs, **works):
    """Answer requests until the input ends: ``jobs``, a work (its measures), or one measure of a work (its seconds)."""
    replies = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a package prints is no reply
    ready, counts = {}, {}
    for line in sys.stdin:
        request = json.loads(line)
        try:
            reply = _reply(request, jobs, works, ready, counts)
        except Exception as error:  # a package's failure is reported, and the next request answered
            reply = {"error": f"{type(error).__name__}: {error}".splitlines()[0][:200]}
        print(json.dumps(reply), file=replies, flush=True)


def _reply(request, jobs, works, ready, counts):
    work, measure = request.get("work"), request.get("measure")
    if work == "jobs":
        return {"jobs": {job.__name__: _done(job) for job in jobs}}
    if work not in works:
        return {"measures": []}
    if work not in ready:
        ready[work] = works[work](arrays_of("measures"))
    if measure is None:
        return {"measures": list(ready[work])}
    (call, answer), key = ready[work][measure], (work, measure)
    if key not in counts:
        began = time.process_time()
        np.save(Path(sys.argv[1]).with_name(request["answer"]), np.asarray(answer(call())))
        spent = time.process_time() - began
        if spent > LONG_S:  # once is enough: what is done in the first call alone is a small part
            return {"seconds": spent}
        began = time.process_time()
        call()
        spent = time.process_time() - began
        counts[key] = max(1, int(np.ceil(LEAST_S / max(spent, 1e-7))))
    began = time.process_time()
    for _ in range(counts[key]):
        call()
    return {"seconds": (time.process_time() - began) / counts[key]}


def _done(job):
    """Do a job, the last of which takes no arrays: the error in mm and the seconds."""
    given = arrays_of()
    arrays = [given[name] for name in ("joints", "points", "new_joints", "new_points")]
    began = time.process_time()
    result = job() if job.__name__ == "study" else job(*arrays)
    result = {str(key): float(value) for key, value in result.items()} if isinstance(result, dict) else float(result)
    return {"mm": result, "seconds": time.process_time() - began}
