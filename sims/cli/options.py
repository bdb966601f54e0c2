"""Arguments of every command that simulates a robot."""

import argparse
from typing import TYPE_CHECKING

from dense_vs.cli.options import add_device_arguments
from dense_vs.errors import DenseVSError

if TYPE_CHECKING:
    from dense_vs.sims.engine.world import SimWorld


def add_world_arguments(parser: argparse.ArgumentParser) -> None:
    """Which robot, which camera, which seed, which device."""
    parser.add_argument(
        "--robot",
        default="arm",
        help="arm (4 joints in 3D), planar (3 joints), upper-body (two arms of 7 joints), upper-body-rake, "
        "upper-body-vacuum (with a tool), or the path of an MJCF file (default: arm)",
    )
    parser.add_argument("--joints", metavar="A,B,C", help="joints to use (default: all with a position actuator)")
    parser.add_argument("--camera", help="camera of the model (default: its first)")
    parser.add_argument("--height", type=int, default=240, help="image height in pixels (default: 240)")
    parser.add_argument("--width", type=int, default=320, help="image width in pixels (default: 320)")
    parser.add_argument(
        "--distractor",
        default="none",
        help="none, behind or front: a textured plate that moves behind or before the arm; for the upper body "
        "walker or chair -behind, -next or -across, as walker-behind (default: none)",
    )
    parser.add_argument(
        "--compliance", action="store_true", help="joints that are soft, late and read with noise; our robots only"
    )
    parser.add_argument("--seed", type=int, default=0, help="of textures, posture, motion and targets (default: 0)")
    add_device_arguments(parser)


def make_world(arguments: argparse.Namespace) -> "SimWorld":
    """The world that the arguments describe.

    Raises:
        DenseVSError: the ``sims`` extra is not installed, or an argument cannot be used.
    """
    try:
        from dense_vs.sims.engine.world import SimWorld
    except ImportError as error:
        raise DenseVSError(
            f"simulation needs {error.name}, which is not installed; pip install 'dense-vs[sims]'"
        ) from error
    return SimWorld(
        arguments.robot,
        joints=arguments.joints.split(",") if arguments.joints else None,
        camera=arguments.camera,
        device=arguments.device,
        height=arguments.height,
        width=arguments.width,
        seed=arguments.seed,
        threads=arguments.threads,
        distractor=arguments.distractor,
        compliance=arguments.compliance,
    )
