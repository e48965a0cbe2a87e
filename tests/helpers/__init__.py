"""What tests share; one BLAS thread a process, which is set before any of it imports numpy.

On a busy machine small matrices wait a hundred times longer for a second thread.
"""

import os

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")  # commands started by tests inherit it
