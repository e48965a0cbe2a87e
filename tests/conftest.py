"""One BLAS thread a process: on a busy machine small matrices wait a hundred times longer for a second one."""

import os

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")  # before numpy is imported; commands started by tests inherit it
