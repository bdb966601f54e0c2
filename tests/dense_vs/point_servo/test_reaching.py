"""Far ways are planned with the body's chain; a lost point is looked for in the posture that it was defined in."""

import numpy as np
import pytest
from planar_robot import PlanarRobot, PlaneCamera
from planar_scene import PlanarScene
from turned_plate import START, Plate

from dense_vs import ServoLoop
from dense_vs.body_model import BodyModel
from dense_vs.body_model.model_file import ModelContent
from dense_vs.body_model.surface import Surface
from dense_vs.point_servo import reaching
from dense_vs.point_servo.body_tracker import BodyTracker
from dense_vs.point_servo.point_memory import PointMemory
from dense_vs.point_servo.reach import ReachEnd

JOINTS = 3


class PlateRobot:
    """Camera and robot: three joints turn the plate in space."""

    joint_names = ("a", "b", "c")
    joint_limits = np.array([[-0.6, 0.6]] * JOINTS)

    def __init__(self):
        self.plate, self.q, self.time = Plate(), np.zeros(JOINTS), 0.0

    def read(self):
        return np.repeat(self.plate.image(self.q)[..., None], 3, axis=2), self.time

    def joints(self):
        return self.q.copy(), self.time

    def command(self, delta):
        self.q = self.q + delta
        self.time += 1 / 30

    def model(self):
        """What the chain and the plate's own plane are."""
        plate, height, width = self.plate, *self.plate.scene.pixels.shape[:2]
        pixels = plate.scene.pixels.reshape(-1, 2)
        points = np.column_stack([(pixels - plate.center) / plate.focal, np.ones(len(pixels))])
        links = np.full(len(points), JOINTS - 1)
        surface = Surface(points, links, np.ones(len(points)), np.full(len(points), 90, np.uint8))
        center = float(plate.center[0]), float(plate.center[1])
        limits = np.array([[-0.3, 0.3]] * JOINTS)
        learned = np.ones(JOINTS, bool)
        return BodyModel(ModelContent(plate.chain, plate.focal, center, (height, width), surface, learned, limits, 0.1))


@pytest.fixture(scope="module")
def plated():
    robot = PlateRobot()
    loop = ServoLoop(robot, robot, device="cpu", seed=1, joint_delay=0.0)
    loop.use_body(robot.model())
    for _ in range(60):
        loop.babble_once()
    while np.abs(robot.q).max() > 1e-3:
        loop.step(np.clip(-robot.q, -0.03, 0.03))
    loop.define_point(START)
    return robot, loop


def test_a_far_way_goes_by_a_planned_posture_and_ends_by_what_is_seen(plated, monkeypatch):
    robot, loop = plated
    assert isinstance(loop.tracker, BodyTracker)
    planned, usual = [], loop.tracker.on_link.posture_for

    def posture_for(*args, **named):
        planned.append(usual(*args, **named))
        return planned[-1]

    monkeypatch.setattr(loop.tracker.on_link, "posture_for", posture_for)
    target = robot.plate.place(np.array([-0.5, 0.4, -0.4]))
    assert np.linalg.norm(target - START) > reaching.FAR * loop.estimator.options.width
    reach = loop.reach(target)
    assert reach.end is ReachEnd.REACHED
    assert np.linalg.norm(robot.plate.place(robot.q) - target) < 1.5
    assert planned
    planned.clear()
    near = robot.plate.place(robot.q) + np.array([5.0, -4.0])
    assert loop.reach(near).end is ReachEnd.REACHED
    assert not planned


@pytest.fixture
def planar():
    robot, scene = PlanarRobot(), PlanarScene()
    loop = ServoLoop(PlaneCamera(robot, scene), robot, device="cpu", seed=2, body_model=False, joint_delay=0.0)
    for _ in range(60):
        loop.babble_once()
    while np.abs(robot.q).max() > 5e-3:
        loop.step(np.clip(-robot.q, -0.03, 0.03))
    loop.define_point([64.0, 48.0])
    for _ in range(8):
        loop.step(np.array([0.03, -0.02, 0.0, 0.01]))
    return robot, loop


def lose(loop):
    loop.tracker.tracks.lost.fill_(1)


def test_a_lost_point_is_looked_for_where_it_was_defined(planar):
    robot, loop = planar
    away = robot.q.copy()
    lose(loop)
    path = []
    loop.on_frame = lambda loop: path.append(robot.q.copy())
    reach = loop.reach([70.0, 44.0])
    assert reach.end is ReachEnd.REACHED
    nearest = min(np.abs(q - loop.memory.positions).max() for q in path)
    assert nearest < reaching.BACK < np.abs(away - loop.memory.positions).max()
    scene = PlanarScene()
    true = scene.to_image(scene.to_plane(np.array([64.0, 48.0]), loop.memory.positions), robot.q)
    assert np.linalg.norm(true - [70.0, 44.0]) < 2.0


def test_a_point_is_remembered_with_what_it_was_to_be_followed_by(planar):
    _, loop = planar
    assert loop.memory.by_link
    loop.define_point(loop.point, method="aligned")
    assert not loop.memory.by_link


def test_a_point_that_looks_otherwise_there_stays_lost(planar):
    robot, loop = planar
    memory = loop.memory
    loop.memory = PointMemory(memory.place, memory.positions, memory.gray[::-1].copy(), None, memory.options)
    loop.on_frame = lose
    lose(loop)
    reach = loop.reach([70.0, 44.0])
    assert reach.end is ReachEnd.LOST
    assert np.abs(robot.q - memory.positions).max() < reaching.BACK
    assert reach.frames < 40


def test_what_a_memory_has_is_found_in_its_own_posture_alone(planar):
    _, loop = planar
    memory = loop.memory
    seen = memory.seen_in(np.roll(memory.gray, 1, axis=1))
    np.testing.assert_allclose(seen.points[0], memory.place + np.array([1.0, 0.0]), atol=0.1)
    assert memory.seen_in(memory.gray[::-1].copy()) is None
