"""Names that users import: each stays where it is."""

import importlib

import pytest

NAMES = {
    "dense_vs": "Babbling BatchFlow Camera DenseJacobian DenseVSError DepthApproach FeatureServo FlowEstimator "
    "FramePipeline GraspLoop HadamardBroyden JointLog MaskServo PointTracker Robot SelfBody ServoLoop VisualServo",
    "dense_vs.depth": "METHODS DepthEstimate DepthUnobservableError MaskDepth depth_from_areas depth_from_masks "
    "depth_from_regions mask_regions",
    "dense_vs.segmentation": "AnnotatedFolder FewShotOptions FewShotSegmenter MaskQuality MaskVerdict OnnxOptions "
    "OnnxSegmenter Segmenter assess_mask read_image read_images read_mask write_mask",
    "dense_vs.generative": "GenerativeModel Observations",
    "dense_vs.sims": "FRAME_SECONDS ROBOTS BatchServo DeviceFrame DomainRandomization Frame IdSegmenter SimCamera "
    "SimRobot SimWorld SurfacePoint",
}


@pytest.mark.parametrize("home", NAMES)
def test_names_are_where_users_import_them_from(home):
    module = importlib.import_module(home)
    missing = [name for name in NAMES[home].split() if not hasattr(module, name)]
    assert not missing
