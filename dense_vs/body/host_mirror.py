"""An array on a device and its copy on the host, for a thread that has a stream of its own.

``wp.array.numpy()`` and ``assign()`` go through the device's current stream, which all threads of the process share;
the copies here name their stream. On a CPU both are one array.
"""

from typing import Any

import numpy as np
import warp as wp


class HostMirror:
    """An array of zeros on a device, with a host copy that is brought up to date when asked for.

    Args:
        shape, dtype: of the Warp array.
        device: where it lies.

    Attributes:
        array: on the device.
        host: NumPy view of the copy, to read after :meth:`down` or to fill before :meth:`up`.
    """

    def __init__(self, shape: tuple[int, ...], dtype: Any, device: wp.Device):
        self.array: Any = wp.zeros(shape, dtype=dtype, device=device)
        self._copy: Any = self.array if device.is_cpu else wp.zeros(shape, dtype=dtype, device="cpu", pinned=True)
        self.host: np.ndarray = self._copy.numpy()

    def up(self, stream: wp.Stream | None) -> None:
        """Host to device."""
        if self._copy is not self.array:
            wp.copy(self.array, self._copy, stream=stream)

    def down(self, stream: wp.Stream | None) -> np.ndarray:
        """Device to host, waiting for it; the host's view."""
        if self._copy is not self.array:
            wp.copy(self._copy, self.array, stream=stream)
            assert stream is not None  # a GPU's thread has one
            wp.synchronize_stream(stream)
        return self.host
