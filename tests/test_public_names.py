"""Names that users import: each stays where it is."""

import importlib
import operator
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

import dense_vs

NAMES = {
    "dense_vs": "Babbling BatchFlow BodyModel Camera DenseJacobian DenseVSError DepthApproach FeatureServo "
    "FlowEstimator FramePipeline GraspLoop HadamardBroyden JointLog MaskServo PointTracker Robot SelfBody ServoLoop "
    "VisualServo __version__ open_recording to_gray",
    "dense_vs.depth": "METHODS DepthEstimate DepthUnobservableError MaskDepth depth_from_areas depth_from_masks "
    "depth_from_regions mask_regions",
    "dense_vs.segmentation": "AnnotatedFolder Doubt FewShotOptions FewShotSegmenter MaskQuality MaskVerdict "
    "OnnxOptions OnnxSegmenter Segmenter assess_mask read_image read_images read_mask write_mask",
    "dense_vs.drivers": "Hold LeRobotRobot OpenCVCamera RosNode Watchdog",
    "dense_vs.generative": "FitReport GenerativeModel Observations",
    "dense_vs.live": "Learning LiveOptions LiveSession LiveSource PageGate Reachability sureness",
    "dense_vs.point_servo": "BodyTracker Checkpoint",
    "dense_vs.sims": "FRAME_SECONDS ROBOTS BatchServo DepthSensor DeviceFrame DomainRandomization Frame IdSegmenter "
    "SimCamera SimDepthCamera SimRobot SimWorld SurfacePoint",
    "dense_vs.robot": "DepthCamera",
}


@pytest.mark.parametrize("home", NAMES)
def test_names_are_where_users_import_them_from(home):
    module = importlib.import_module(home)
    missing = [name for name in NAMES[home].split() if not hasattr(module, name)]
    assert not missing


@pytest.mark.parametrize(
    "page", sorted((Path(__file__).parents[1] / "docs" / "api").glob("*.md")), ids=lambda page: page.stem
)
def test_rooms_of_the_api_reference_say_what_they_offer(page):
    """Sphinx lists what ``__all__`` names, or nothing at all of a room that only gathers names."""
    homes = re.findall(r"automodule:: (\S+)", page.read_text(encoding="utf-8"))
    for home in homes:
        module = importlib.import_module(home)
        by_module = any(other.startswith(f"{home}.") for other in homes)
        if hasattr(module, "__path__") and not by_module:
            assert module.__all__
            assert all(hasattr(module, name) for name in module.__all__)


def test_what_users_import_from_the_top_is_in_its_room_too():
    """So that the API reference has it."""
    for name in dense_vs.__all__:
        room = getattr(dense_vs, name).__module__.split(".")[1]
        assert hasattr(importlib.import_module(f"dense_vs.{room}"), name), f"{name} in {room}"


def test_the_version_is_that_of_the_installed_package():
    assert dense_vs.__version__ == metadata.version("dense-vs")


@pytest.mark.parametrize("home", ["dense_vs", "dense_vs.drivers", "dense_vs.live"])
def test_names_that_come_when_first_used(home):
    """A wrong one says so, and importing the room alone imports no array library."""
    module = importlib.import_module(home)
    assert set(module.__all__) <= set(dir(module))
    with pytest.raises(AttributeError, match=f"module '{home}' has no attribute 'nothing'"):
        operator.attrgetter("nothing")(module)
    code = f"import sys, {home}; assert 'numpy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
