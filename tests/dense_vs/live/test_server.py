"""The server over a real socket: what it serves, what it refuses, and that no page can hold up the loop."""

import http.client
import io
import json
import struct
import time
import zipfile
from contextlib import closing, contextmanager

import numpy as np
import pytest
from live_rig import PATIENCE, served
from sliding_scene import SlidingRobot, wait_for

pytest.importorskip("uvicorn", reason="the live extra is not installed")
pytest.importorskip("starlette", reason="the live extra is not installed")
pytest.importorskip("websockets.sync.client", reason="the live extra is not installed")

from websockets.sync.client import connect

from dense_vs.live import control
from dense_vs.live.access import COOKIE, Access
from dense_vs.live.control import SILENT_SECONDS
from dense_vs.live.options import LiveOptions
from dense_vs.live.server import FILES
from dense_vs.live.session import LiveSession, Mode
from dense_vs.live.source import LiveSource
from dense_vs.live.state_file import most_bytes

TOKEN = "abcdefghijklmnop123"


@pytest.fixture(scope="module")
def robot():
    return SlidingRobot()


@pytest.fixture(scope="module")
def session(robot):
    # A computer that stalls for a second is no camera that does.
    options = LiveOptions(body=False, labels=False, stall_seconds=PATIENCE)
    return LiveSession(LiveSource(robot, robot, "board"), options)


@pytest.fixture(scope="module")
def address(session):
    with served(session) as address:
        assert wait_for(lambda: session.board.snapshot is not None, 60), session.board.lines()
        assert session.mode is Mode.STILL
        yield address


def request(address, method="GET", path="/", body=None, **headers):
    with closing(http.client.HTTPConnection(address, timeout=20)) as connection:
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()


@contextmanager
def page(address, origin=None, path="/socket", **headers):
    with connect(
        f"ws://{address}{path}",
        origin=origin or f"http://{address}",
        additional_headers=headers,
        max_size=None,
        open_timeout=10,
        close_timeout=2,
    ) as socket:
        yield socket


def receive(socket):
    """State and JPEG of the next message."""
    content = socket.recv(timeout=20)
    length = struct.unpack("<I", content[:4])[0]
    return json.loads(content[4 : 4 + length]), content[4 + length :]


def tell(socket, **message):
    socket.send(json.dumps(message))


def read_on(socket):
    for _ in range(500):
        receive(socket)


def test_every_file_comes_from_the_package_and_names_no_other_place(address):
    for name, (_, kind) in FILES.items():
        status, headers, body = request(address, path=f"/{name}")
        assert status == 200
        assert headers["content-type"].startswith(kind)
        assert "default-src 'self'" in headers["content-security-policy"]
        outside = body.replace(b"http://www.w3.org/2000/svg", b"").replace(b"${scheme}://${location.host}", b"")
        assert b"://" not in outside, name
    assert request(address, path="/nothing")[0] == 404
    assert request(address, path="/..%2fserver.py")[0] == 404


def test_images_and_state_come(address):
    with page(address) as socket:
        hello, _ = receive(socket)
        assert hello["hello"]
        images = []
        while len(images) < 3:
            state, jpeg = receive(socket)
            if jpeg:
                images.append((state["frame"], jpeg))
                tell(socket, do="shown")
        assert all(jpeg.startswith(b"\xff\xd8") for _, jpeg in images)
        assert images[0][0] < images[1][0] < images[2][0]
        assert state["joints"][0]["name"] == "left"


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1"])
def test_a_web_socket_of_another_origin_is_refused(address, origin):
    with pytest.raises(Exception, match="403"), page(address, origin=origin):
        pass


def test_a_foreign_host_name_is_refused(address):
    assert request(address, Host="evil.example")[0] == 403
    assert request(address, Origin="http://evil.example")[0] == 403


def test_the_token_is_needed_and_moves_into_a_cookie(robot):
    session = LiveSession(LiveSource(SlidingRobot(), robot, "board"), LiveOptions(body=False, labels=False))
    with served(session, Access("127.0.0.1", TOKEN)) as address:
        assert request(address)[0] == 403
        assert request(address, path="/?token=wrong")[0] == 403
        status, headers, _ = request(address, path=f"/?token={TOKEN}")
        assert (status, headers["location"]) == (303, "/")
        cookie = headers["set-cookie"].split(";")[0]
        assert "HttpOnly" in headers["set-cookie"]
        assert "samesite=strict" in headers["set-cookie"].lower()
        assert request(address, Cookie=cookie)[0] == 200
        with pytest.raises(Exception, match="403"), page(address):
            pass
        with page(address, Cookie=f"{COOKIE}={TOKEN}") as socket:
            assert receive(socket)[0]["hello"]


