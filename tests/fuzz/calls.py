"""Public functions and classes with good arguments, of which the fuzz spoils one or two at a time."""

from typing import Any

import numpy as np
from calls_images import grasp_targets, image_targets
from calls_models import generative_targets, sims_targets
from calls_robot import robot_targets
from calls_rooms import learning_targets, live_targets
from calls_servo import loop_targets
from target import H, N, Target, W, dq, flow, mask


def estimator(**options: Any) -> Any:
    from dense_vs import DenseJacobian

    one = DenseJacobian(**{"height": H, "width": W, "joints": N, "device": "cpu", "threads": 1, **options})
    one.update(flow(), dq())
    return one


def _stored(estimator: Any) -> Any:
    return {name: array.copy() for name, array in estimator.filter.stored().items()} | {"updates": estimator.updates}


def _new_estimator(**options: Any) -> Any:
    from dense_vs import DenseJacobian

    estimator = DenseJacobian(**options, device="cpu")
    joints = estimator.options.joints
    flow = np.ones((estimator.options.height, estimator.options.width, 2), np.float32)
    if estimator.options.worlds == 1:
        estimator.update(flow, np.full(joints, 0.01))
    return estimator.to_numpy()


def _jacobian_options() -> dict[str, Any]:
    return {
        "height": H, "width": W, "joints": N, "worlds": 1, "order": 2, "covariance": "shared", "prediction": "model",
        "prediction_iterations": 2, "process_noise": 300.0, "drift_noise": 0.0, "measurement_noise": 0.01,
        "initial_variance": 1e4, "hessian_noise": 1000.0, "initial_hessian_variance": 1e4, "max_variance": 1e4,
        "joint_scale": np.full(N, 0.012), "rest": 0.0, "max_innovation": 1.0, "move_variance": False,
        "on_bad_flow": "error", "depth": True, "depth_noise": 0.01, "threads": 1,
    }  # fmt: skip


def jacobian_targets() -> list[Target]:
    """The estimator."""
    from dense_vs.jacobian import jacobian_error

    forms: list[dict[str, Any]] = [{}, {"order": 1}, {"covariance": "diagonal"}, {"covariance": "fixed"}]
    targets = [
        Target("DenseJacobian", _new_estimator, _jacobian_options, weight=2.0),
        Target(
            "jacobian_error",
            jacobian_error,
            lambda: {
                "estimated": np.ones((H, W, 2, N), np.float32),
                "true": np.ones((H, W, 2, N), np.float32),
                "robot_mask": mask(),
            },
            may_be_nan=True,
        ),
    ]
    for form in forms:
        name = "DenseJacobian" + "".join(f", {value}" for value in form.values())
        targets += [
            Target(
                f"{name}: update",
                lambda self, flow, dq: (self.update(flow, dq), self.to_numpy())[1],
                lambda form=form: {"self": estimator(**form), "flow": flow(), "dq": dq()},
                state=_stored,
            ),
            Target(
                f"{name}: at",
                lambda self, points: self.at(points),
                lambda form=form: {"self": estimator(**form), "points": np.array([[3.0, 4.0], [5.5, 6.5]])},
            ),
            Target(
                f"{name}: predicted_flow",
                lambda self, dq: self.predicted_flow(dq),
                lambda form=form: {"self": estimator(**form), "dq": dq()},
            ),
        ]
    depth = np.full((H, W), 0.9)
    targets += [
        Target(
            "DenseJacobian, depth: update",
            lambda self, flow, dq, depth: (self.update(flow, dq, depth=depth), self.depth)[1],
            lambda: {"self": estimator(depth=True), "flow": flow(), "dq": dq(), "depth": depth.copy()},
            state=_stored,
            may_be_nan=True,
        ),
        Target(
            "DenseJacobian, depth: at",
            lambda self, points, depth: self.at(points, depth=depth),
            lambda: {"self": estimator(depth=True), "points": np.array([[3.0, 4.0], [5.5, 6.5]]), "depth": True},
        ),
    ]
    return targets


