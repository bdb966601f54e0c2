"""The consecutive mobile trials of VOS-VS section 7.4: eight trials of three objects at three heights, in one run.

The robot drives to where an object roughly is, looks, searches where it sees none, centers by H_base and approaches to
estimate the depth. It sees images and its own joints; scores come from the simulator afterwards.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from dense_vs.depth import DepthUnobservableError, depth_from_areas
from dense_vs.depth.approach import Approach, ApproachEnd, DepthApproach
from dense_vs.depth.mask_fit import Method
from dense_vs.errors import DenseVSError
from dense_vs.mask_servo.loop import MaskServo, ServoLook, ServoRun
from dense_vs.mask_servo.object_search import search_object
from dense_vs.segmentation import Segmenter
from dense_vs.sims.mobile_manipulator.adapters import ManipulatorRobot
from dense_vs.sims.mobile_manipulator.annotations import SUPPORTS
from dense_vs.sims.mobile_manipulator.postures import above
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.vosvs.configurations import configuration
from dense_vs.sims.papers.vosvs.gripper_geometry import fingers_in_view
from dense_vs.sims.papers.vosvs.scored_camera import ScoredCamera
from dense_vs.sims.papers.vosvs.trial_scores import (
    DepthScore,
    ReachScore,
    ServoScore,
    TrueView,
    score_depth,
    score_servo,
)
from dense_vs.sims.papers.vosvs.true_jacobian import true_centroid

# Table 2: an object on the blue bin, one on the green bin, one on the ground.
TRIALS = (
    ("Power Drill", "Marker", "Padlock"),
    ("Wood Block", "Spring Clamp", "Screwdriver"),
    ("Chips Can", "Potted Meat", "Plastic Banana"),
    ("Box of Sugar", "Tuna", "Gelatin"),
    ("Mug", "Softscrub", "Skillet with Lid"),
    ("Plate", "Spatula", "Knife"),
    ("Baseball", "Plastic Chain", "Washer"),
    ("Stacking Cup", "Dice", "Foam Brick"),
)
PLACES = (SUPPORTS[2], SUPPORTS[1], SUPPORTS[0])
HEIGHT = 0.86  # m, of the grasp camera while it looks for objects
_NO_SERVO, _NO_DEPTH, _NO_REACH = ServoScore(False), DepthScore(False), ReachScore(False)


@dataclass
class ObjectTrial:
    """Result of one object.

    Attributes:
        name, support: which object, and the height it rests at [m].
        servo: VS, by the J+ that was learned feature by feature.
        printed_servo: VS from the same place by a J+ that was learned by VOS-VS (11) as printed; None if not asked for.
        depth: DE by the method asked for.
        printed_depth: DE by VOS-VS (20) from the same masks.
        reach, printed_reach: DE done, by the method and by VOS-VS (20); not closed where it was not tried.
        looks: images until centered.
        approach: the depth estimate; None where there was none.
        iou: of the masks with the true ones at the last look of the servo, and at the nearest view.
    """

    name: str
    support: float
    servo: ServoScore = _NO_SERVO
    printed_servo: ServoScore | None = None
    depth: DepthScore = _NO_DEPTH
    printed_depth: DepthScore = _NO_DEPTH
    reach: ReachScore = _NO_REACH
    printed_reach: ReachScore = _NO_REACH
    looks: int = 0
    approach: Approach | None = None
    iou: tuple[float, float] = (float("nan"), float("nan"))

    @property
    def cause(self) -> str:
        """Of a failure, as far as the run and the truth tell; empty for none."""
        if not self.servo.centered:
            return self.servo.cause
        done = f"done: {self.reach.cause}" if self.reach.cause else ""
        return "; ".join(cause for cause in (self.depth.cause, done) if cause)


def place_objects(
    world: MobileWorld, names: tuple[str, ...], rng: np.random.Generator, only: Collection[str] | None = None
) -> None:
    """Clear the room and put a trial's objects, or only some, on the blue bin, the green bin and the ground."""
    world.store()
    for name, (x, y, z) in zip(names, PLACES, strict=True):
        if only is not None and name not in only:
            continue
        place = (x + rng.uniform(-0.06, 0.06), y + rng.uniform(-0.06, 0.06), z)
        if world.objects[name].links:
            _heap_chain(world, name, (x, y, z), rng)
        else:
            world.place(name, place, rng.uniform(-np.pi, np.pi))


def _heap_chain(
    world: MobileWorld, name: str, place: tuple[float, float, float], rng: np.random.Generator, tries: int = 100
) -> None:
    """Lay a chain so that all of it rests on its support: it has one depth then, as the other objects have.

    Raises:
        DenseVSError: no such heap found.
    """
    for _ in range(tries):
        world.lay_chain(name, place, rng)
        if world.lowest_point(name) > place[2] - 0.005:
            return
    raise DenseVSError(f"{name!r} hung over the edge of its support in {tries} tries; expected a wider support")


