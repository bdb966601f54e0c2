"""J+ of one configuration from step responses, VOS-VS section 7.3: servo, update, begin again when lost."""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from dense_vs.mask_servo.featurewise_broyden import FeaturewiseBroyden
from dense_vs.mask_servo.hadamard_broyden import HadamardBroyden
from dense_vs.mask_servo.loop import MaskServo, ServoEnd, ServoLook
from dense_vs.segmentation import Segmenter
from dense_vs.segmentation.segmenter import forget_images
from dense_vs.sims.mobile_manipulator.adapters import ManipulatorCamera, ManipulatorRobot
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.vosvs.configurations import Configuration
from dense_vs.sims.papers.vosvs.object_placement import put_in_view, start_posture
from dense_vs.sims.papers.vosvs.true_jacobian import true_pinv

INITIAL = 0.001  # of J+ wherever H is 1
ALPHA = 0.1
MIN_MOTION = 0.008  # m or rad, sum of |dq| to learn from; the authors' 0.02 moves a near object 50 px
MAX_STEP = 0.3  # m or rad a command


class Update(StrEnum):
    """How J+ is learned; the text is how tables call it."""

    PRINTED = "(11) as printed"
    GUARDED = "(11), denominator guarded"
    FEATUREWISE = "(11) a feature at a time"
    ORIGINAL = "original Broyden"


@dataclass
class Episode:
    """One step response: an object put somewhere, and what the servo did about it.

    Attributes:
        end: how it ended.
        centroids: ``(T, 2)`` of the masks [px].
        images: the first, some, and the last image, where asked for.
    """

    end: ServoEnd
    centroids: np.ndarray
    looks: list[ServoLook]
    images: list[np.ndarray] = field(default_factory=list)
    masks: list[np.ndarray] = field(default_factory=list)


@dataclass
class Learning:
    """Result of learning one configuration.

    Attributes:
        converged: whether a step response ended at the target.
        updates: changes of J+ until it first did; None if it never did.
        looks: images until then; all of them if it never did.
        restarts: how often the object went out of view or a joint limit was reached, and the robot was put back.
        retreats: steps that the robot took back itself.
        pinv: the last J+.
        history: J+ after every update, ``(U, n, 2)``.
        episodes: all step responses.
        true: J+ by the simulator where each converged, ``(R, n, 2)``: objects stand near and far. For scores.
    """

    converged: bool
    updates: int | None
    looks: int
    restarts: int
    retreats: int
    pinv: np.ndarray
    history: np.ndarray
    episodes: list[Episode]
    true: list[np.ndarray] = field(default_factory=list)


def learn_configuration(
    world: MobileWorld,
    one: Configuration,
    name: str,
    segmenter: Segmenter,
    rng: np.random.Generator,
    *,
    update: Update = Update.GUARDED,
    responses: int = 5,
    looks: int = 150,
    keep_images: bool = False,
) -> Learning:
    """Learn J+ from 0.001 H.

    Args:
        update: VOS-VS (11) as printed, with its denominator held away from zero, or a feature at a time; or Broyden's.
            The robot moves alike for all, within a trust region, which is beyond the paper.
        responses: step responses in all once the first has converged: the object is put elsewhere for each.
        looks: images in all.
        keep_images: keep those of the first response, for Fig. 18.
    """
    learner = _learner(one, update)
    history = [learner.pinv]
    camera, robot = ManipulatorCamera(world, one.camera), ManipulatorRobot(world)
    result = Learning(False, None, 0, 0, 0, learner.pinv, learner.pinv[None], [])
    world.set_posture(start_posture(one))
    put_in_view(world, one, name, rng)
    shown: list[tuple[np.ndarray, np.ndarray]] = []

    def show(_: ServoLook, image: np.ndarray, mask: np.ndarray) -> None:
        if keep_images and not result.converged:
            shown.append((image, mask))

    servo = MaskServo(
        camera,
        robot,
        segmenter,
        joints=one.joints,
        pinv=learner,
        target=one.target,
        max_step=MAX_STEP,
        tolerance=8.0,
        on_look=show,
    )
    left, reached = looks, 0
    while left > 0 and reached < responses:
        forget_images(segmenter)
        shown.clear()
        run = servo.run(left)
        left -= len(run.looks)
        for look in run.looks:
            if not np.array_equal(look.pinv, history[-1]):
                history.append(look.pinv)
        centroids = np.array([look.centroid for look in run.looks])
        result.episodes.append(Episode(run.end, centroids, run.looks, [i for i, _ in shown], [m for _, m in shown]))
        if run.end is ServoEnd.CONVERGED:
            reached += 1
            result.true.append(true_pinv(world, one, name))
            if result.updates is None:
                result.converged = True
                result.updates = len(history) - 1
                result.looks = looks - left
            if reached < responses and left > 0:
                world.set_posture(start_posture(one))
                put_in_view(world, one, name, rng)
        else:
            result.restarts += run.end is not ServoEnd.EXHAUSTED
            world.set_posture(start_posture(one))
            moved = any(np.any(look.joints != run.looks[0].joints) for look in run.looks)
            if not moved or run.end is ServoEnd.AT_LIMIT:  # nothing to learn from where the object stands
                put_in_view(world, one, name, rng)
    if not result.converged:
        result.looks = looks - left
    assert servo.region is not None
    result.retreats = servo.region.retreats
    result.pinv = learner.pinv
    result.history = np.stack(history)
    return result


def _learner(one: Configuration, update: Update) -> HadamardBroyden | FeaturewiseBroyden:
    if update is Update.FEATUREWISE:
        return FeaturewiseBroyden(INITIAL * one.coupling, one.coupling, ALPHA)
    coupling = None if update is Update.ORIGINAL else one.coupling
    least = {"min_cosine": 0.0} if update is Update.PRINTED else {}
    return HadamardBroyden(INITIAL * one.coupling, coupling, ALPHA, min_motion=MIN_MOTION, **least)
