"""Fig. 6, 7: four joints of the left arm bring the wrist, then the elbow, to targets in the image.

At mid-run the controlled point is redefined from wrist to elbow. J is dense, so nothing is learnt anew.
"""

import argparse

from dense_vs.sims.papers.dije.servo_run import ServoTask
from dense_vs.sims.papers.dije.servo_task import add_task_arguments, run_task
from dense_vs.sims.papers.rows import Row

HELP = "Fig. 6, 7: reaching, with the point redefined from wrist to elbow"
TASK = ServoTask(
    figure="Fig. 7",
    robot="upper-body",
    joints=("left-shoulder-p", "left-shoulder-r", "left-shoulder-y", "left-elbow-p"),
    points=("left-wrist", "left-elbow"),
    close_px=2.0,
    soft_px=5.0,
    least_distance=25.0,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    add_task_arguments(parser, TASK)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    return run_task(arguments)
