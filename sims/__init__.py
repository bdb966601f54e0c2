"""Simulated robots with exact ground truth (needs the ``sims`` extra)."""

from dense_vs.sims.adapters import SimCamera, SimRobot
from dense_vs.sims.scene import FRAME_SECONDS, ROBOTS
from dense_vs.sims.surface_points import SurfacePoint
from dense_vs.sims.world import DeviceFrame, Frame, SimWorld

__all__ = ["FRAME_SECONDS", "ROBOTS", "DeviceFrame", "Frame", "SimCamera", "SimRobot", "SimWorld", "SurfacePoint"]
