"""A body that a checkpoint holds: the loop and the body's process go on with it, unless bodies are not wanted."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.live import body_task, keeping
from dense_vs.live.body_task import BodyTask
from dense_vs.live.keeping import Keeping


class Session:
    """What the two see of one."""

    def __init__(self, body, commands=True, model=None):
        self.told, self.lines = [], []
        options = SimpleNamespace(height=24, width=32)
        self._loop = SimpleNamespace(
            joint_delay=0.0,
            body_model=model,
            estimator=SimpleNamespace(options=options),
            group=SimpleNamespace(names=("a", "b")),
            frame=SimpleNamespace(positions=np.array([0.1, 0.2])),
            use_body=lambda model: self.told.append(("body", model)),
        )
        self.options = SimpleNamespace(body=body, checkpoint=Path("kept.npz"), device="cpu", threads=1)
        self.source = SimpleNamespace(commands=commands)
        self.board = SimpleNamespace(log=lambda text, kind="info": self.lines.append((text, kind)))

    def running_loop(self):
        return self._loop

    def use(self, estimator):
        self.told.append(("estimator", estimator))


@pytest.mark.parametrize(
    ("held", "wanted", "taken", "said"),
    [("the body", True, ["the body"], ", with its body"), ("the body", False, [], ""), (None, True, [], "")],
)
def test_a_session_goes_on_with_the_body_that_is_kept(monkeypatch, held, wanted, taken, said):
    brought = []
    kept = SimpleNamespace(estimator="J", seconds=12.0, body=held, bring_to=lambda q: brought.append(q.tolist()))
    resume = SimpleNamespace(resume=lambda size, device, threads: kept)
    monkeypatch.setattr(keeping, "Checkpoint", lambda path, names: resume)
    session = Session(wanted)
    Keeping(session)
    assert brought == [[0.1, 0.2]]
    assert session.told == [("estimator", "J"), *(("body", one) for one in taken)]
    assert session.lines == [("going on from kept.npz, learned in 12 s of motion" + said, "info")]


@pytest.mark.parametrize(
    ("wanted", "commands", "model", "told"),
    [
        (True, True, None, ["begun"]),
        (True, True, "known", ["begun", "known"]),
        (False, True, None, []),
        (True, False, None, []),
    ],
)
def test_the_body_process_takes_a_body_that_is_known_already(monkeypatch, wanted, commands, model, told):
    heard = []

    def process(size, group, learned):
        heard.append("begun")
        assert size == (24, 32)
        return SimpleNamespace(use=heard.append)

    monkeypatch.setattr(body_task, "BodyProcess", process)
    task = BodyTask(Session(wanted, commands, model))
    assert heard == told
    assert (task.process is None) == (not told)
