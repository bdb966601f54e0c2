"""Fig. 2: every stage from the camera image to the labels of the robot's own body, as one picture.

Camera image, optical flow, a column of J a joint, the clusters of Algorithm 1 and the labels of Algorithm 2; below
them, beyond the paper, the share of the motion that the joints leave unexplained, and our default's labels with
what is unknown.
"""

import argparse
from typing import TYPE_CHECKING

import numpy as np

from dense_vs.sims.papers.dije.labeling_arguments import add_labeling_arguments, check_labeling_arguments
from dense_vs.sims.papers.rows import Row

if TYPE_CHECKING:
    from dense_vs.sims.papers.dije.labeling import Labeler, View

FLOW_SCALE = 4.0  # px at full brightness


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    add_labeling_arguments(parser, seconds=12.0)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    from dense_vs.sims.engine.scene import FRAME_SECONDS
    from dense_vs.sims.papers.dije.label_pictures import write_image
    from dense_vs.sims.papers.dije.labeling import make_labelers, views
    from dense_vs.view.progress import progress

    check_labeling_arguments(arguments, 5.0)
    iou: dict[str, list[float]] = {"default": [], "paper": []}
    with progress("seed", len(arguments.seeds) * round(arguments.seconds / FRAME_SECONDS)) as bar:
        for seed in arguments.seeds:
            bar.set_description(f"seed {seed}")
            labelers = make_labelers(seed, arguments.device, arguments.threads)
            picture, best = None, -1.0
            for view in views(seed, arguments):
                for labeler in labelers.values():
                    labeler.take(view)
                # The picture is of a frame, late in the run, with much to see: robot and walker both moving.
                shown = min(_motion(view, view.robot), _motion(view, view.walker) if view.walker.any() else np.inf)
                late = view.time > 0.6 * arguments.seconds and view.index % 5 == 0
                if late and shown > best:
                    best, picture = shown, draw_stages(view, labelers)
                    for labeler in labelers.values():
                        labeler.score(view)
                bar.update()
            assert picture is not None
            write_image(arguments.out / f"seed{seed}.png", picture)
            for name, labeler in labelers.items():
                iou[name].append(labeler.iou[-1])
    seeds = tuple(arguments.seeds)
    return [
        Row("clusters of the k-means", 5, labelers["paper"].body.clusters_wanted, "", seeds),
        Row("threshold of a cluster's value", 0.2, labelers["paper"].body.threshold, "", seeds),
        Row("IoU of the labels in the picture, paper's algorithms", None, float(np.mean(iou["paper"])), "", seeds),
        Row("IoU of the labels in the picture, default", None, float(np.mean(iou["default"])), "", seeds),
    ]


def draw_stages(view: "View", labelers: "dict[str, Labeler]") -> np.ndarray:
    """The picture, RGB uint8: the paper's stages in two rows, ours in the third."""
    from dense_vs.sims.papers.dije.label_pictures import (
        clusters_image,
        overlay,
        share_image,
        states_image,
    )
    from dense_vs.sims.papers.dije.labeling import JOINTS
    from dense_vs.view.panels import JacobianView, label, tile

    paper, ours = labelers["paper"], labelers["default"]
    drawn = JacobianView(JOINTS, FLOW_SCALE)
    J = paper.estimator.to_numpy()
    for _ in range(25):  # the brightness follows the content slowly, as for a video
        columns = drawn.columns(J)
    own = paper.labels()
    panels = [
        label(view.rgb, f"camera image, {view.time:.1f} s"),
        drawn.flow(view.flow, "optical flow u"),
        *columns,
        clusters_image(paper.body.clusters(J), own, "clusters (red: own)"),
        overlay(view.rgb, own, view.robot, view.walker, "labels of Algorithm 2"),
        share_image(ours.body.unexplained(), "unexplained share (white: none), default"),
        states_image(ours.body.recognition(ours.estimator.jacobian), "red own, gray not, black unknown"),
        clusters_image(ours.body.clusters(ours.estimator.jacobian), ours.labels(), "clusters of the body, default"),
        overlay(view.rgb, ours.labels(), view.robot, view.walker, "labels, default"),
    ]
    return tile(panels, columns=4)


def _motion(view: "View", mask: np.ndarray) -> float:
    """How much there is to see of it: mean flow over a mask [px], and more of a large one than of a small one."""
    return float(np.linalg.norm(view.flow[mask], axis=1).mean() * np.sqrt(mask.mean())) if mask.any() else 0.0
