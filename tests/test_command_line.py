"""What the program promises: its commands and their options, quick help, and a clean end whatever happens to it."""

import argparse
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dense_vs.cli.interrupts import by_interrupt
from dense_vs.cli.main import build_parser, main

DEVICE = "--device --threads"
IMAGES = "--geom-groups --height --width --distractor --compliance --samples --realism"
WORLD = f"--robot --joints --camera {IMAGES} --seed {DEVICE}"
RECORDING = "path joints --episode --camera --joints"
CLUSTER = "--jobs --address"
EXPERIMENT = f"--seed --out --json {DEVICE}"
SERVO_TASK = (
    f"{EXPERIMENT} --targets --babble --period --gain --commands --compliance --prediction --distractor --halve"
)
ARM = f"{EXPERIMENT} --arm --postures --cameras"
HAND = f"{EXPERIMENT} --tries --arm --samples --independent"

OPTIONS = {
    "arms": "names --out",
    "batch": "--out --robot --point --worlds --targets --babble --randomize --order --height --width --seed --gpus "
    f"--checkpoint-every --wait {DEVICE}",
    "body": "recordings --episode --episodes --camera --joints --out --kind --scale --focal-length --held-out "
    "--time-offset --rerun --picture --from",
    "depth-eval": "folder --methods --sets --json",
    "depth-train": "--sequences --seed --out --jobs",
    "estimate": f"{RECORDING} --out --episodes --start --time-offset --scale --every --flow --smoothing --covariance "
    f"--prediction --sway --no-video --rerun --truth {DEVICE} {CLUSTER}",
    "flow-train": "--out --minutes --seed --device --size --batch --held-out --reuse --start",
    "info": RECORDING,
    "learn-model": "recording --out --json --state --controller --kinematics --method --noise --distortion --held-out "
    "--seed",
    "live": f"--driver --lerobot --camera-index --replay --robot {IMAGES} --joints --camera --seed --host --port "
    f"--token --max-speed --amplitude --dead-man --scale --no-labels --no-body --out --checkpoint --format {DEVICE}",
    "reach": "--out --targets --babble --point --max-frames --tolerance --gain --flow --tracker --window "
    f"--min-correlation --lost-after --scale --range --depth --no-video --checkpoint {WORLD}",
    "record": f"--out --format --seconds --log-rate --jitter --time-offset --truth-every {WORLD}",
    "reproduce": "",
    "reproduce dije": "",
    "reproduce dije labels": f"{EXPERIMENT} --seconds --period --distractor",
    "reproduce dije leak": f"{EXPERIMENT} --seconds --period --distractor",
    "reproduce dije rake": SERVO_TASK,
    "reproduce dije reach": SERVO_TASK,
    "reproduce dije vacuum": SERVO_TASK,
    "reproduce gothoskar": "",
    "reproduce gothoskar camera-shift": f"{ARM} --meters --radians",
    "reproduce gothoskar drift": f"{ARM} --samples --slip --warm",
    "reproduce gothoskar few-samples": f"{ARM} --samples --tolerances --kinematics",
    "reproduce gothoskar grasp": HAND,
    "reproduce gothoskar insertion": HAND,
    "reproduce gothoskar kfold": f"{ARM} --samples --folds",
    "reproduce gothoskar noisy-control": f"{ARM} --samples --targets --moves --sigma --controller",
    "reproduce gothoskar noisy-states": f"{ARM} --samples --sigma --controller",
    "reproduce gothoskar relearning": f"{ARM} --samples --relearn-from",
    "reproduce gothoskar servo": f"{ARM} --samples --targets --moves --gains --sigma",
    "reproduce gothoskar single-camera": f"{ARM} --samples --learn-from",
    "reproduce gothoskar speed": f"{EXPERIMENT} --repeats",
    "reproduce gothoskar stages": f"{ARM} --samples --published",
    "reproduce vosvs": "",
    "reproduce vosvs clutter": EXPERIMENT,
    "reproduce vosvs collaboration": EXPERIMENT,
    "reproduce vosvs depth-log": f"{EXPERIMENT} --log",
    "reproduce vosvs learn": f"{EXPERIMENT} --responses --looks",
    "reproduce vosvs pick-place": f"{EXPERIMENT} --method",
    "reproduce vosvs segmentations": f"{EXPERIMENT} --method --difficulty --jobs",
    "reproduce vosvs step-response": EXPERIMENT,
    "reproduce vosvs track": f"{EXPERIMENT} --looks",
    "reproduce vosvs track-person": f"{EXPERIMENT} --looks --mask-seconds",
    "reproduce vosvs trial": f"{EXPERIMENT} --method --difficulty --mask-seconds --objects --jobs --keep",
    "segment": "input --model --out --layout --size --mean --std --activation --mask-input --first-mask",
    "segment-train": "folder --out --negatives --seed --folds",
    "sweep": f"plan --out {CLUSTER} --threads",
}
# Modules that take longer to import than a list of commands may take.
HEAVY = {"numpy", "warp", "cv2", "scipy", "mujoco", "rich"}


