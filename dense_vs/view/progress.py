"""Progress bars of commands and experiments."""

import sys
from typing import Any


class _Silent:
    """Stands in for a progress bar where tqdm is not installed."""

    def update(self, _: int = 1) -> None:
        pass

    def set_description(self, _: str) -> None:
        pass

    def __enter__(self) -> "_Silent":
        return self

    def __exit__(self, *_: object) -> None:
        pass


def progress(description: str, total: int | None = None, unit: str = "frame") -> Any:
    """A progress bar on stderr, to be used as a context manager; ``update()`` after every step."""
    try:
        from tqdm import tqdm
    except ImportError:
        return _Silent()
    every = 0.1 if sys.stderr.isatty() else 10.0  # seconds; a log needs few lines
    return tqdm(total=total or None, desc=description, unit=unit, mininterval=every, dynamic_ncols=True)
