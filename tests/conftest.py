"""One thread for linear algebra in every process of a test run.

Tests run beside each other; OpenBLAS's threads then wait for one another by spinning, and a second's work takes
minutes. NumPy reads this when it is first imported, and so do the processes that tests start.
"""

import os

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
