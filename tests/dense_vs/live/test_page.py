"""The page in a real browser, on a board that slides: buttons, keys, reload, a second page, other origins."""

import asyncio
import threading
import time

import numpy as np
import pytest
from live_rig import browser, served
from sliding_scene import HEIGHT, WIDTH, J, SlidingRobot, wait_for

pytest.importorskip("uvicorn", reason="the live extra is not installed")
pytest.importorskip("starlette", reason="the live extra is not installed")

from dense_vs.live import control
from dense_vs.live.access import Access
from dense_vs.live.clients import Clients
from dense_vs.live.control import SILENT_SECONDS
from dense_vs.live.mode import Mode
from dense_vs.live.options import LiveOptions
from dense_vs.live.session import LiveSession
from dense_vs.live.source import LiveSource

TIMEOUT = 20_000  # ms, of every wait in the browser


@pytest.fixture(scope="module")
def chromium():
    with browser() as started:
        yield started


@pytest.fixture(scope="module")
def robot():
    return SlidingRobot()


@pytest.fixture(scope="module")
def session(robot):
    return LiveSession(LiveSource(robot, robot, "board"), LiveOptions(body=False, labels=False, stall_seconds=2.0))


@pytest.fixture(scope="module")
def address(session):
    with served(session) as address:
        assert wait_for(lambda: session.mode is Mode.STILL, 60), session.board.lines()
        session.ask(lambda: session.begin_mode(Mode.LEARNING))
        assert wait_for(lambda: any("learned: J" in line["text"] for line in session.board.lines()), 60)
        yield address


@pytest.fixture
def page(chromium, address):
    one = opened(chromium, f"http://{address}/")
    assert until(one, lambda: one.locator("#learn").is_enabled())
    yield one
    one.close()


def opened(chromium, link):
    page = chromium.new_page(viewport={"width": 1100, "height": 800})
    page.set_default_timeout(TIMEOUT)
    page.faults = []
    page.on("pageerror", lambda error: page.faults.append(str(error)))
    page.goto(link)
    return page


def shown_frame(page) -> int:
    return int(page.get_attribute("#picture", "data-frame") or 0)


def until(page, condition, seconds=60.0) -> bool:
    """Wait for a condition while the page goes on; whether it holds."""
    end = time.monotonic() + seconds
    while not (held := bool(condition())) and time.monotonic() < end:
        page.wait_for_timeout(20)
    return held


def click(page, place):
    """Click on a place of the filter's image [px]."""
    box = page.locator("#marks").bounding_box()
    x, y = ((place[0] + 0.5) / WIDTH * box["width"], (place[1] + 0.5) / HEIGHT * box["height"])
    page.mouse.click(box["x"] + x, box["y"] + y)


def test_the_image_moves_and_nothing_fails(page):
    assert until(page, lambda: shown_frame(page) > 0)
    first = shown_frame(page)
    assert until(page, lambda: shown_frame(page) > first + 5)
    assert page.inner_text("#source") == "board"
    assert page.locator("#joints tbody tr").count() == 2
    assert page.faults == []


def test_clicks_bring_a_point_to_its_target_and_a_reload_keeps_it(page, session, robot):
    assert until(page, lambda: shown_frame(page) > 0)
    session.ask(session.points.clear)
    assert until(page, lambda: not len(session.points) and page.locator(".point").count() == 0)
    place = np.array([80.0, 60.0])
    start = place - J @ robot.q
    click(page, place)
    assert until(page, lambda: page.locator(".point").count() == 1)
    assert until(page, lambda: page.locator(".point.chosen").count() == 1)
    target = place + np.array([12, -8])
    click(page, target)
    assert until(page, lambda: page.locator(".point[data-state=reached]").count() == 1), session.board.lines()
    assert np.hypot(*(robot.place(start) - target)) < 2.0
    page.reload()
    assert until(page, lambda: page.locator(".point[data-state=reached]").count() == 1)
    assert "point 1" in page.inner_text("#log")
    assert session.mode is Mode.STILL  # the page that was in control was gone for a moment
    assert until(page, lambda: "Stopped: the page" in page.inner_text("#banner"))


