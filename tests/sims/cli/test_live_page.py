"""A simulated arm on the page in a real browser: Learn, click its tip, click a target; the simulator's truth judges.

With DENSE_VS_SCREENSHOTS=FOLDER the pictures of the documentation are taken on the way.
"""

import argparse
import os
import time
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from live_rig import browser, served

pytest.importorskip("uvicorn", reason="the live extra is not installed")
pytest.importorskip("starlette", reason="the live extra is not installed")

from dense_vs.live.followers import BodyFollower
from dense_vs.live.mode import Mode
from dense_vs.live.options import LiveOptions
from dense_vs.live.session import LiveSession
from dense_vs.live.source import LiveSource
from dense_vs.sims import SimCamera, SimRobot, SimWorld
from dense_vs.sims.cli.live_source import SOURCE

HEIGHT, WIDTH = 240, 320
FILM: list[tuple[float, bytes]] = []  # when taken, and the picture
PICTURES = os.environ.get("DENSE_VS_SCREENSHOTS")


@pytest.fixture(scope="module")
def world():
    return SimWorld("painted", seed=3, height=HEIGHT, width=WIDTH, samples=1)


@pytest.fixture(scope="module")
def session(world):
    source = LiveSource(SimCamera(world), SimRobot(world), "simulated arm", paced=False)
    return LiveSession(source, LiveOptions(labels=True, stall_seconds=5.0))


@pytest.fixture(scope="module")
def page(session):
    with browser() as chromium, served(session) as address:
        page = chromium.new_page(viewport={"width": 1280, "height": 860})
        page.set_default_timeout(30_000)
        page.goto(f"http://{address}/")
        yield page


def until(page, condition, seconds=90.0) -> bool:
    end = time.monotonic() + seconds
    while not (held := bool(condition())) and time.monotonic() < end:
        page.wait_for_timeout(50 if PICTURES else 250)  # asking takes time from what is waited for
        film(page)
    return held


def film(page, last=False):
    """Add a picture to the README's moving one, where pictures are wanted; most of them while a point moves."""
    if not PICTURES or page.get_attribute("#picture", "data-frame") is None:
        return
    pause = {"reaching": 0.15, "learning": 0.7}.get(page.inner_text("#mode"), 2.0)  # s
    if last or not FILM or time.monotonic() - FILM[-1][0] > pause:
        FILM.append((time.monotonic(), page.screenshot(type="jpeg", quality=95)))


def save_film(path):
    """The pictures so far as an animated WebP; the last stays for a while."""
    image = pytest.importorskip("PIL.Image", reason="writing WebP needs Pillow")
    frames = [image.open(BytesIO(content)).resize((720, 484)) for _, content in FILM]
    durations = [200] * (len(frames) - 1) + [2500]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=durations, loop=0, quality=45, method=1)


def click(page, place):
    box = page.locator("#marks").bounding_box()
    x, y = (place[0] + 0.5) / WIDTH * box["width"], (place[1] + 0.5) / HEIGHT * box["height"]
    page.mouse.click(box["x"] + x, box["y"] + y)


def picture(page, name):
    if PICTURES:
        page.screenshot(path=Path(PICTURES) / name, type="jpeg", quality=82)


def noted(monkeypatch, session):
    """The number of the frame in which the body begins to be learned, and of that in which it is there."""
    numbers = []
    for name in ("learn", "_use"):
        method = getattr(session.body, name)

        def call(*given, method=method):
            numbers.append(session.number)
            return method(*given)

        monkeypatch.setattr(session.body, name, call)
    return numbers


def test_learn_click_reach_by_the_simulators_truth(page, session, world, monkeypatch):
    assert until(page, lambda: session.mode is Mode.STILL and page.locator("#learn").is_enabled())
    numbers = noted(monkeypatch, session)
    page.click("#learn")
    assert until(page, lambda: session.mode is Mode.LEARNING)
    assert until(page, lambda: "learned: J explains" in page.inner_text("#log")), session.board.lines()
    assert until(page, lambda: "body learned" in page.inner_text("#log"), seconds=300), session.board.lines()
    assert until(page, lambda: not page.locator("#body").is_visible())
    begun, *_, there = numbers
    assert there > begun + 2  # frames went on while the body was learned
    tip = world.project("tip")
    click(page, tip)
    assert until(page, lambda: page.locator(".point.chosen").count() == 1), session.board.lines()
    assert until(page, lambda: isinstance(next(iter(session.points)).follower, BodyFollower)), session.board.lines()
    target = tip + np.array([-22, -14])
    click(page, target)
    assert until(page, lambda: page.locator(".point").first.get_attribute("data-state") == "reached"), (
        session.board.lines()
    )
    film(page, last=True)
    picture(page, "live.jpg")
    if PICTURES:
        save_film(Path(PICTURES) / "live.webp")
    session.stop("the test looks")
    # Where the page's click was, to a fraction of a pixel, is where the simulator's tip has to be.
    assert np.hypot(*(world.project("tip") - target)) < 2.0


def test_a_phone_shows_image_and_stop_without_scrolling(page, session):
    page.set_viewport_size({"width": 390, "height": 780})
    page.select_option("#layer", "jacobian:turret")
    page.wait_for_timeout(1500)
    picture(page, "live_phone.jpg")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    for name in ("#marks", "#stop"):
        box = page.locator(name).bounding_box()
        assert box["x"] >= 0
        assert box["y"] >= 0
        assert box["x"] + box["width"] <= 391
        assert box["y"] + box["height"] <= 781
    page.evaluate("window.scrollTo(0, 1e6)")
    assert page.locator("#stop").bounding_box()["y"] < 780
    session.ask(lambda: session.begin_mode(Mode.REACHING))
    assert until(page, lambda: session.gate.open)
    page.click("#stop")
    assert until(page, lambda: not session.gate.open)


def test_the_arguments_choose_a_robot():
    parser = argparse.ArgumentParser()
    SOURCE.add_arguments(parser)
    shared = {"joints": None, "camera": None, "device": "cpu", "seed": 0, "threads": None}
    chosen = parser.parse_args([], argparse.Namespace(**shared))
    assert SOURCE.make(chosen, needed=False) is None
    made = SOURCE.make(parser.parse_args(["--robot", "planar"], argparse.Namespace(**shared)), needed=False)
    assert made.name == "simulated planar"
    assert len(made.robot.joint_names) == 3
    assert made.camera.read()[0].shape == (240, 320, 3)