def drive_to(robot: ManipulatorRobot, place: tuple[float, float, float], rng: np.random.Generator) -> None:
    """Bring the camera above a support, about, by the robot's odometry."""
    x, y = np.array(place[:2]) + rng.uniform(-0.12, 0.12, 2)
    robot.command(above(x, y, HEIGHT) - robot.joints()[0])


def locate(
    world: MobileWorld,
    name: str,
    support: float,
    segmenter: Segmenter,
    pinv: np.ndarray,
    *,
    printed_pinv: np.ndarray | None = None,
    method: Method = "robust",
    settle_frames: int = 6,
    on_look: Callable | None = None,
    on_view: Callable | None = None,
) -> ObjectTrial:
    """Search, center and estimate the depth of one object from the present place.

    An image is taken ``settle_frames`` after a command has ended. With ``printed_pinv``, a J+ that was learned by
    VOS-VS (11) as printed, the object is first centered by that; then the robot drives back, by its odometry, and
    begins anew.
    """
    result = ObjectTrial(name, support)
    camera, robot = ScoredCamera(world, name), ManipulatorRobot(world, settle_frames)
    found = search_object(camera, robot, segmenter)
    result.looks = found.looks
    if not found.found:
        result.servo = ServoScore(False, f"not found in {found.looks} looks")
        result.printed_servo = None if printed_pinv is None else result.servo
        return result
    if printed_pinv is not None:
        start = robot.joints()[0]
        result.printed_servo = _center(camera, robot, segmenter, printed_pinv)[0]
        robot.command(start - robot.joints()[0])
    result.servo, run, iou = _center(camera, robot, segmenter, pinv, on_look)
    result.looks += len(run.looks)
    result.iou = (iou, float("nan"))
    if result.servo.centered:
        _estimate_depth(camera, robot, result, segmenter, method, on_view)
    return result


def _center(
    camera: ScoredCamera,
    robot: ManipulatorRobot,
    segmenter: Segmenter,
    pinv: np.ndarray,
    on_look: Callable | None = None,
) -> tuple[ServoScore, ServoRun, float]:
    """Center the object by H_base; how it went, the run, and the last mask's IoU with the true one."""
    one = configuration("base")
    overlap = float("nan")

    def score_look(look: ServoLook, image: np.ndarray, mask: np.ndarray) -> None:
        nonlocal overlap
        overlap = camera.overlap(mask)
        if on_look is not None:
            on_look(look, image, mask)

    run = MaskServo(
        camera,
        robot,
        segmenter,
        joints=one.joints,
        pinv=pinv,
        target=one.target,
        gain=0.8,
        on_look=score_look,
    ).run(20)
    offset = float(np.abs(true_centroid(camera.world, "grasp", camera.object) - one.target).max())
    return score_servo(run.end, offset, overlap), run, overlap


def _estimate_depth(
    camera: ScoredCamera,
    robot: ManipulatorRobot,
    result: ObjectTrial,
    segmenter: Segmenter,
    method: Method,
    on_view: Callable | None,
) -> None:
    """Approach the centered object; score the depth by the method, and by VOS-VS (20) from the same masks."""
    views: list[TrueView] = []

    def score_view(number: int, image: np.ndarray, mask: np.ndarray) -> None:
        views.append(camera.true_view(mask))
        if on_view is not None:
            on_view(number, image, mask)

    approach = DepthApproach(
        camera,
        robot,
        segmenter,
        joint="arm_lift",
        method=method,
        hidden=fingers_in_view(camera.world),
        on_view=score_view,
    ).run()
    result.approach = approach
    if approach.nearest < 0:
        result.depth = result.printed_depth = DepthScore(False, cause=f"depth: {approach.why}")
        return
    true, camera_z = views[approach.nearest], float(approach.camera_z[approach.nearest])
    result.iou = (result.iou[0], true.iou)
    result.printed_depth = printed_depth_score(approach, true, result.support)
    if approach.z_object is None:
        result.depth = DepthScore(False, cause=f"depth: {approach.why}")
        return
    score = score_depth(approach.z_object, camera_z, true, result.support)
    if not score.graspable and approach.end is not ApproachEnd.NEAR:
        score = replace(score, cause=f"{score.cause}; approach ended: {approach.end.value}")
    result.depth = score


def printed_depth_score(approach: Approach, true: TrueView, support: float) -> DepthScore:
    """DE by VOS-VS (20) as printed, from the areas of an approach's masks of the whole object.

    Args:
        approach: with at least one such view.
        true: what the simulator knows of the nearest of them.
        support: height of what the object rests on [m].
    """
    try:
        z_object = printed_depth(approach)
    except DepthUnobservableError as error:
        return DepthScore(False, cause=f"depth: {error}")
    return score_depth(z_object, float(approach.camera_z[approach.nearest]), true, support)


def printed_depth(approach: Approach) -> float:
    """z_object [m] by VOS-VS (20) as printed, from the areas of an approach's masks of the whole object.

    Raises:
        DepthUnobservableError: the areas do not tell it.
    """
    return depth_from_areas(approach.areas[approach.whole], approach.camera_z[approach.whole]).z_object
