"""A simulated SO-101 that speaks the interface of LeRobot 0.4: a bus of six motors in counts, and drops readings."""

from types import SimpleNamespace

NAMES = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")


class FakeBus:
    """Motors that go half of the way to their goals with each reading.

    Attributes:
        dropped: how many of the next readings fail.
        writes: every ``sync_write`` that came.
    """

    def __init__(self):
        self.motors = {name: SimpleNamespace(id=number) for number, name in enumerate(NAMES, 1)}
        self.position = dict.fromkeys(NAMES, 2048)
        self.position["wrist_roll"] = 30  # near the end of its counts
        self.goal = dict(self.position)
        self.dropped = 0
        self.writes = []

    def sync_read(self, data_name, motors=None, *, normalize=True, num_retry=0):
        assert (data_name, normalize) == ("Present_Position", False), "normalizing needs a calibration"
        if self.dropped:
            self.dropped -= 1
            raise ConnectionError("Failed to sync read 'Present_Position': there is no status packet!")
        for name in NAMES:
            far = self.goal[name] - self.position[name]
            self.position[name] += far if abs(far) == 1 else round(0.5 * far)
        return {name: self.position[name] for name in motors or NAMES}

    def sync_write(self, data_name, values, *, normalize=True, num_retry=0):
        assert (data_name, normalize) == ("Goal_Position", False), "normalizing needs a calibration"
        assert all(isinstance(value, int) and 0 <= value < 4096 for value in values.values()), values
        self.goal.update(values)
        self.writes.append(dict(values))

    def connect(self, handshake=True):
        self.connected = True

    def disconnect(self, disable_torque=True):
        assert not disable_torque, "an arm that lets go falls"
        self.connected = False


class FakeSO101:
    """The arm."""

    def __init__(self):
        self.bus, self.is_connected = FakeBus(), True

    def disconnect(self):
        self.is_connected = False


class FakeWithoutBus:
    """A robot that is used by observations and actions alone, in degrees."""

    def __init__(self):
        self.action_features = {"neck.pos": float, "head.pos": float, "base.vel": float}
        self.is_connected, self.at = True, {"neck.pos": 10.0, "head.pos": -20.0, "base.vel": 0.0}

    def get_observation(self):
        return dict(self.at)

    def send_action(self, action):
        self.at.update(action)
        return action
