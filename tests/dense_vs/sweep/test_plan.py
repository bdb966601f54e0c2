"""The file that says what to run: every combination once, and one clear line for whatever else is in it."""

import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sweep.plan import read_plan


def plan(tmp_path, text):
    file = tmp_path / "sweep.toml"
    file.write_text(text, encoding="utf-8")
    return read_plan(file)


def test_every_combination_of_options_and_seeds(tmp_path):
    text = """
    [[experiment]]
    command = "reach"
    seeds = "3:5"
    [experiment.options]
    robot = ["arm", "planar"]
    no-video = true
    quiet = false
    size = [[1, 2]]

    [[experiment]]
    command = "reproduce dije labels"
    arguments = ["x"]
    """
    tasks = plan(tmp_path, text)
    common = ("--no-video", "--size", "1", "2", "--seed")
    assert [task.arguments for task in tasks] == [
        ("reach", "--robot", "arm", *common, "3"),
        ("reach", "--robot", "arm", *common, "4"),
        ("reach", "--robot", "planar", *common, "3"),
        ("reach", "--robot", "planar", *common, "4"),
        ("reproduce", "dije", "labels", "x"),
    ]
    assert [task.seed for task in tasks] == [3, 4, 3, 4, None]
    assert len({task.group for task in tasks}) == 3
    assert len({task.name for task in tasks}) == 5


def test_a_key_changes_with_code_and_options_and_with_nothing_else(tmp_path):
    text = "[[experiment]]\ncommand = 'reach'\nseeds = [{}]\n"
    one, same, other = (plan(tmp_path, text.format(seed))[0] for seed in (1, 1, 2))
    assert one.key("a") == same.key("a")
    assert len({one.key("a"), one.key("b"), other.key("a")}) == 3


REACH = "[[experiment]]\ncommand = 'reach'\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "holds nothing"),
        ("experiment = 3", r"expected \[\[experiment\]\]"),
        ("[[experiment]]", "command None"),
        ("[[experiment]]\ncommand = ''", "command ''"),
        ("[[experiment]]\ncommand = 'sweep x'", "other than sweep"),
        (f"{REACH}seed = 1", "has seed; expected some of arguments, command"),
        (f"{REACH}seeds = '5:5'", "seeds '5:5'"),
        (f"{REACH}seeds = '0:99999999'", "seeds"),
        (f"{REACH}seeds = [true]", "seeds"),
        (f"{REACH}seeds = [-1]", "seeds"),
        (f"{REACH}seeds = [1, 1]", "asks again for: reach --seed 1"),
        (f"{REACH}options = 3", "options 3"),
        (f"{REACH}options = {{ out = 'x' }}", "sets out"),
        (f"{REACH}options = {{ robot = [] }}", "empty list"),
        (f"{REACH}options = {{ robot = {{ a = 1 }} }}", "expected text"),
        ("[[experiment", "cannot read"),
    ],
)
def test_what_makes_no_sense_is_said(text, said, tmp_path):
    with pytest.raises(DenseVSError, match=said):
        plan(tmp_path, text)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(DenseVSError, match="cannot read"):
        read_plan(tmp_path / "nowhere.toml")
