"""A saved body and a recording of another day: what has changed is said, and taken into account."""

import json

import numpy as np
import pytest
from small_recordings import encode
from textured_arm import TexturedArm, postures

from dense_vs.body_model import BodyModel, ChangeKind
from dense_vs.cli import main
from dense_vs.cli.recorded_change import find_recorded_change
from dense_vs.errors import DenseVSError
from dense_vs.recording import open_recording

OFFSET = 0.12
NAMES = ("base", "elbow", "wrist")


def run(*arguments):
    return main([str(argument) for argument in arguments])


def smooth_postures(count):
    """A slow way through some postures ``(count, 3)`` [rad]."""
    corners = postures(6)
    at = np.linspace(0, len(corners) - 1, count)
    return np.column_stack([np.interp(at, np.arange(len(corners)), corner) for corner in corners.T])


def written(folder, arm, offset=0.0, grown=1):
    """A video and a joint log in which the elbow reads more than it did."""
    q = smooth_postures(36)
    images = [np.repeat(arm.image(one)[..., None], 3, axis=2).repeat(grown, axis=0).repeat(grown, axis=1) for one in q]
    encode(folder / "video.mp4", images, options={"crf": "12"})
    readings = q + np.array([0, offset, 0])
    rows = [",".join(["time", *NAMES])]
    rows += [",".join(f"{value:.6f}" for value in (k / 30, *one)) for k, one in enumerate(readings)]
    (folder / "joints.csv").write_text("\n".join(rows) + "\n")
    return folder / "video.mp4", folder / "joints.csv"


@pytest.fixture(scope="module")
def days(tmp_path_factory):
    """The body, a recording of the day it was learned, and one of a day on which the elbow reads more."""
    arm, folder = TexturedArm(), tmp_path_factory.mktemp("days")
    arm.model().save(folder / "body.npz")
    (folder / "first").mkdir()
    (folder / "later").mkdir()
    return {
        "body": folder / "body.npz",
        "first": written(folder / "first", arm),
        "later": written(folder / "later", arm, OFFSET),
    }


def test_a_body_is_brought_up_to_a_joint_whose_zero_has_changed(days, tmp_path, capsys):
    out = tmp_path / "now.npz"
    assert run("body", *days["later"], "--from", days["body"], "--out", out, "--time-offset", 0) == 0
    said = capsys.readouterr().out
    assert "since the body was learned elbow reads 0.1" in said
    assert out.with_suffix(".png").is_file()
    before, now = BodyModel.load(days["body"]), BodyModel.load(out)
    np.testing.assert_allclose(now.chain.home - before.chain.home, [0, OFFSET, 0], atol=0.005)


def test_where_nothing_has_changed_the_body_is_written_as_it_was(days, tmp_path, capsys):
    out, picture = tmp_path / "now.npz", tmp_path / "picture.png"
    assert (
        run("body", *days["first"], "--from", days["body"], "--out", out, "--time-offset", 0, "--picture", picture) == 0
    )
    assert "nothing has changed since the body was learned" in capsys.readouterr().out
    assert picture.is_file()
    np.testing.assert_array_equal(BodyModel.load(out).chain.home, BodyModel.load(days["body"]).chain.home)


def test_another_body_is_refused_and_nothing_is_written(days, tmp_path, capfd):
    TexturedArm(seed=7).model().save(tmp_path / "other.npz")
    out = tmp_path / "now.npz"
    assert run("body", *days["first"], "--from", tmp_path / "other.npz", "--out", out, "--time-offset", 0) == 2
    assert "for none of the reasons that can be found; learn it anew, without --from" in capfd.readouterr().err
    assert not out.exists()
    assert not out.with_suffix(".png").exists()
    words = ("--from", days["body"], "--rerun")
    assert run("body", *days["first"], *words, "--out", out) == 2
    assert "--from and --rerun are both given; expected one of them" in capfd.readouterr().err
    assert run("body", *days["first"], "--from", days["body"], "--scale", 0.5, "--out", out, "--time-offset", 0) == 2
    assert "expected (150, 200) as the body's are" in capfd.readouterr().err


def test_an_estimate_begins_with_the_body_as_it_is_by_now(days, tmp_path, capsys):
    common = ("--no-video", "--device", "cpu", "--threads", 1, "--time-offset", 0)
    for day, told in (("first", "nothing has changed since"), ("later", "since the body was learned elbow reads 0.1")):
        assert run("estimate", *days[day], "--out", tmp_path / day, "--start", days["body"], *common) == 0
        assert f"- {told}" in capsys.readouterr().out
        summary = json.loads((tmp_path / day / "summary.json").read_text())
        assert summary["body_change"].startswith(told)
    assert run("estimate", *days["first"], "--out", tmp_path / "none", *common) == 0
    assert json.loads((tmp_path / "none" / "summary.json").read_text())["body_change"] is None


def test_images_of_another_scale_are_brought_to_the_bodys(days, tmp_path):
    video = written(tmp_path, TexturedArm(), OFFSET, grown=2)
    change = find_recorded_change(BodyModel.load(days["body"]), open_recording(*video).episode())
    assert change.kind is ChangeKind.JOINT
    np.testing.assert_allclose(change.offsets, [0, OFFSET, 0], atol=0.01)


def test_recordings_that_do_not_fit_the_body_are_refused(days):
    body, episode = BodyModel.load(days["body"]), open_recording(*days["first"]).episode()
    with pytest.raises(DenseVSError, match="body is 3; expected a BodyModel"):
        find_recorded_change(3, episode)
    two = open_recording(*days["first"], joint_names=["base", "wrist"]).episode()
    with pytest.raises(DenseVSError, match=r"joints has shape \(8, 2\)"):
        find_recorded_change(body, two)
    body.size = (150, 150)
    with pytest.raises(DenseVSError, match="images are of 200 x 150 px; expected 150 x 150, or another scale"):
        find_recorded_change(body, episode)
