"""The generative model of Gothoskar et al.: kinematics, feature structure and cameras learnt together from images.

:class:`GenerativeModel` and :class:`Observations` are what a user needs. The other names are the parts that it is made
of, for experiments that put them together in another way: the parameters, the least squares and its prior knowledge,
and the stages.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dense_vs.generative.bundle_adjustment import adjust_bundle as adjust_bundle
    from dense_vs.generative.end_to_end import KinematicFit as KinematicFit
    from dense_vs.generative.end_to_end import all_shared as all_shared
    from dense_vs.generative.end_to_end import fit_pixels as fit_pixels
    from dense_vs.generative.end_to_end import initial_parameters as initial_parameters
    from dense_vs.generative.expected_error import inverse_root as inverse_root
    from dense_vs.generative.initialization import guessed_intrinsics as guessed_intrinsics
    from dense_vs.generative.initialization import intrinsics_prior as intrinsics_prior
    from dense_vs.generative.joint_inference import predict as predict
    from dense_vs.generative.joint_inference import project_points as project_points
    from dense_vs.generative.joint_priors import JointActions as JointActions
    from dense_vs.generative.joint_priors import JointReadings as JointReadings
    from dense_vs.generative.model import GenerativeModel as GenerativeModel
    from dense_vs.generative.observations import Observations as Observations
    from dense_vs.generative.parameters import ModelParameters as ModelParameters
    from dense_vs.generative.parameters import link_poses as link_poses
    from dense_vs.generative.parameters import turn as turn
    from dense_vs.generative.pixel_problem import Free as Free
    from dense_vs.generative.pixel_problem import NormalEquations as NormalEquations
    from dense_vs.generative.pixel_problem import PixelProblem as PixelProblem
    from dense_vs.generative.pixel_problem import State as State
    from dense_vs.generative.stereo import Reconstruction as Reconstruction
    from dense_vs.generative.stereo import reconstruct as reconstruct

_HOMES = {
    "GenerativeModel": "model",
    "Observations": "observations",
    "ModelParameters": "parameters",
    "link_poses": "parameters",
    "turn": "parameters",
    "predict": "joint_inference",
    "project_points": "joint_inference",
    "PixelProblem": "pixel_problem",
    "State": "pixel_problem",
    "Free": "pixel_problem",
    "NormalEquations": "pixel_problem",
    "JointReadings": "joint_priors",
    "JointActions": "joint_priors",
    "guessed_intrinsics": "initialization",
    "inverse_root": "expected_error",
    "intrinsics_prior": "initialization",
    "Reconstruction": "stereo",
    "reconstruct": "stereo",
    "adjust_bundle": "bundle_adjustment",
    "KinematicFit": "end_to_end",
    "initial_parameters": "end_to_end",
    "all_shared": "end_to_end",
    "fit_pixels": "end_to_end",
}

__all__ = list(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'dense_vs.generative' has no attribute {name!r}")
    return getattr(import_module(f"dense_vs.generative.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(_HOMES)
