"""``dense-vs arms``: build the scene of a commercial arm, so that ``--robot NAME`` finds it.

Meshes and materials come from the packages robosuite and, for Fetch, gymnasium-robotics, which pip downloads without
their dependencies; nothing is installed. Cameras A to H see the arm from eight sides.
"""

import argparse
from pathlib import Path

from dense_vs.sims.engine.built_scenes import ARM_NAMES


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("names", nargs="+", metavar="NAME", help=f"one or more of {', '.join(ARM_NAMES)}")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder for NAME/scene.xml (default: where --robot NAME looks, $DENSE_VS_ARMS or the user's cache)",
    )


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from dense_vs.errors import DenseVSError
    from dense_vs.sims.arms.build import build_arm

    unknown = [name for name in arguments.names if name not in ARM_NAMES]
    if unknown:
        raise DenseVSError(f"arm {unknown[0]!r} is unknown; expected some of {', '.join(ARM_NAMES)}")
    for name in arguments.names:
        print(f"{name}: {build_arm(name, arguments.out)}")
