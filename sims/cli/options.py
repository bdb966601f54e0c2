"""Arguments of every command that simulates a robot."""

import argparse
import sys
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
        metavar="NAME|FILE",
        help="arm (4 joints in 3D), painted (the same in plain painted links, in a room), planar (3 joints), "
        "upper-body (two arms of 7 joints), upper-body-rake, "
        "upper-body-vacuum (with a tool), an arm that dense-vs arms has built, or the path of an MJCF "
        "file (default: arm)",
    )
    parser.add_argument(
        "--joints",
        metavar="A,B",
        help="joints to use, by their names in full, no patterns (default: all with a position actuator)",
    )
    parser.add_argument("--camera", metavar="NAME", help="camera of the model (default: its first)")
    parser.add_argument(
        "--geom-groups",
        metavar="A,B",
        help="groups of the MJCF file's geoms that are drawn, where collision shapes are others (default: 0,1,2)",
    )
    parser.add_argument("--height", type=int, default=240, metavar="PX", help="image height in pixels (default: 240)")
    parser.add_argument("--width", type=int, default=320, metavar="PX", help="image width in pixels (default: 320)")
    parser.add_argument(
        "--distractor",
        default="none",
        metavar="NAME",
        help="what moves in the scene beside the robot: none; behind or front, a textured plate there; with the upper "
        "body walker- or chair-behind, -next or -across (default: none)",
    )
    parser.add_argument(
        "--compliance",
        action="store_true",
        help="joints that are soft, late and read with noise; robots of this package only",
    )
    parser.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of textures, posture, motion and targets (default: 0)"
    )
    add_image_arguments(parser)
    add_device_arguments(parser)


def add_image_arguments(parser: argparse._ActionsContainer) -> None:
    """Declare ``--realism`` and ``--samples``."""
    parser.add_argument(
        "--samples",
        type=int,
        metavar="N",
        help="rays for a pixel's color along either side of it, more where detail aliases (default: 2 where the model "
        "has meshes or is painted, else 1)",
    )
    parser.add_argument(
        "--realism",
        nargs="?",
        const="realistic",
        default=False,
        metavar="NAME",
        help="what real cameras and encoders do: realistic (blur, rolling exposure, lens, shadows, sway, noise, "
        "flicker, vignette, compression, joint readings late, noisy and rounded) or sensor (noise, flicker, "
        "compression, late readings); realistic where no name follows (default: exact images)",
    )


def make_world(arguments: argparse.Namespace) -> "SimWorld":
    """The world that the arguments describe.

    Raises:
        DenseVSError: the ``sims`` extra is not installed, or an argument cannot be used.
    """
    try:
        from dense_vs.sims.engine.image_advice import aliasing_advice
        from dense_vs.sims.engine.model_advice import advice
        from dense_vs.sims.engine.robots import ROBOTS
        from dense_vs.sims.engine.world import SimWorld
    except ImportError as error:
        raise DenseVSError(
            f"simulation needs {error.name}, which is not installed; pip install 'dense-vs[sims]'"
        ) from error
    world = SimWorld(
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
        realism=arguments.realism,
        samples=arguments.samples,
        geom_groups=_whole_numbers(arguments.geom_groups),
    )
    if arguments.robot not in ROBOTS:
        for sentence in (*advice(world.scene), *aliasing_advice(world)):
            print(f"note: {sentence}", file=sys.stderr)
    return world


def _whole_numbers(text: str | None) -> list[int] | None:
    try:
        return None if text is None else [int(part) for part in text.split(",")]
    except ValueError:
        raise DenseVSError(f"--geom-groups is {text!r}; expected whole numbers such as 1,2") from None
