"""Names, help lines and homes of the commands, so that nothing else need be imported to list them.

Packages add commands of their own through the entry point group ``dense_vs.commands``: each entry point names a
dictionary of :class:`Command` by name. The simulator's commands come that way too.
"""

from importlib import metadata
from typing import NamedTuple

GROUP = "dense_vs.commands"


class Command(NamedTuple):
    """One command.

    Attributes:
        home: import name of a module with ``add_arguments(parser)`` and ``run(arguments)``; its docstring describes
            the command.
        help: one line.
    """

    home: str
    help: str


COMMANDS = {
    "body": Command("dense_vs.cli.body", "learn a body model from a recording: links, joints, surface"),
    "depth-eval": Command("dense_vs.cli.depth_eval", "score depth from masks on the sets of the ODMS benchmark"),
    "estimate": Command("dense_vs.cli.estimate", "estimate the dense image Jacobian from a recording"),
    "info": Command("dense_vs.cli.info", "show what is in a recording"),
    "learn-model": Command("dense_vs.cli.learn_model", "learn an arm's generative model from the pixels of features"),
    "live": Command("dense_vs.cli.live", "a page on which to click a point of the robot and where it should go"),
    "segment": Command("dense_vs.cli.segment", "find an object in images or a video"),
    "segment-train": Command(
        "dense_vs.cli.segment_train", "learn to segment an object from about ten annotated images"
    ),
    "sweep": Command("dense_vs.cli.sweep", "run commands over seeds and options, on several cores or machines"),
}


def all_commands() -> dict[str, Command]:
    """The commands above and those of installed packages, in the order of their names."""
    found = dict(COMMANDS)
    for entry_point in metadata.entry_points(group=GROUP):
        found |= entry_point.load()
    return dict(sorted(found.items()))
