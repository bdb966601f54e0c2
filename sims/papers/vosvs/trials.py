"""The consecutive mobile trials of VOS-VS section 7.4: eight trials of three objects at three heights, in one run.

The robot drives to where an object roughly is, looks, searches where it sees none, centres by H_base and approaches to
estimate the depth. It sees images and its own joints; scores come from the simulator afterwards.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dense_vs.depth.approach import Approach, ApproachEnd, DepthApproach
from dense_vs.depth.mask_fit import Method
from dense_vs.errors import DenseVSError
from dense_vs.grasp import grasp_camera_position
from dense_vs.mask_servo.loop import MaskServo, ServoEnd, ServoLook
from dense_vs.mask_servo.object_search import search_object
from dense_vs.segmentation import Segmenter
from dense_vs.sims.mobile_manipulator.adapters import ManipulatorCamera, ManipulatorRobot
from dense_vs.sims.mobile_manipulator.annotations import SUPPORTS
from dense_vs.sims.mobile_manipulator.postures import CAMERA_ABOVE_LIFT, FINGERTIP, Z_GRIPPER, above
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.vosvs.configurations import configuration
from dense_vs.sims.papers.vosvs.hand import fingers_in_view
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
CENTRED_PX = 25.0  # truth: largest offset of a centred object


@dataclass
class ObjectTrial:
    """What came of one object.

    Attributes:
        name, support: which object, and the height it rests at [m].
        servo: VS succeeded: found and centred, by the simulator's truth.
        depth: DE succeeded: the gripper could close on the object at (21).
        cause: of a failure, as far as the run and the truth tell; empty for none.
        looks: images until centred.
        approach: the depth estimate; None where there was none.
        depth_error: of the distance at the nearest view, relative to that of the object's outline; nan without one.
        surface_error: the same relative to the mean visible surface.
        margins: of (21) [m]: fingertips above the support, fingertips below the object's top.
        iou: of the masks with the true ones at the last look of the servo, and at the nearest view.
    """

    name: str
    support: float
    servo: bool = False
    depth: bool = False
    cause: str = ""
    looks: int = 0
    approach: Approach | None = None
    depth_error: float = float("nan")
    surface_error: float = float("nan")
    margins: tuple[float, float] = (float("nan"), float("nan"))
    iou: tuple[float, float] = (float("nan"), float("nan"))


def place_objects(world: MobileWorld, names: tuple[str, ...], rng: np.random.Generator) -> None:
    """Clear the room and put a trial's objects on the blue bin, the green bin and the ground."""
    world.store()
    for name, (x, y, z) in zip(names, PLACES, strict=True):
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
    method: Method = "robust",
    on_look: Callable | None = None,
    on_view: Callable | None = None,
) -> ObjectTrial:
    """Search, centre and estimate the depth of one object from the present place."""
    result = ObjectTrial(name, support)
    camera, robot = ManipulatorCamera(world, "grasp"), ManipulatorRobot(world)
    found = search_object(camera, robot, segmenter)
    result.looks = found.looks
    if not found.found:
        result.cause = f"not found in {found.looks} looks"
        return result
    one = configuration("base")
    overlaps: list[float] = []

    def score_look(look: ServoLook, image: np.ndarray, mask: np.ndarray) -> None:
        overlaps.append(_iou(mask, world.true_mask("grasp", name)))
        if on_look is not None:
            on_look(look, image, mask)

    servo = MaskServo(
        camera, robot, segmenter, joints=one.joints, pinv=pinv, target=one.target, gain=0.8, on_look=score_look
    )
    run = servo.run(20)
    result.looks += len(run.looks)
    true = world.true_mask("grasp", name)
    first_iou = overlaps[-1]
    offset = float(np.abs(true_centroid(world, "grasp", name) - one.target).max()) if true.any() else float("nan")
    result.servo = run.end is ServoEnd.CONVERGED and offset < CENTRED_PX
    if not result.servo:
        result.iou = (first_iou, float("nan"))
        where = f"{offset:.0f} px off by the truth" if np.isfinite(offset) else "the object is out of view"
        result.cause = f"servo {run.end.value}, {where}, mask IoU {first_iou:.2f}"
        return result
    views: list[tuple[float, float, float, float, float]] = []

    def score(number: int, image: np.ndarray, mask: np.ndarray) -> None:
        views.append(_true_depths(world, name, mask))
        if on_view is not None:
            on_view(number, image, mask)

    approach = DepthApproach(
        camera, robot, segmenter, joint="arm_lift", method=method, hidden=fingers_in_view(world), on_view=score
    ).run()
    result.approach = approach
    if approach.nearest < 0 or approach.z_object is None:
        result.iou = (first_iou, float("nan"))
        result.cause = f"depth: {approach.why}"
        return result
    outline, surface, top, iou, camera_height = views[approach.nearest]
    result.iou = (first_iou, iou)
    distance = float(approach.distance or 0.0)
    result.depth_error = (distance - outline) / outline
    result.surface_error = (distance - surface) / surface
    # The robot's own kinematics: the lift's position and the camera's height differ by a constant.
    stop = grasp_camera_position(approach.z_object, Z_GRIPPER) + CAMERA_ABOVE_LIFT
    tips = stop - Z_GRIPPER - FINGERTIP
    result.margins = (tips - support, camera_height - top - tips)
    result.depth = min(result.margins) > 0.0 and stop > camera_height - top
    if not result.depth:
        missed = "fingertips hit the support" if result.margins[0] <= 0 else "gripper closes above the object"
        result.cause = (
            f"depth error {100 * result.depth_error:+.1f} % ({1e3 * (distance - outline):+.0f} mm): {missed} by "
            f"{-1e3 * min(result.margins):.0f} mm; mask IoU {iou:.2f}"
        )
        if approach.end is not ApproachEnd.NEAR:
            result.cause += f"; approach ended: {approach.end.value}"
    return result


def _true_depths(world: MobileWorld, name: str, mask: np.ndarray) -> tuple[float, float, float, float, float]:
    """Depth of the object's outline, mean of its surface, least, IoU of the mask, and the camera's height [m]."""
    import cv2

    true = world.true_mask("grasp", name)
    depth = world.depth("grasp")
    height = float(world.camera_pose("grasp")[2, 3])
    if not true.any():
        return float("nan"), float("nan"), float("nan"), 0.0, height
    outline = true & ~cv2.erode(true.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    return float(depth[outline].mean()), float(depth[true].mean()), float(depth[true].min()), _iou(mask, true), height


def _iou(mask: np.ndarray | None, true: np.ndarray) -> float:
    if mask is None:
        return 0.0
    return float((mask & true).sum() / max(1, (mask | true).sum()))
