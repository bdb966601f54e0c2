"""The generative model of Gothoskar et al.: kinematics, feature structure and cameras learned together from images.

:class:`GenerativeModel` and :class:`Observations` are what a user needs; the rooms below hold the parts:
``least_squares``, ``reconstruction``, ``kinematics``, ``inference`` and ``learning``.

May import: the ground and kernels.
"""

from dense_vs.generative.model import GenerativeModel
from dense_vs.generative.observations import Observations
from dense_vs.generative.report import FitReport

__all__ = ["FitReport", "GenerativeModel", "Observations"]
