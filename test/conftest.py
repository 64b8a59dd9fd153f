"""Settings of all tests."""

import os

# Before numpy is first imported: OpenBLAS's threads wait for one another in a busy loop. Beside another process at full
# load that makes kriging's small matrices ten to seventy times slower, and two workers of xdist are such processes.
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

from hypothesis import settings

# The same examples in every run, so that a change is judged by what it changes; no deadline on a machine others use.
settings.register_profile("reproducible", deadline=None, derandomize=True)
settings.load_profile("reproducible")
