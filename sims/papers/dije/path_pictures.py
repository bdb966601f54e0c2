"""Fig. 6 of DIJE: camera images with the path of the point, and J at the end, estimated and true."""

import cv2
import numpy as np

from dense_vs.sims.papers.dije.servo_record import ServoTask, TaskRun
from dense_vs.view.panels import RED, draw_point, label, tile, vectors_to_rgb

_SCALE = 2  # of the camera images


def path_images(run: TaskRun) -> np.ndarray:
    """The camera at the end of each reach, with the path of the point, as Fig. 6."""
    panels = []
    for number, reach in enumerate(run.reaches):
        image = cv2.resize(reach.image, None, fx=_SCALE, fy=_SCALE, interpolation=cv2.INTER_LINEAR)
        first, last = reach.path
        points = np.array(run.trace.points[first : last + 1]) * _SCALE + 0.5 * (_SCALE - 1)
        path = np.rint(points[np.isfinite(points).all(axis=1)]).astype(np.int32)[:, None]
        cv2.polylines(image, [path], False, (0, 0, 0), 4, cv2.LINE_AA)
        cv2.polylines(image, [path], False, RED, 2, cv2.LINE_AA)
        draw_point(image, np.array(reach.target) * _SCALE + 0.5, "target")
        draw_point(image, points[-1], "point")
        text = f"{number + 1}: {reach.point}, {reach.frames / 30:.1f} s, true error {reach.true_error_px:.2f} px"
        panels.append(label(image, text + ", lost" * reach.lost))
    return tile(panels, columns=min(2, len(panels)))


def jacobian_columns(task: ServoTask, run: TaskRun) -> np.ndarray:
    """Columns of J at the end: estimated above, true below."""
    assert run.estimated is not None
    assert run.true is not None
    assert run.mask is not None
    panels = []
    for name, jacobian in (("estimated", run.estimated), ("true", run.true)):
        for n, joint in enumerate(task.joints):
            scale = max(float(np.percentile(np.linalg.norm(run.true[run.mask][..., n], axis=1), 99)), 1.0)
            panels.append(label(vectors_to_rgb(jacobian[..., n], scale), f"{name}: {joint}"))
    return tile(panels, columns=len(task.joints))
