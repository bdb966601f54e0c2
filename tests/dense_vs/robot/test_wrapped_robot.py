"""Whatever stands between a loop and a robot passes every member on, also one that is added to the protocols later."""

import ast
import inspect
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.live.gate import GatedRobot, PageGate
from dense_vs.recording import Recorder
from dense_vs.robot import WrappedRobot, protocols
from dense_vs.robot.joint_group import ROBOT_MEMBERS, JointGroup

ROOT = Path(__file__).resolve().parents[3]
OF_A_ROBOT = (protocols.Robot, protocols.JointUnits, protocols.Holding, protocols.Watched)
OF_OTHERS = (protocols.Camera, protocols.DepthCamera, protocols.Gripper, protocols.GripperState)
STEP = np.array([0.01, -0.02])


def members(protocol):
    return {name: value for name, value in vars(protocol).items() if not name.startswith("_")}


EVERY = {name: value for protocol in OF_A_ROBOT for name, value in members(protocol).items()}


class Plain:
    """A robot that has what a robot must have, and writes down what it is told."""

    joint_names = ("turn", "slide")
    joint_limits = np.array([[-1.0, 1.0], [0.0, 0.5]])

    def __init__(self):
        self.told = []

    def joints(self):
        return np.array([0.1, 0.2]), 3.0

    def command(self, delta):
        self.told.append(("command", np.array(delta)))


class Full(Plain):
    """One that has what a robot may have besides."""

    joint_units = ("rad", "m")
    watchdog = "module:hold"

    def hold(self):
        self.told.append(("hold",))


def gated(robot, folder):
    gate = PageGate(4.0)  # at which the step passes, of the sliding joint too
    gate.allow()
    return GatedRobot(robot, gate)


def recorded(robot, folder):
    return Recorder(SimpleNamespace(), robot, folder / "run", form="mcap")


def faulty(robot, folder):
    pytest.importorskip("mujoco", reason="the simulator needs MuJoCo")
    from dense_vs.sims.engine.faults import FaultInjector

    made = FaultInjector(SimpleNamespace(shape=(1, 2), joint_names=robot.joint_names, time=0.0))
    made._robot = robot
    return made


MAKERS = {"GatedRobot": gated, "Recorder": recorded, "FaultInjector": faulty}


@pytest.fixture(params=[*MAKERS, "WrappedRobot"])
def wrap(request, tmp_path):
    make = MAKERS.get(request.param, lambda robot, _: WrappedRobot(robot))
    with ExitStack() as files:

        def made(robot):
            wrapper = make(robot, tmp_path)
            if isinstance(wrapper, Recorder):
                files.callback(wrapper.__exit__, RuntimeError)  # as after an error: nothing is kept
            return wrapper

        yield made


def test_the_robot_of_this_test_has_every_member():
    """So that one that is added to the protocols cannot be forgotten here, and then in the wrappers."""
    assert set(EVERY) <= set(dir(Full))
    assert set(members(protocols.Robot)) == set(ROBOT_MEMBERS)
    defined = {one for _, one in inspect.getmembers(protocols, inspect.isclass) if one.__module__ == protocols.__name__}
    assert defined == {*OF_A_ROBOT, *OF_OTHERS}


def test_every_member_is_passed_on(wrap):
    robot = Full()
    wrapper = wrap(robot)
    for name, value in EVERY.items():
        if isinstance(value, property):
            assert getattr(wrapper, name) is getattr(robot, name), name
    positions, time = wrapper.joints()
    assert (positions.tolist(), time) == ([0.1, 0.2], 3.0)
    methods = {name for name, value in EVERY.items() if not isinstance(value, property)} - {"joints"}
    for name in sorted(methods):
        getattr(wrapper, name)(*[STEP for _ in list(inspect.signature(EVERY[name]).parameters)[1:]])
    assert [told[0] for told in robot.told] == sorted(methods)
    np.testing.assert_array_equal(robot.told[0][1], STEP)
    assert JointGroup.of_robot(wrapper).units == ("rad", "m")


def test_what_a_robot_need_not_have_may_be_missing(wrap):
    wrapper = wrap(Plain())
    assert wrapper.joint_units == ("rad", "rad")
    assert wrapper.watchdog is None
    wrapper.hold()
    assert JointGroup.of_robot(wrapper).units == ("rad", "rad")


def classes():
    """Every class of the product with its file."""
    for folder in ("dense_vs", "sims", "profiling"):
        for file in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef):
                    yield node, file


def test_every_robot_around_a_robot_is_a_wrapped_one():
    around, wrapped = set(), set()
    for node, _ in classes():
        methods = {one.name: one for one in node.body if isinstance(one, ast.FunctionDef)}
        if node.name == "WrappedRobot":
            continue
        if "WrappedRobot" in map(ast.unparse, node.bases):
            wrapped.add(node.name)
        elif {"joints", "command", "__init__"} <= set(methods):
            taken = [one.annotation for one in methods["__init__"].args.args if one.annotation is not None]
            around |= {node.name for one in taken if ast.unparse(one) in ("Robot", "SimRobot", "ManipulatorRobot")}
    assert around == set()
    assert wrapped == set(MAKERS)
