"""A filter's state as it is now, for what changes it in place."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any


@dataclass(frozen=True)
class PresentState:
    """Of one half of a double-buffered state.

    Attributes:
        kernels: of the filter, see :func:`.jacobian_kernels`.
        state: of the kernels' kind.
        displacement: (B, N) float64 from the state's reference posture [rad].
    """

    kernels: SimpleNamespace
    state: Any
    displacement: Any
