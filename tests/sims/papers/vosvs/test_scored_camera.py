"""The camera that keeps the truth of its last image aside, and masks that take time."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.papers.vosvs.scored_camera import ScoredCamera
from dense_vs.sims.papers.vosvs.timed_segmenter import TimedSegmenter


def test_the_truth_of_a_view():
    """An object of 5 x 5 pixels: its outline at 2 m but for one side at 3 m, its middle at 1 m."""
    true = np.zeros((20, 30), bool)
    true[5:10, 5:10] = True
    depth = np.full((20, 30), 9.0)
    depth[5:10, 5:10], depth[5, 5:10], depth[6:9, 6:9], depth[7, 7] = 2.0, 3.0, 1.0, 0.5
    pose = np.eye(4)
    pose[2, 3] = 0.7
    world = SimpleNamespace(
        image=lambda camera: f"image of {camera}",
        time=4.0,
        true_mask=lambda camera, name: true if (camera, name) == ("grasp", "Mug") else None,
        depth=lambda _: depth,
        camera_pose=lambda _: pose,
    )
    camera = ScoredCamera(world, "Mug")
    assert camera.read() == ("image of grasp", 4.0)
    # The world goes on; the truth stays that of the image.
    world.true_mask, world.depth = lambda *_: ~true, lambda _: 0.0 * depth
    view = camera.true_view(np.roll(true, 5, axis=1))
    assert (view.outline, view.surface, view.top) == pytest.approx((37 / 16, (37 + 8 + 0.5) / 25, 0.5))
    assert (view.iou, view.camera_height) == (0.0, 0.7)
    assert camera.true_view(true).iou == 1.0
    assert camera.overlap(np.roll(true, 1, axis=1)) == pytest.approx(20 / 30)
    assert camera.overlap(None) == 0.0
    world.true_mask = lambda *_: np.zeros((20, 30), bool)
    camera.read()
    gone = camera.true_view(true)
    assert np.isnan([gone.outline, gone.surface, gone.top]).all()
    assert (gone.iou, gone.camera_height) == (0.0, 0.7)


@pytest.mark.parametrize(("seconds", "frames"), [(0.0, 0), (0.001, 1), (0.2, 6), (0.21, 7)])
def test_the_world_runs_on_while_a_mask_is_made(seconds, frames):
    events = []
    world = SimpleNamespace(wait=events.append)
    inner = SimpleNamespace(segment=lambda image: events.append(image) or "mask", reset=lambda: events.append("forgot"))
    segmenter = TimedSegmenter(world, inner, seconds)
    segmenter.reset()
    assert segmenter.segment("image") == "mask"
    assert events == ["forgot", "image", frames]  # the mask is of the image before the time passed


@pytest.mark.parametrize("seconds", [-0.1, 0.5, float("nan")])
def test_a_mask_that_takes_too_long(seconds):
    with pytest.raises(DenseVSError, match="seconds"):
        TimedSegmenter(None, None, seconds)