def test_a_drag_lets_the_point_follow(page, session, robot):
    assert until(page, lambda: shown_frame(page) > 0)
    session.ask(session.points.clear)
    assert until(page, lambda: not len(session.points) and page.locator(".point").count() == 0)
    click(page, (80, 60))
    # The list shows a point with the state that tells of it, a drag takes hold of it once an image with it is drawn.
    assert until(page, lambda: page.locator(".point.chosen").count() == 1)
    number = next(iter(session.points)).number
    box = page.locator("#marks").bounding_box()
    scale = box["width"] / WIDTH
    page.mouse.move(box["x"] + 80.5 * scale, box["y"] + 60.5 * scale)
    page.mouse.down()
    for step in range(1, 9):
        page.mouse.move(box["x"] + (80.5 - step) * scale, box["y"] + (60.5 + step / 2) * scale)
        page.wait_for_timeout(60)
    page.mouse.up()
    assert until(page, lambda: page.locator(".point[data-state=reached]").count() == 1), session.board.lines()
    point = next(iter(session.points))
    assert point.number == number
    np.testing.assert_allclose(point.target, [72, 64], atol=1.0)


def test_before_it_is_connected_a_page_offers_no_motion_and_its_stop_waits(chromium, address, session, monkeypatch):
    connect, serve = threading.Event(), Clients.serve

    async def later(clients, socket):
        while not connect.is_set():
            await asyncio.sleep(0.01)
        await serve(clients, socket)

    monkeypatch.setattr(Clients, "serve", later)
    page = opened(chromium, f"http://{address}/")
    try:
        steering = page.locator("button.steer, #speed, #dead-man, #load")
        assert steering.count() >= 10
        assert all(one.is_disabled() for one in steering.all())
        stops = session.gate.stops
        page.keyboard.press("Space")
        page.wait_for_timeout(100)
        assert session.gate.stops == stops
        connect.set()
        assert until(page, lambda: session.gate.stops > stops)
        assert until(page, lambda: page.locator("#learn").is_enabled())
    finally:
        connect.set()
        page.close()


@pytest.mark.parametrize("way", ["button", "Space", "Escape", "tab", "silence"])
def test_every_way_to_stop(chromium, address, session, robot, way, monkeypatch):
    page = opened(chromium, f"http://{address}/")
    try:
        assert until(page, lambda: page.locator("#learn").is_enabled())
        began = time.monotonic()
        page.click("#learn")
        assert until(page, lambda: robot.moved_since(began)), session.board.lines()
        if way == "button":
            page.click("#stop")
        elif way == "tab":
            page.close()
        elif way == "silence":
            monkeypatch.setattr(control, "SILENT_SECONDS", SILENT_SECONDS)
            page.evaluate("() => { for (let id = 1; id < 1000; id++) clearInterval(id); }")
        else:
            page.keyboard.press(way)
        assert wait_for(lambda: not session.gate.open, 5)
        closed = time.monotonic()
        count = len(robot.commands)
        assert wait_for(lambda: len(robot.commands) > count + 5)
        # Within one frame: of the commands that came after the gate was seen closed, none moves.
        assert not robot.moved_since(closed + 0.005)
    finally:
        if not page.is_closed():
            page.close()


def test_a_held_key_moves_and_its_release_holds_still(page, session, robot):
    assert until(page, lambda: page.locator("#dead-man").is_enabled())
    page.check("#dead-man")
    assert until(page, lambda: session.gate.dead_man)
    try:
        began = time.monotonic()
        page.click("#learn")
        assert until(page, lambda: session.gate.open)
        page.wait_for_timeout(300)
        assert not robot.moved_since(began)
        page.keyboard.down("g")
        assert until(page, lambda: robot.moved_since(began))
        page.keyboard.up("g")
        assert until(page, lambda: not session.gate.passing, 3)
        released = time.monotonic()
        page.wait_for_timeout(300)
        assert not robot.moved_since(released + 0.005)
    finally:
        session.stop("the test is over")
        session.gate.dead_man = False


