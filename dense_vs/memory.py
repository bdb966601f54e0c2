"""How much memory there is, asked before much of it is taken.

Linux promises more memory than there is and ends the process that uses it, so a failed allocation comes too late.
"""

from contextlib import suppress
from pathlib import Path


def free_memory() -> int:
    """Memory that this process may still take [bytes]: the machine's, its control group's and its own limit, the least
    of those that the system tells.
    """
    found = [1 << 62]
    with suppress(OSError, ValueError, IndexError):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        found += [1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
    with suppress(OSError, ValueError, IndexError):
        group = Path("/sys/fs/cgroup")
        limit = int((group / "memory.max").read_text(encoding="ascii"))
        lines = (group / "memory.stat").read_text(encoding="ascii").splitlines()
        found += [limit - int(line.split()[1]) for line in lines if line.startswith("anon ")]  # the rest is cache
    with suppress(ImportError, OSError, ValueError, IndexError):
        import resource

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
            found.append(limit - pages * resource.getpagesize())
    return max(min(found), 0)
