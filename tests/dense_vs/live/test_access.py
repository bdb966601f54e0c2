"""Who may use the page."""

import pytest

from dense_vs.errors import DenseVSError
from dense_vs.live.access import COOKIE, Access, is_loopback
from dense_vs.live.control import SILENT_SECONDS, Control

OURS = {"host": "127.0.0.1:8000", "origin": "http://127.0.0.1:8000"}


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "127.5.5.5"])
def test_loopback_needs_no_token(host):
    assert is_loopback(host)
    assert Access(host).token == ""
    assert Access(host).refusal(OURS, {}, changes=True) is None


@pytest.mark.parametrize(
    "headers",
    [
        OURS | {"origin": "http://evil.example"},
        OURS | {"origin": "http://127.0.0.1:8001"},
        OURS | {"origin": "null"},
        {"host": "evil.example:8000", "origin": "http://evil.example:8000"},  # a name that resolves to loopback
        {"host": ""},
        {"host": "127.0.0.1:8000"},  # a web socket or upload without an origin
    ],
)
def test_other_origins_are_refused(headers):
    assert Access("127.0.0.1").refusal(headers, {}, changes=True) is not None


def test_a_look_needs_no_origin():
    assert Access("127.0.0.1").refusal({"host": "localhost:8000"}, {}, changes=False) is None


def test_another_host_needs_the_token():
    access = Access("0.0.0.0")
    theirs = {"host": "robot:8000", "origin": "http://robot:8000"}
    assert len(access.token) == 32
    assert access.token != Access("0.0.0.0").token
    assert access.refusal(theirs, {}, changes=True) is not None
    assert access.refusal(theirs, {"token": access.token[:-1] + "x"}, changes=True) is not None
    assert access.refusal(theirs, {"token": access.token}, changes=True) is None
    assert access.refusal(theirs | {"cookie": f"a=b; {COOKIE}={access.token}"}, {}, changes=True) is None
    assert access.refusal(theirs | {"cookie": f"{COOKIE}=wrong"}, {}, changes=True) is not None
    assert access.refusal(theirs | {"cookie": "\x00;=;;"}, {}, changes=True) is not None


@pytest.mark.parametrize("token", ["", "short", "sixteen letters!", "ä" * 20])
def test_a_weak_token_is_refused(token):
    with pytest.raises(DenseVSError, match="token"):
        Access("127.0.0.1", token)


def test_one_page_holds_control_and_its_silence_stops_the_robot():
    now, stops = [0.0], []
    control = Control(stops.append, lambda: now[0])
    assert control.take(1)
    assert not control.take(2)
    now[0] += SILENT_SECONDS / 2
    control.heard(2)  # a watcher does not count
    control.check()
    assert control.holder == 1
    now[0] += SILENT_SECONDS
    control.check()
    assert control.holder is None
    assert len(stops) == 1
    assert control.take(2)
    control.leave(1, "gone")
    assert control.holder == 2
    control.leave(2, "closed")
    assert stops[-1] == "closed"
