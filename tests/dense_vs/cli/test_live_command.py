"""``dense-vs live`` as a program: it prints a link that works, and ends at once when it is told to."""

import select
import signal
import subprocess
import sys
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path

import pytest

from dense_vs.cli.live import _ports
from dense_vs.cli.main import main
from dense_vs.errors import DenseVSError
from dense_vs.live.sources import from_driver

pytest.importorskip("uvicorn", reason="the live extra is not installed")

SUPPORT = Path(__file__).parents[2] / "support"
DRIVER = """
from sliding_scene import SlidingRobot
def make():
    robot = SlidingRobot()
    return robot, robot
def wrong():
    return 5
"""


@pytest.fixture
def driver(tmp_path):
    file = tmp_path / "board_driver.py"
    file.write_text(DRIVER)
    return file


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_it_serves_at_the_printed_link(driver, monkeypatch, host):
    monkeypatch.setenv("PYTHONPATH", str(SUPPORT))
    words = [sys.executable, "-m", "dense_vs", "live", "--driver", f"{driver}:make", "--host", host, "--port", "0"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=driver.parent)
    try:
        assert select.select([process.stdout], [], [], 100)[0]
        link = process.stdout.readline().strip()
        assert ("?token=" in link) == (host == "0.0.0.0")
        port = link.split(":")[2].split("/")[0]
        path = link.split(port, 1)[1]
        with closing(HTTPConnection(f"127.0.0.1:{port}", timeout=30)) as connection:
            connection.request("GET", path)
            # A token is moved into a cookie first.
            assert connection.getresponse().status == (200 if host == "127.0.0.1" else 303)
    finally:
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode in (0, 130)
    assert "Traceback" not in said


def test_a_driver_file_gives_camera_and_robot(driver, monkeypatch):
    monkeypatch.syspath_prepend(str(SUPPORT))
    source = from_driver(f"{driver}:make")
    assert source.name == "board_driver"
    assert source.camera is source.robot
    for text in (f"{driver}:wrong", f"{driver}:nothing", f"{driver}", "x.py:make", f"{driver}:a b"):
        with pytest.raises(DenseVSError):
            from_driver(text)


def test_a_number_is_the_pages_port_and_a_path_the_robots():
    assert _ports([]) == (8000, None)
    assert _ports(["/dev/ttyACM0", "9000"]) == (9000, "/dev/ttyACM0")
    for wrong in (["1", "2"], ["/dev/a", "/dev/b"], ["70000"]):
        with pytest.raises(DenseVSError, match="port"):
            _ports(wrong)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--driver", "a.py:make", "--replay", "b"], "several robots"),
        (["--driver", "a.py"], "FILE.py:FUNCTION"),
        (["--lerobot", "so101_follower"], "--port PATH"),
        (["--replay", "nowhere"], "nowhere"),
        (["--token", "short"], "token"),
        (["--format", "gif"], "--format"),
        (["--max-speed", "0"], "max_speed"),
        (["--amplitude", "-0.1"], "amplitude"),
    ],
)
def test_wrong_arguments_end_with_a_line(capsys, words, said):
    assert main(["live", *words, "--port", "0"]) == 2
    assert said in capsys.readouterr().err
