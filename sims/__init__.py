"""Simulated robots with exact ground truth (needs the ``sims`` extra).

Names are imported when first used, so that the command line can describe its simulator commands without one.
"""

from typing import TYPE_CHECKING

from dense_vs.lazy_names import lazy_names

if TYPE_CHECKING:
    from dense_vs.sims.batch.batch_servo import BatchServo as BatchServo
    from dense_vs.sims.engine.adapters import SimCamera as SimCamera
    from dense_vs.sims.engine.adapters import SimRobot as SimRobot
    from dense_vs.sims.engine.depth_camera import DepthSensor as DepthSensor
    from dense_vs.sims.engine.depth_camera import SimDepthCamera as SimDepthCamera
    from dense_vs.sims.engine.frames import DeviceFrame as DeviceFrame
    from dense_vs.sims.engine.frames import Frame as Frame
    from dense_vs.sims.engine.id_segmenter import IdSegmenter as IdSegmenter
    from dense_vs.sims.engine.randomization import DomainRandomization as DomainRandomization
    from dense_vs.sims.engine.realism import Realism as Realism
    from dense_vs.sims.engine.robots import ROBOTS as ROBOTS
    from dense_vs.sims.engine.scene import FRAME_SECONDS as FRAME_SECONDS
    from dense_vs.sims.engine.surface_points import SurfacePoint as SurfacePoint
    from dense_vs.sims.engine.world import SimWorld as SimWorld

_HOMES = {
    "BatchServo": "batch.batch_servo",
    "DomainRandomization": "engine.randomization",
    "FRAME_SECONDS": "engine.scene",
    "ROBOTS": "engine.robots",
    "Realism": "engine.realism",
    "IdSegmenter": "engine.id_segmenter",
    "DepthSensor": "engine.depth_camera",
    "DeviceFrame": "engine.frames",
    "Frame": "engine.frames",
    "SimCamera": "engine.adapters",
    "SimDepthCamera": "engine.depth_camera",
    "SimRobot": "engine.adapters",
    "SimWorld": "engine.world",
    "SurfacePoint": "engine.surface_points",
}

__all__ = list(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]  # they come by __getattr__
__getattr__, __dir__ = lazy_names(__name__, _HOMES)