def parsers(parser, name=""):
    """Every parser below a parser by its words."""
    parser.complete()
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for word, below in action.choices.items():
                whole = f"{name} {word}".strip()
                yield whole, below
                yield from parsers(below, whole)


def options_of(parser):
    for action in parser._actions:
        if not isinstance(action, argparse._SubParsersAction | argparse._HelpAction):
            yield from action.option_strings or [action.dest]


@pytest.fixture(scope="module")
def all_parsers():
    return dict(parsers(build_parser()))


def test_every_command_is_there(all_parsers):
    assert set(OPTIONS) == set(all_parsers)


@pytest.mark.parametrize("name", OPTIONS)
def test_options_of_a_command(name, all_parsers):
    assert set(OPTIONS[name].split()) == set(options_of(all_parsers[name]))


def described(parser):
    """Every option of a parser that has a value or a switch, by its name, and its help as it is shown."""
    for action in parser._actions:
        if not isinstance(action, argparse._SubParsersAction | argparse._HelpAction):
            yield action, (action.help or "") % {**vars(action), "prog": parser.prog}


def test_every_option_is_described(all_parsers):
    """By more than its default."""
    for name, parser in all_parsers.items():
        assert parser.description, name
        for action, shown in described(parser):
            words = re.sub(r"\(?\bdefault: [^()]*(\([^()]*\))?[^()]*\)?", "", shown)
            assert re.search(r"[a-z]{2}", words), f"{name} {action.option_strings or action.dest}: {shown}"


def test_a_default_that_is_said_is_the_one_that_is_taken(all_parsers):
    for name, parser in all_parsers.items():
        for action, shown in described(parser):
            said = re.search(r"\(default: (-?[\d.]+)\)$", shown)
            if said and isinstance(action.default, int | float):
                assert float(said[1]) == action.default, f"{name} {action.option_strings}"


def test_a_value_has_a_name_that_is_not_the_option_again(all_parsers):
    """N, FILE, NAME: what is to be given there."""
    for name, parser in all_parsers.items():
        for action, _ in described(parser):
            if action.option_strings and action.nargs != 0 and not action.choices:
                assert action.metavar, f"{name} {action.option_strings}"


def program(*arguments):
    return [sys.executable, "-m", "dense_vs", *map(str, arguments)]