def test_closing_the_page_in_control_stops_and_a_watcher_may_only_stop(address, session, robot):
    with page(address) as first:
        receive(first)
        assert wait_for(lambda: session.mode is Mode.STILL)
        with page(address) as second:
            receive(second)
            tell(second, do="learn")
            assert wait_for(lambda: any("hold control" in line["text"] for line in session.board.lines()))
            tell(first, do="learn")
            for _ in range(200):
                tell(first, do="alive")
                if robot.moved_since(0.0):
                    break
                time.sleep(0.02)
            assert session.gate.open
            tell(second, do="stop")
            assert wait_for(lambda: not session.gate.open, 5)
        tell(first, do="learn")
        assert wait_for(lambda: session.gate.open, 5)
    assert wait_for(lambda: not session.gate.open, 5)
    assert "closed" in session.gate.reason


def test_a_reload_that_comes_before_the_old_page_goes_gets_control(address, session):
    with page(address) as old:
        receive(old)
        with page(address) as new:
            receive(new)
            old.close()
            control = ""
            for _ in range(100):
                state, jpeg = receive(new)
                control = state["control"]
                if jpeg:
                    tell(new, do="shown")
                if control == "yours":
                    break
            assert control == "yours"
            assert not session.gate.open


def test_a_page_in_control_that_falls_silent_stops(address, session, monkeypatch):
    monkeypatch.setattr(control, "SILENT_SECONDS", SILENT_SECONDS)
    with page(address) as socket:
        receive(socket)
        opened, asked, end = False, -np.inf, time.monotonic() + 10
        while not opened and time.monotonic() < end:  # the loop may take its time, or stop for a stall of its own
            if time.monotonic() - asked > 2:
                asked = time.monotonic()
                tell(socket, do="learn")
            tell(socket, do="alive")
            opened = session.gate.open
            time.sleep(0.02)
        assert opened
        assert wait_for(lambda: not session.gate.open, 10)
        assert "lost" in session.gate.reason


def test_stalled_pages_cost_the_loop_no_frame(address, session):
    """Five pages, one of which never reads: frames go on, and nothing piles up for it."""
    pages = [page(address) for _ in range(5)]
    sockets = [one.__enter__() for one in pages]
    try:
        begin, images = session.board.snapshot.number, 0
        end = time.monotonic() + 20
        while session.board.snapshot.number < begin + 40 and time.monotonic() < end:
            for socket in sockets[1:]:
                _, jpeg = receive(socket)
                if jpeg:
                    images += 1
                    tell(socket, do="shown")
        assert session.board.snapshot.number >= begin + 40
        assert images > 8
    finally:
        for one in pages:
            one.__exit__(None, None, None)


def test_bad_messages_are_answered_by_a_line_and_the_page_stays(address, session):
    with page(address) as socket:
        receive(socket)
        for text in ("{", "[]", '{"do": "x"}', '{"do": "look", "layer": "../x", "style": "color"}'):
            socket.send(text)
        socket.send(b"bytes")
        assert wait_for(lambda: "not text" in session.board.lines()[-1]["text"])
        assert receive(socket)[0]["source"] == "board"


def test_an_oversized_message_closes_the_page(address):
    with page(address) as socket:
        socket.send("x" * 100_000)
        with pytest.raises(Exception, match=r"1009|too big"):
            read_on(socket)


def test_a_state_goes_out_and_comes_back(address, session):
    assert wait_for(lambda: session.mode is Mode.STILL)
    status, headers, body = request(address, path="/state")
    assert status == 200
    assert "attachment" in headers["content-disposition"]
    before = session.running_loop().estimator.updates
    kind = {"Content-Type": "application/octet-stream", "Origin": f"http://{address}"}
    assert request(address, "POST", "/state", body, **kind)[0] == 200
    assert session.running_loop().estimator.updates <= before + 200
    number = session.board.snapshot.number
    assert wait_for(lambda: session.board.snapshot.number > number + 3)


@pytest.mark.parametrize("fault", ["origin", "type", "large", "bomb", "pickle", "garbage", "size"])
def test_bad_uploads_are_refused(address, session, fault):
    assert wait_for(lambda: session.mode is Mode.STILL)
    loop = session.running_loop()
    headers = {"Content-Type": "application/octet-stream", "Origin": f"http://{address}"}
    body, expected = b"nothing", 400
    if fault == "origin":
        headers["Origin"], expected = "http://evil.example", 403
    elif fault == "type":
        headers["Content-Type"], expected = "text/plain", 415
    elif fault == "large":
        body, expected = b"x" * (most_bytes(loop.estimator) + 10), 413
    elif fault == "bomb":
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("state.npy", bytes(2 * most_bytes(loop.estimator)))
        body = stream.getvalue()
        assert len(body) < 100_000
    elif fault == "pickle":
        stream = io.BytesIO()
        np.savez(stream, options=np.array([{"height": 1}], dtype=object))
        body = stream.getvalue()
    elif fault == "size":
        stream = io.BytesIO()
        options = {"height": 9, "width": 9, "joints": 2, "worlds": 1 << 20, "order": 2}
        np.savez(stream, options=json.dumps(options))
        body = stream.getvalue()
    assert request(address, "POST", "/state", body, **headers)[0] == expected
    assert session.running_loop() is loop


def test_there_is_no_recording_before_one_is_made(address):
    assert request(address, path="/recording")[0] == 404
