"""How tests run beside each other: one thread for linear algebra in every process, and modules as a whole.

OpenBLAS's threads wait for one another by spinning; beside another test's, a second's work takes minutes. NumPy reads
their number when it is first imported, and so do the processes that tests start.
"""

import os

import pytest

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

APART = ("test_examples.py", "test_mutation.py", "test_slides.py")  # long, with nothing that their tests share


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Of --dist loadscope: tests of a module share its costly fixtures, so one process runs them, but those apart."""
    if config.getvalue("dist") != "loadscope":
        return None
    from xdist.scheduler import LoadScopeScheduling

    class Modules(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            return nodeid if nodeid.split("::")[0].endswith(APART) else super()._split_scope(nodeid)

    return Modules(config, log)
