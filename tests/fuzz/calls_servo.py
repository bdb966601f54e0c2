"""Loops over a camera and a robot with good arguments: servoing on a mask, searching, approaching, grasping."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from target import H, Target, W

FOCAL, GRIP = 24.0, 0.17
CENTER = ((W - 1) / 2, (H - 1) / 2)


class Room:
    """Camera, robot, segmenter and gripper: a box on the floor seen from above, by a camera with unlimited joints."""

    joint_names, joint_limits = ("forward", "right", "lift", "wrist"), None

    def __init__(self, height: float = 0.31):
        self.q, self.time = np.array([0.0, 0.0, height, 0.0]), 0.0

    def read(self) -> tuple[np.ndarray, float]:
        image = np.zeros((H, W, 3), np.uint8)
        scale = FOCAL / max(self.q[2] - 0.1, 1e-2)
        y, x = np.mgrid[:H, :W]
        place = np.array(CENTER) + scale * (np.array([0.01, 0.005]) - self.q[:2])
        image[np.maximum(np.abs(x - place[0]), np.abs(y - place[1])) < 0.05 * scale] = 255
        return image, self.time

    def segment(self, image: np.ndarray) -> np.ndarray:
        return image[..., 0] > 0

    def joints(self) -> tuple[np.ndarray, float]:
        return self.q.copy(), self.time

    def command(self, delta: np.ndarray) -> None:
        assert np.isfinite(delta).all()
        assert np.abs(delta).max() < 1e3
        self.time += 0.1
        self.q = self.q + delta

    def open(self) -> Any:
        return SimpleNamespace(opening=0.13, jammed=False)

    def close(self) -> Any:
        return SimpleNamespace(opening=0.04, jammed=False)


def loop_targets() -> list[Target]:
    """The loops and what they are made of."""
    from dense_vs import GraspLoop, HadamardBroyden, MaskServo
    from dense_vs.depth import DepthApproach
    from dense_vs.grasp import GripperModel, HandGeometry, RegraspPolicy
    from dense_vs.mask_servo import search_object

    base = ["forward", "right"]
    pinv = np.diag([-0.2 / FOCAL, -0.2 / FOCAL])
    pose = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, GRIP], [0, 0, 0, 1]], dtype=float)
    model = GripperModel(opening=0.13, width=0.02, thickness=0.01, length=0.03, T_camera_hand=pose)
    geometry = {"z_gripper": GRIP, "target": CENTER, "center": CENTER, "model": model, "bite": 0.0,
                "intrinsics": np.array([[FOCAL, 0, CENTER[0]], [0, FOCAL, CENTER[1]], [0, 0, 1]])}  # fmt: skip
    grasp = {"hand": HandGeometry(**geometry), "lift": "lift", "wrist": "wrist", "base": base, "pinv": pinv}

    def grasping(room: Room, **options: Any) -> Any:
        return GraspLoop(room, room, room, room, **options)

    def servo(room: Room, **options: Any) -> Any:
        return MaskServo(room, room, room, **{"joints": base, "pinv": pinv, "target": CENTER, **options})

    return [
        Target("HandGeometry", lambda **o: HandGeometry(**o).target_at(0.3), lambda: dict(geometry), weight=2.0),
        Target("HandGeometry.target_at", lambda **o: HandGeometry(**geometry).target_at(**o),
               lambda: {"distance": 0.3}),
        Target("HandGeometry.holds", lambda **o: HandGeometry(**geometry).holds(**o),
               lambda: {"mask": np.ones((H, W), bool)}),
        Target("HandGeometry in a grasp",
               lambda **o: grasping(Room(), **{**grasp, "hand": HandGeometry(**o)}).run(0.1).held,
               lambda: dict(geometry), weight=0.5),
        Target("GraspLoop", lambda **o: grasping(Room(), **o).run(0.1).held,
               lambda: {**grasp, "policy": RegraspPolicy(attempts=2), "raise_by": 0.15, "contact_lag": 0.001,
                        "max_step": 1.0, "others": (Room(),), "aside": np.array([0.05, 0.3])}, weight=3.0),
        Target("GraspLoop.run", lambda self, z_object: self.run(z_object).held,
               lambda: {"self": grasping(Room(), **grasp), "z_object": 0.1},
               state=lambda one: [one.robot.q, one.policy.attempts_made]),
        Target("MaskServo", lambda room, **o: servo(room, **o).run(6).end,
               lambda: {"room": Room(), "joints": base, "pinv": pinv, "target": CENTER, "gain": 0.8, "max_step": 0.1,
                        "max_image_step": 10.0, "tolerance": 0.5, "patience": 2, "stalled": 3}, kept=("room",),
               weight=3.0),
        Target("MaskServo, learning", lambda room, **o: servo(room, **o).run(6).end,
               lambda: {"room": Room(), "joints": base, "pinv": HadamardBroyden(pinv, np.eye(2)), "target": CENTER,
                        "max_step": 0.1, "max_image_step": 10.0}, kept=("room",)),
        Target("MaskServo.run", lambda self, max_looks: self.run(max_looks).end,
               lambda: {"self": servo(Room()), "max_looks": 4}, state=lambda one: one.robot.q),
        Target("search_object", lambda room, **o: search_object(room, room, room, **o).looks,
               lambda: {"room": Room(), "joints": base, "reach": (0.2, 0.2), "rings": 1, "min_area": 999},
               kept=("room",), weight=2.0),
        Target("DepthApproach", lambda room, **o: DepthApproach(room, room, room, **o).run().end,
               lambda: {"room": Room(0.9), "joint": "lift", "method": "robust", "near": 0.3, "steps": (0.02, 0.1),
                        "views": 6, "hidden": np.zeros((H, W), bool)},
               kept=("room",), weight=2.0),
    ]  # fmt: skip