def test_a_choice_stays_while_it_travels_and_follows_the_session_after(page, session):
    assert until(page, lambda: page.locator("#dead-man").is_enabled())
    page.evaluate(
        """() => {
            const send = WebSocket.prototype.send;
            WebSocket.prototype.send = function (text) { setTimeout(() => send.call(this, text), 300); };
        }"""
    )
    try:
        frame = shown_frame(page)
        page.check("#dead-man")
        page.locator("#speed").fill("-1.5")
        end = time.monotonic() + 10
        while not session.gate.dead_man and time.monotonic() < end:  # states that were sent before arrive meanwhile
            assert page.locator("#dead-man").is_checked()
            assert page.locator("#speed").input_value() == "-1.5"
        assert session.gate.dead_man
        assert until(page, lambda: session.gate.max_speed == pytest.approx(10**-1.5))
        assert until(page, lambda: shown_frame(page) > frame + 5)
        assert page.locator("#dead-man").is_checked()
        session.gate.dead_man, session.gate.max_speed = False, 1.0  # as by another page
        assert until(page, lambda: not page.locator("#dead-man").is_checked())
        assert until(page, lambda: page.locator("#speed").input_value() == "0")
        assert page.locator("#speed-value").text_content() == "1.00 rad/s"
    finally:
        session.gate.dead_man = False


def test_a_second_page_watches_until_control_is_free(page, chromium, address, session):
    assert until(page, lambda: page.locator("#learn").is_enabled())
    second = opened(chromium, f"http://{address}/")
    assert until(second, lambda: shown_frame(second) > 0)
    assert second.locator("#learn").is_disabled()
    assert "you watch" in second.inner_text("#control")
    page.click("#leave")
    assert until(second, lambda: second.locator("#take").is_visible())
    second.click("#take")
    assert until(second, lambda: second.locator("#learn").is_enabled())
    assert until(page, lambda: page.locator("#learn").is_disabled())
    second.close()


def test_layers_are_drawn(page, session):
    assert until(page, lambda: page.locator("#layer option").count() == 5)
    for layer in ("flow", "predicted flow", "jacobian:left"):
        page.select_option("#layer", layer)
        assert until(page, lambda wanted=layer: wanted in session.board.wanted)
        frame = shown_frame(page)
        assert until(page, lambda before=frame: shown_frame(page) > before + 3)
    page.select_option("#style", "arrows")
    frame = shown_frame(page)
    assert until(page, lambda: shown_frame(page) > frame + 3)
    assert page.faults == []


def test_a_page_of_another_origin_gets_nothing(chromium, address):
    page = chromium.new_page()
    page.goto("about:blank")
    script = """async (address) => {
      const socket = new WebSocket(`ws://${address}/socket`);
      const opened = await new Promise((done) => {
        socket.onopen = () => done(true);
        socket.onerror = () => done(false);
      });
      const post = await fetch(`http://${address}/state`, { method: "POST", mode: "no-cors", body: "x" })
        .then((answer) => answer.type, () => "refused");
      return [opened, post];
    }"""
    opened_socket, _ = page.evaluate(script, address)
    assert opened_socket is False
    page.close()


def test_a_wrong_token_shows_nothing_and_the_right_one_opens(chromium):
    robot = SlidingRobot()
    session = LiveSession(LiveSource(robot, robot, "board"), LiveOptions(body=False, labels=False))
    token = "abcdefghijklmnop123"
    with served(session, Access("127.0.0.1", token)) as address:
        context = chromium.new_context()
        page = context.new_page()
        assert page.goto(f"http://{address}/?token=wrongwrongwrongwrong").status == 403
        page.goto(f"http://{address}/?token={token}")
        assert page.url == f"http://{address}/"
        assert until(page, lambda: shown_frame(page) > 0, 60)
        context.close()


@pytest.mark.parametrize(
    ("units", "speed"), [(("m", "rad"), "1.00 rad/s, 0.250 m/s"), (("m", "m"), "0.250 m/s")], ids=["one", "both"]
)
def test_the_speed_is_shown_in_the_units_of_the_joints(chromium, units, speed):
    robot = SlidingRobot()
    robot.joint_units = units
    session = LiveSession(LiveSource(robot, robot, "board"), LiveOptions(body=False, labels=False))
    with served(session) as address:
        page = opened(chromium, f"http://{address}/")
        assert until(page, lambda: page.locator("#speed-value").text_content() == speed, 60)
        assert not page.faults
        page.close()