def servo_targets() -> list[Target]:
    """Laws, groups of joints, logs and babbling."""
    from dense_vs import Babbling, FeatureServo, HadamardBroyden, JointLog, VisualServo
    from dense_vs.health import Fault, FaultKind
    from dense_vs.mask_servo import FeaturewiseBroyden
    from dense_vs.mask_servo.object_search import search_offsets
    from dense_vs.mask_servo.trust_region import TrustRegion
    from dense_vs.robot import JointGroup
    from dense_vs.robot.joint_group import checked_limits

    pinv, one_each = np.array([[0.1, 0.0], [0.0, 0.1], [0.1, 0.0]]), np.array([[1, 0], [0, 1], [1, 0]])
    limits = np.array([[-1.0, 1.0]] * N)
    log = {"names": ("a", "b"), "times": np.arange(5.0), "positions": np.ones((5, 2))}

    def broyden() -> Any:
        return HadamardBroyden(pinv, one_each)

    def babble(flow: Any = None, **options: Any) -> Any:
        one = Babbling(**options)
        return [one.step(flow) for _ in range(3)]

    return [
        Target("Babbling", babble, lambda: {"joints": N, "seed": 0, "amplitude": 0.15, "wide_amplitude": 0.3,
                                            "time_constant": 0.4, "max_flow": 4.0, "frame_time": 1 / 30,
                                            "flow": flow()}),
        Target("VisualServo", lambda **o: VisualServo(**o).joint_limits,
               lambda: {"joints": N, "joint_limits": limits, "seed": 0, "gain": 0.2, "damping": 15.0,
                        "max_step": 0.03, "dither": 0.002}, may_be_nan=True),
        Target("VisualServo, call", lambda **o: VisualServo(N, joint_limits=limits)(**o),
               lambda: {"jacobian": np.ones((2, N)), "point": np.zeros(2), "target": np.full(2, 5.0),
                        "positions": np.zeros(N), "held": np.array([True, False, False])}),
        Target("JointLog", lambda **o: JointLog(**o).at(np.array([1.5])), lambda: dict(log)),
        Target("JointLog.at", lambda self, times: self.at(times),
               lambda: {"self": JointLog(**log), "times": np.array([0.5, 1.5])}),
        Target("JointLog.shifted", lambda self, seconds: self.shifted(seconds).times,
               lambda: {"self": JointLog(**log), "seconds": 1.0}),
        Target("JointLog.smoothed", lambda self, seconds: self.smoothed(seconds).positions,
               lambda: {"self": JointLog(**log), "seconds": 0.5}),
        Target("JointLog.select", lambda self, names: self.select(names).positions,
               lambda: {"self": JointLog(**log), "names": ["b"]}),
        Target("HadamardBroyden", lambda **o: HadamardBroyden(**o).pinv,
               lambda: {"pinv0": pinv, "coupling": one_each, "alpha": 0.1, "min_motion": 0.02, "min_cosine": 0.05}),
        Target("HadamardBroyden.update", lambda self, dq, de: self.update(dq, de).pinv,
               lambda: {"self": broyden(), "dq": dq(), "de": np.array([3.0, 4.0])}, state=lambda one: one.pinv),
        Target("HadamardBroyden.observe", lambda self, q, e: (self.observe(q, e), self.pinv)[1],
               lambda: {"self": broyden(), "q": dq(), "e": np.array([3.0, 4.0])}, state=lambda one: one.pinv),
        Target("FeaturewiseBroyden", lambda **o: FeaturewiseBroyden(**o).pinv,
               lambda: {"pinv0": pinv, "coupling": one_each, "alpha": 0.1, "min_motion": 0.02, "min_change": 4.0}),
        Target("FeaturewiseBroyden.observe", lambda self, q, e: (self.observe(q, e), self.pinv)[1],
               lambda: {"self": FeaturewiseBroyden(pinv, one_each), "q": dq(), "e": np.array([3.0, 4.0])}),
        Target("FeatureServo", lambda **o: FeatureServo(**o).target,
               lambda: {"target": np.array([10.0, 12.0]), "gain": 0.5, "max_step": np.full(N, 0.1),
                        "joint_limits": limits, "tolerance": 2.0, "patience": 3}),
        Target("FeatureServo.step", lambda self, pinv, features, positions: self.step(pinv, features, positions).dq,
               lambda: {"self": FeatureServo([10.0, 12.0], joint_limits=limits), "pinv": pinv,
                        "features": np.array([20.0, 9.0]), "positions": np.zeros(N)}),
        Target("TrustRegion", lambda **o: TrustRegion(**o).step,
               lambda: {"coupling": one_each, "tolerance": 5.0, "min_motion": 0.02, "max_step": 0.1,
                        "image_step": 60.0}),
        Target("search_offsets", search_offsets, lambda: {"reach": (0.2, 0.3), "rings": 1}),
        Target("checked_limits", checked_limits, lambda: {"limits": limits, "joints": N}, may_be_nan=True,
               kept=("joints",)),
        Target("JointGroup.choose", lambda **o: JointGroup.choose(**o).indices,
               lambda: {"names": ["a"], "available": ("a", "b"), "limits": limits[:2], "units": ("rad", "m")}),
        Target("JointGroup", lambda **o: JointGroup(**o).spread(np.zeros(2)),
               lambda: {"names": ("a", "b"), "indices": np.array([2, 0]), "limits": limits[:2],
                        "units": ("rad", "m"), "total": 3}),
        Target("Fault", lambda **o: str(Fault(**o)),
               lambda: {"kind": FaultKind.DARK, "text": "nothing is seen", "stops": True, "holds": False}),
    ]  # fmt: skip


GROUPS = {
    "jacobian": jacobian_targets,
    "servo": servo_targets,
    "loops": loop_targets,
    "robot": robot_targets,
    "image": image_targets,
    "grasp": grasp_targets,
    "generative": generative_targets,
    "sims": sims_targets,
    "live": live_targets,
    "learning": learning_targets,
}
