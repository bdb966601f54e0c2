"""The papers' experiments on simulated robots: a folder a paper, a module an experiment.

An experiment is a module whose docstring describes it, with ``add_arguments(parser)`` for arguments of its own beside
those that all share, and ``run(arguments) -> list[Row]``, which draws into ``arguments.out``, repeats itself for every
seed of ``arguments.seeds``, and reports its progress. ``dense-vs reproduce`` finds it in ``PAPERS``, prints its rows
beside the paper's and writes them as JSON.
"""

from typing import NamedTuple


class Experiment(NamedTuple):
    """One experiment: the import name of its module, imported when it is named on the command line, and a help line."""

    home: str
    help: str


class Paper(NamedTuple):
    """One paper: a help line, and its experiments by name."""

    help: str
    experiments: dict[str, Experiment]


def _paper(folder: str, help_line: str, **experiments: str) -> Paper:
    """A paper whose experiments ``name`` are the modules of that name in a folder."""
    named = {
        name.replace("_", "-"): Experiment(f"{__name__}.{folder}.{name}", line) for name, line in experiments.items()
    }
    return Paper(help_line, named)


PAPERS = {
    "dije": _paper(
        "dije",
        "dense image Jacobian estimation: self-recognition, servoing without markers, tools",
        labels="Fig. 2: every stage of self-recognition as one picture",
        leak="Fig. 4: how far labels leak into a person who walks by, with (13), with (14) and by default",
        rake="Fig. 8: the tip of a rake held with both hands",
        reach="Figs. 6, 7: reaching, with the point redefined from wrist to elbow",
        vacuum="Fig. 9: the head of a vacuum cleaner, which rolls along one line",
    ),
    "gothoskar": _paper(
        "gothoskar",
        "the generative model of an arm: kinematics, markers and cameras learned together",
        camera_shift="Table 7: gradient norm after a camera was shifted; which camera, and after how many samples",
        drift="online learning: a slow drift of the held part or of a lens, followed by gradients",
        few_samples="Table 5, Fig. 3: error against the number of training samples",
        grasp="Fig. 12: grasp a block with an inaccurate arm",
        insertion="Fig. 13: insert a peg with 1 mm clearance with an inaccurate arm",
        kfold="Table 4: k-fold cross validation",
        noisy_control="Figs. 10, 11: learn from a noisy controller's actions, joint or Cartesian, and servo with it",
        noisy_states="Table 8: noisy readings of joints or poses, with and without a model of the noise",
        relearning="Figs. 4-7: relearn a camera, the structure, the base or the kinematics from few samples",
        servo="Figs. 8, 9: servo moves against classical IBVS with the true Jacobian, over its gains",
        single_camera="Table 6: inference from both images or one; learning from one camera",
        speed="Table 3: time of queries",
        stages="Tables 1, 2: before and after learning end to end; orders of the stages",
    ),
    "vosvs": _paper(
        "vosvs",
        "servoing, depth and grasping from object masks",
        clutter="Fig. 19: pick what is asked for out of a heap of objects that was poured onto a tray",
        collaboration="Fig. 20: a person shows where a thing is; find it, pick it up and place it in the bin",
        depth_log="Fig. 6: depth of the sugar box from the recorded log of one approach",
        learn="Table 1, Figs. 8, 9, 18: learn J+ of seven configurations from 0.001 H, by (11) and by Broyden's update",
        pick_place="Fig. 5: find, center, estimate depth, grasp, check and place in a bin",
        segmentations="Figs. 14-17: masks of the plate, drill, marker and padlock from which depth is estimated",
        step_response="Figs. 10-12: step responses of all configurations with learned J+",
        track="Fig. 13: a moving articulated object followed by the base and by the head gimbal",
        track_person="Fig. 13: a person who walks about, followed by an article of clothing with the head and the base",
        trial="Table 2: eight consecutive trials of three objects at three heights, servoing and depth",
    ),
}
