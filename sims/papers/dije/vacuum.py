"""Fig. 9: the head of a vacuum cleaner, by three joints of the left arm.

The head rolls along one line, so J has rank one there, and the targets are on that line, as in the paper.
"""

import argparse

from dense_vs.sims.papers.dije.servo_run import ServoTask
from dense_vs.sims.papers.dije.servo_task import add_task_arguments, run_task
from dense_vs.sims.papers.rows import Row

HELP = "Fig. 9: the head of a vacuum cleaner, which rolls along one line"
TASK = ServoTask(
    figure="Fig. 9",
    robot="upper-body-vacuum",
    joints=("left-shoulder-p", "left-elbow-p", "left-wrist-p"),
    points=("vacuum-head",),
    close_px=3.0,
    soft_px=5.0,
    least_distance=12.0,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    add_task_arguments(parser, TASK)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    return run_task(arguments)
