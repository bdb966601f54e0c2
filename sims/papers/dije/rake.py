"""Fig. 8: the tip of a rake, by three joints of two arms.

The rake is fixed to the right hand, whose wrist gives way, and its shaft slides in the left one. Nothing knows of
rake or grip: the controller is that of the reaching experiment, the joints are others.
"""

import argparse

from dense_vs.sims.papers.dije.servo_run import ServoTask
from dense_vs.sims.papers.dije.servo_task import add_task_arguments, run_task
from dense_vs.sims.papers.rows import Row

HELP = "Fig. 8: the tip of a rake held with both hands"
TASK = ServoTask(
    figure="Fig. 8",
    robot="upper-body-rake",
    joints=("left-shoulder-p", "left-elbow-p", "right-elbow-p"),
    points=("rake-tip",),
    close_px=3.0,
    soft_px=5.0,
    least_distance=20.0,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    add_task_arguments(parser, TASK)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    return run_task(arguments)