@pytest.mark.parametrize("words", [[], ["reproduce"], ["reproduce", "vosvs"]], ids=" ".join)
def test_lists_need_no_heavy_import(words, tmp_path):
    code = (
        "import sys; from dense_vs.cli.main import main\n"
        f"try: main([*{words}, '--help'])\n"
        "except SystemExit: pass\n"
        "print('\\n' + ' '.join(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert not set(done.stdout.splitlines()[-1].split()) & HEAVY


def test_unknown_command_names_the_known_ones(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["dance"])
    assert stopped.value.code == 2
    assert "'reach'" in capsys.readouterr().err


def shell(line, folder):
    """Run a line of shell in which ``$DENSE_VS`` is the program."""
    environment = {**os.environ, "DENSE_VS": " ".join(program())}
    return subprocess.run(
        ["bash", "-o", "pipefail", "-c", line], capture_output=True, text=True, check=False, cwd=folder, env=environment
    )


def no_traceback(done):
    return "Traceback" not in done.stderr and "Exception ignored" not in done.stderr


def test_a_reader_that_left_ends_it_quietly(tmp_path):
    done = shell("$DENSE_VS reproduce gothoskar --help | true", tmp_path)
    assert done.returncode in (0, 141)  # 0 where all was written before the reader left
    assert done.stderr == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_is_one_line(tmp_path):
    done = shell("$DENSE_VS --help > /dev/full", tmp_path)
    assert done.returncode == 2
    assert done.stderr == "dense-vs: cannot write the output: No space left on device\n"
    done = shell("$DENSE_VS dance 2> /dev/full", tmp_path)
    assert done.returncode == 2


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&-", ">&- 2>&- <&-"])
def test_closed_streams(closed, tmp_path):
    done = shell(f"$DENSE_VS --help {closed}", tmp_path)
    assert done.returncode == 0
    assert no_traceback(done)
    done = shell(f"$DENSE_VS depth-eval nowhere {closed}", tmp_path)
    assert done.returncode == 2
    assert no_traceback(done)


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.3, 1.0])
def test_an_interrupt_leaves_no_traceback(delay, tmp_path):
    # What the interpreter does before it comes to us is not ours to answer for.
    begin = "import runpy, signal, sys; signal.signal(signal.SIGINT, signal.SIG_DFL); print('begun', flush=True)"
    code = f"{begin}; sys.argv[1:] = ['reach', '--out', 'out']; runpy.run_module('dense_vs', run_name='__main__')"
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    started = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, **pipes)
    assert started.stdout.readline() == "begun\n"
    time.sleep(delay)
    started.send_signal(signal.SIGINT)
    said = started.communicate(timeout=120)[1]
    assert started.returncode in (130, -signal.SIGINT), said
    assert "Traceback" not in said


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_an_interrupt_that_python_ignores_ends_the_program_all_the_same(name, code):
    """As in the callback of a weak reference, of which the locks of imports have one each."""
    program = f"""
import signal, sys, time, weakref
import dense_vs.__main__ as program

class Lock:
    pass

def main(imported):
    imported()
    lock = Lock()
    reference = weakref.ref(lock, lambda _: signal.raise_signal(signal.{name}))
    del lock
    for _ in range(600):
        time.sleep(0.1)
    return 0

program.main = main
sys.exit(program.program())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=50, check=False)
    assert (done.returncode, done.stderr) == (code, "")


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_an_interrupt_that_code_discards_is_asked_again(name, code):
    """As compiled modules do while they are imported; what waits is woken."""
    program = f"""
import signal, sys, threading
import dense_vs.__main__ as program

def main(imported):
    imported()
    try:
        signal.raise_signal(signal.{name})
    except BaseException:
        pass
    threading.Event().wait(100)
    return 0

program.main = main
sys.exit(program.program())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=50, check=False)
    assert (done.returncode, done.stderr) == (code, "")


def test_an_interrupt_that_is_being_answered_is_not_asked_again():
    """Which may take a while, as files are closed and workers ended; other errors may be handled meanwhile."""
    program = """
import signal, sys, time
import dense_vs.__main__ as program

def slowly():
    try:
        yield
    finally:
        time.sleep(1)
        print("closed", flush=True)

def main(imported):
    imported()
    try:
        for _ in slowly():
            signal.raise_signal(signal.SIGINT)
    finally:
        try:
            raise ValueError
        except ValueError:
            time.sleep(1)
        time.sleep(1)
        print("ended", flush=True)
    return 0

program.main = main
sys.exit(program.program())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=50, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "closed\nended\n", "")


def test_an_interrupt_during_imports_is_left_to_the_system():
    """Compiled modules ignore what is raised while they are imported."""
    program = """
import signal, sys
import dense_vs.__main__ as program

def imported(home):
    try:
        signal.raise_signal(signal.SIGINT)
    except BaseException:
        return sys  # as such a module

sys.modules["dense_vs.cli.main"].import_module = imported
sys.argv[1:] = ["reach", "--out", "out"]
sys.exit(program.program())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=50, check=False)
    assert (done.returncode, done.stderr) == (-signal.SIGINT, "")


def test_an_interrupt_that_python_wrapped_is_one():
    """As happens while a module with dataclasses is imported."""
    wrapped = RuntimeError("Error calling __set_name__")
    wrapped.__cause__ = KeyboardInterrupt()
    assert by_interrupt(wrapped)
    assert not by_interrupt(RuntimeError("of its own"))
