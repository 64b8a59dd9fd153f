"""What a person calls: ``mbpam`` and its verbs, each with its own arguments, on top of nodes and studies."""

import os

# Before numpy: the matrices are small, and OpenBLAS's idle threads spin. Beside other load they made fits of kriging
# cost twelve times as much.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
