"""The generative model of Gothoskar et al.: kinematics, feature structure and cameras learnt together from images."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dense_vs.generative.model import GenerativeModel as GenerativeModel
    from dense_vs.generative.observations import Observations as Observations

_HOMES = {"GenerativeModel": "model", "Observations": "observations"}

__all__ = list(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'dense_vs.generative' has no attribute {name!r}")
    return getattr(import_module(f"dense_vs.generative.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(_HOMES)
