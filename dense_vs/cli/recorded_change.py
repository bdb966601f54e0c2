"""What has changed between a saved body and a recording of the same robot, before anything is estimated from it."""

from itertools import islice

import cv2
import numpy as np

from dense_vs.body_model import BodyChange, BodyModel, find_change
from dense_vs.body_model.find_change import IMAGES
from dense_vs.body_model.spread import spread
from dense_vs.checks import check_kind
from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import to_gray
from dense_vs.recording import Episode

FIRST = 300  # images of an episode, of which some are looked at


def find_recorded_change(body: BodyModel, episode: Episode) -> BodyChange:
    """What has changed since a body was learned, by the first images of an episode; see :func:`.find_change`.

    Args:
        body: of the same joints, in images of the same shape at any scale.
        episode: images and joints on one clock.

    Raises:
        DenseVSError: no body, another number of joints, images of another shape, or no image within the log.
    """
    body = check_kind("body", body, BodyModel)
    height, width = body.size
    seen = [(to_gray(frame.image), frame.joints) for frame in islice(episode, FIRST)]
    if not seen:
        raise DenseVSError(f"episode {episode.number} of {episode.source.path} has no image within its joint log")
    some = [seen[k] for k in spread(len(seen), IMAGES)]
    has = some[0][0].shape
    if abs(has[1] / width * height - has[0]) > 1:
        raise DenseVSError(f"images are of {has[1]} x {has[0]} px; expected {width} x {height}, or another scale of it")
    images = [cv2.resize(gray, (width, height), interpolation=cv2.INTER_AREA) for gray, _ in some]
    return find_change(body, images, np.array([q for _, q in some]))
