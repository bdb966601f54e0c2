"""Every configuration is asked for its own objects, and a response's error is that of the object when its run ends."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.mask_servo.loop import ServoEnd, ServoRun
from dense_vs.sims.papers.vosvs import step_response
from dense_vs.sims.papers.vosvs.configurations import CONFIGURATIONS

BAR = SimpleNamespace(update=lambda: None, set_description=lambda _: None)


@pytest.fixture
def responses(monkeypatch):
    """What :func:`respond_all` makes of a world in which the k-th servo ends with its object k px beside its target."""
    events, ran = [], []

    class Servo:
        def __init__(self, camera, robot, segmenter, *, joints, pinv, target, max_step):
            self.told = camera, robot, segmenter, joints, pinv, target, max_step

        def run(self, looks):
            ran.append((*self.told, looks))
            return ServoRun(ServoEnd.CONVERGED, [None] * len(ran))

    class World:
        def store(self):
            events.append("stored")

        def set_posture(self, posture):
            events.append(("posture", posture))

        def image(self, camera):
            return f"image of {camera}, {len(ran)}"

    class Setup:
        def __init__(self, names, seed, threads):
            events.append(("learned", tuple(names), seed, threads))
            self.world = World()

        def pinv(self, name):
            return f"J+ of {name}"

        def segmenter(self, name):
            return f"masks of {name}"

    def centroid(world, camera, name):
        one = next(c for c in CONFIGURATIONS if c.target == ran[-1][5] and c.camera == camera)
        return np.add(one.target, (len(ran), -0.5))

    monkeypatch.setattr(step_response, "LearnedSetup", Setup)
    monkeypatch.setattr(step_response, "MaskServo", Servo)
    monkeypatch.setattr(step_response, "ManipulatorCamera", lambda world, camera: camera)
    monkeypatch.setattr(step_response, "ManipulatorRobot", lambda world: "robot")
    monkeypatch.setattr(step_response, "forget_images", lambda one: events.append(("forgot", one)))
    monkeypatch.setattr(step_response, "start_posture", lambda one: f"start of {one.name}")
    monkeypatch.setattr(
        step_response, "put_in_view", lambda world, one, name, rng: events.append(("put", one.name, name, rng.random()))
    )
    monkeypatch.setattr(step_response, "true_centroid", centroid)
    return step_response.respond_all(7, 2, BAR), ran, events


def test_the_error_is_the_object_s_when_its_run_has_ended(responses):
    found, _, _ = responses
    assert [one.true_error for one in found] == [k + 1 for k in range(4 * len(CONFIGURATIONS))]
    assert [len(one.run.looks) for one in found] == [k + 1 for k in range(len(found))]
    assert [one.image.rsplit(", ")[1] for one in found] == [str(k) for k in range(len(found))]  # from before the run
    assert {one.seed for one in found} == {7}


def test_every_configuration_centers_its_own_objects_with_its_own_jacobian(responses):
    found, ran, events = responses
    expected = [
        (one, name)
        for one in CONFIGURATIONS
        for name in (step_response.FLAT if one.posture == "low" else step_response.OBJECTS)
    ]
    assert [(one.config, one.name) for one in found] == [(one.name, name) for one, name in expected]
    for (one, name), told in zip(expected, ran, strict=True):
        masks, pinv = f"masks of {name}", f"J+ of {one.name}"
        assert told == (one.camera, "robot", masks, one.joints, pinv, one.target, step_response.MAX_STEP, 20)
    places = [event[3] for event in events if event[0] == "put"]
    assert len(set(places)) == len(places)  # every object lies elsewhere
    assert [event[1] for event in events if event[0] == "forgot"] == [f"masks of {name}" for _, name in expected]
    assert events.count("stored") == len(expected)
