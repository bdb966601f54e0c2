"""A simulated robot for ``dense-vs live``, found by the entry point group ``dense_vs.live_sources``."""

import argparse

from dense_vs.live.source import LiveSource
from dense_vs.sims.cli.options import add_image_arguments

DEFAULT = "arm"


class SimulatedSource:
    """Chooses a simulated robot."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare ``--robot`` and what belongs to it."""
        group = parser.add_argument_group("a simulated robot")
        group.add_argument(
            "--robot",
            metavar="NAME|FILE",
            help="as of 'dense-vs reach': arm, painted, planar, upper-body, panda, ... or an MJCF file (default: arm)",
        )
        group.add_argument("--geom-groups", metavar="A,B", help="groups of the MJCF file's geoms that are drawn")
        group.add_argument("--height", type=int, default=240, metavar="PX", help="image height (default: 240)")
        group.add_argument("--width", type=int, default=320, metavar="PX", help="image width (default: 320)")
        group.add_argument("--distractor", default="none", metavar="NAME", help="what else moves (default: none)")
        group.add_argument("--compliance", action="store_true", help="soft, late joints that are read with noise")
        add_image_arguments(group)

    def make(self, arguments: argparse.Namespace, *, needed: bool) -> LiveSource | None:
        """The robot that the arguments choose; the arm where one is needed and none is chosen."""
        if arguments.robot is None and not needed:
            return None
        from dense_vs.sims.cli.options import make_world
        from dense_vs.sims.engine.adapters import SimCamera, SimRobot

        arguments.robot = DEFAULT if arguments.robot is None else arguments.robot
        world = make_world(arguments)
        return LiveSource(SimCamera(world), SimRobot(world), f"simulated {arguments.robot}", paced=False)


SOURCE = SimulatedSource()
