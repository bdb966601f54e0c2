"""Flow, points, masks, the body, depth and grasping with good arguments."""

from typing import Any

import numpy as np
from target import H, N, Target, W, dq, flow, gray, mask, rgb


def image_targets() -> list[Target]:
    """Flow, points, masks and the body."""
    from dense_vs import BatchFlow, FlowEstimator, PointTracker, SelfBody
    from dense_vs.body import SelfMotionOptions
    from dense_vs.flow import to_gray
    from dense_vs.pipeline import scaled_size
    from dense_vs.segmentation import FewShotOptions, FewShotSegmenter, OnnxOptions, assess_mask
    from dense_vs.segmentation.segmenter import check_image

    def tracker(**options: Any) -> Any:
        return PointTracker(**options).points

    def track(self: Any, **images: Any) -> Any:
        return self.update(**images)

    def body(flow: Any, dq: Any, **options: Any) -> Any:
        with SelfBody(**options, device="cpu", threads=1, synchronous=True) as one:
            one.observe(flow, dq)
            return one.recognition(np.ones((H, W, 2, N), np.float32))

    targets = [
        Target("to_gray", to_gray, lambda: {"image": rgb()}),
        Target("check_image", check_image, lambda: {"image": rgb()}),
        Target("scaled_size", scaled_size, lambda: {"shape": (480, 640), "scale": 0.5}),
        Target("BatchFlow", lambda **o: BatchFlow(**o, device="cpu").update().numpy(),
               lambda: {"worlds": 1, "height": 32, "width": 32, "method": "farneback-warp", "threads": 1}, weight=0.3),
        Target("PointTracker", tracker,
               lambda: {"points": np.array([[12.0, 10.0], [14.0, 12.5]]), "gray": gray(),
                        "weights": np.ones((H, W), np.float32), "method": "aligned", "window": 9,
                        "min_correlation": 0.8, "max_jump": 2.5, "lost_after": 5}),
        Target("PointTracker.update", track,
               lambda: {"self": PointTracker(np.array([[12.0, 10.0]]), gray(), window=9), "flow": flow(),
                        "gray": gray(1)}, state=lambda one: one.points),
        Target("SelfBody", body,
               lambda: {"flow": flow(), "dq": dq(), "clusters": 3, "threshold": 0.2, "method": "motion", "height": H,
                        "width": W, "joints": N, "worlds": 1, "seed": 0, "min_jacobian": 6.0, "reading": "printed",
                        "max_lag": 90, "joint_scale": np.full(N, 0.01)}, weight=2.0),
        Target("SelfMotionOptions", lambda **o: SelfMotionOptions(**o).decay,
               lambda: {"decay": 0.9, "rest": 0.1, "still": 0.2, "due": 0.5, "unexplained": 0.1, "least_energy": 0.1,
                        "process_noise": 1e4, "measurement_noise": 0.1, "initial_variance": 1e4}),
        Target("assess_mask", assess_mask,
               lambda: {"mask": mask(), "previous": mask(), "hidden": ~mask(), "min_area": 16, "max_fraction": 0.9,
                        "min_largest_share": 0.75, "max_area_ratio": 4.0}, may_be_nan=True),
        Target("FewShotOptions", lambda **o: FewShotOptions(**o).size,
               lambda: {"size": 320, "samples": 100, "min_area": 12, "min_score": 0.5, "memory": 0.3, "seed": 0}),
        Target("FewShotSegmenter.fit", lambda images, masks: FewShotSegmenter(size=32).fit(images, masks),
               lambda: {"images": [rgb()[:2]], "masks": [mask()[:2]]}, weight=0.5),
        Target("OnnxOptions", lambda **o: OnnxOptions(**o).scale,
               lambda: {"layout": "nchw", "colors": "rgb", "size": (32, 32), "multiple": 8, "scale": 1 / 255,
                        "mean": (0.0, 0.0, 0.0), "std": (1.0, 1.0, 1.0)}),
    ]  # fmt: skip
    for method in ("lucas-kanade", "dis", "farneback"):
        targets += [
            Target(f"FlowEstimator({method})",
                   lambda previous_gray, gray, method=method: FlowEstimator(method, H, W)(previous_gray, gray),
                   lambda: {"previous_gray": gray(), "gray": gray(1)}),
        ]  # fmt: skip
    targets.append(
        Target(
            "FlowEstimator",
            lambda **o: FlowEstimator(**o).height,
            lambda: {"method": "dis", "height": H, "width": W, "threads": 1},
        )
    )
    return targets


def grasp_targets() -> list[Target]:
    """Depth and grasping."""
    from dense_vs.depth import depth_from_areas, depth_from_masks, depth_from_regions
    from dense_vs.depth.region_shape import mask_regions
    from dense_vs.grasp import GripperModel, RegraspPolicy, check_grasp, choose_wrist_angle, grasp_camera_position

    back = np.linspace(0.0, 0.3, 4)
    masks = np.zeros((4, H, W), np.uint8)
    for k, half in enumerate((9, 7, 6, 5)):
        masks[k, 12 - half : 12 + half, 16 - half : 16 + half] = 1
    pose = np.eye(4)
    pose[2, 3] = 0.3
    camera = np.array([[30.0, 0, 16], [0, 30.0, 12], [0, 0, 1]])
    model = {"opening": 0.1, "width": 0.02, "thickness": 0.01, "length": 0.05, "T_camera_hand": pose}
    return [
        Target("depth_from_areas", depth_from_areas,
               lambda: {"areas": np.array([400.0, 300.0, 200.0, 100.0]), "camera_z": back + 0.5, "keep_empty": False},
               may_be_nan=True),
        Target("depth_from_masks", lambda **o: depth_from_masks(**o).distance,
               lambda: {"masks": masks.copy(), "camera_back": back.copy(), "method": "vos-de"}),
        Target("depth_from_masks, robust", lambda **o: depth_from_masks(**o, method="robust").distance,
               lambda: {"masks": masks.copy(), "camera_back": back.copy()}, weight=0.3),
        Target("depth_from_regions", lambda **o: depth_from_regions(mask_regions(masks), **o).distance,
               lambda: {"camera_back": back.copy(), "image_size": (H, W), "method": "vos-de"}),
        Target("check_grasp", lambda **o: check_grasp(**o).outcome,
               lambda: {"area_grasp": 100.0, "area_raised": 80.0, "opening": 0.02, "behind": 0.5, "share": 0.5,
                        "min_area": 16.0, "closed": 0.0015, "others": [20.0, 30.0]}),
        Target("grasp_camera_position", grasp_camera_position, lambda: {"z_object": 0.4, "z_gripper": 0.2}),
        Target("RegraspPolicy", lambda **o: RegraspPolicy(**o).attempts_made,
               lambda: {"attempts": 3, "searches": 2, "step": 0.008, "max_deeper": 0.016}),
        Target("GripperModel", lambda **o: GripperModel(**o).finger_masks(np.zeros(1), camera, (H, W)),
               lambda: dict(model)),
        Target("GripperModel.finger_masks", lambda angles, intrinsics, shape: GripperModel(**model).finger_masks(
            angles, intrinsics, shape), lambda: {"angles": np.zeros(2), "intrinsics": camera, "shape": (H, W)}),
        Target("choose_wrist_angle", lambda **o: choose_wrist_angle(**o).angle,
               lambda: {"mask": mask(), "finger_masks": np.stack([mask(), ~mask()]), "angles": np.array([0.0, 1.0]),
                        "closing_masks": np.stack([mask(), mask()]), "rank": 0, "iou_tolerance": 1e-3,
                        "clearance_tolerance": 1.5}),
    ]  # fmt: skip
