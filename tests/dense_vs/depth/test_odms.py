"""Scoring on the ODMS sets: the published protocol, and the published baseline on the recorded sets."""

from types import SimpleNamespace

import numpy as np
import pytest
from shared_data import SHARED_DATA

from dense_vs import DenseVSError
from dense_vs.cli.main import main
from dense_vs.depth import odms
from dense_vs.depth.odms import ExampleResult, Sequence, example_views, read_sequences, score_sequence

SETS = SHARED_DATA / "odms_val"
recorded = pytest.mark.skipif(
    not (SETS / "normal.npz").is_file(), reason="needs ../shared/data/odms_val, which is not in the project"
)


def write_set(path, distance=0.3, views=10):
    """A set of one drawn sequence: a square that halves and so on, exactly by perspective."""
    back = np.linspace(0, 0.5, views)
    masks = np.zeros((views, 120, 160), dtype=np.uint8)
    for mask, b in zip(masks, back, strict=True):
        half = round(0.03 * 300 / (distance + b) * 1.0)
        mask[60 - half : 60 + half, 80 - half : 80 + half] = 1
    np.savez(
        path,
        sequence=np.array(["drawn"]),
        start=np.array([0, views]),
        height_width=np.array([120, 160]),
        mask_bits=np.packbits(masks.reshape(views, -1), axis=1),
        camera_back=back.astype(np.float32),
        depth=(distance + back).astype(np.float32),
    )
    return masks


def test_a_robot_sequence_gives_55_examples_and_others_one():
    examples = example_views("robot", 30)
    assert len(examples) == 55
    assert {tuple(views) for views in examples[:2]} == {tuple(range(10)), tuple(range(1, 11))}
    assert examples[-1].tolist() == [0, 3, 6, 9, 12, 16, 19, 22, 25, 29]
    assert all(len(views) == 10 for views in examples)
    assert [views.tolist() for views in example_views("driving", 7)] == [list(range(7))]
    assert example_views("driving", 14)[0].tolist() == np.linspace(0, 13, 10, dtype=int).tolist()


def test_a_set_is_read_as_it_was_packed(tmp_path):
    masks = write_set(tmp_path / "normal.npz")
    (sequence,) = read_sequences(tmp_path / "normal.npz")
    assert sequence.name == "drawn"
    np.testing.assert_array_equal(sequence.masks, masks)
    (example,) = score_sequence("normal", sequence, ("vos-de",))["vos-de"]
    assert example.truth == pytest.approx(0.3)
    assert example.relative_error < 0.1


def test_a_distance_that_was_not_recorded_damages_nothing(tmp_path):
    """Real recordings lack some: an example counts where the distance that is asked for is known."""
    path = tmp_path / "normal.npz"
    write_set(path)
    content = dict(np.load(path))
    content["depth"][7] = np.nan
    np.savez(path, **content)
    (sequence,) = read_sequences(path)
    assert np.isnan(sequence.depth[7])
    (example,) = score_sequence("normal", sequence, ("vos-de",))["vos-de"]
    assert example.truth == pytest.approx(0.3)
    assert example.relative_error < 0.1
    content["depth"][0] = np.nan
    np.savez(path, **content)
    (sequence,) = read_sequences(path)
    assert score_sequence("normal", sequence, ("vos-de",)) == {"vos-de": []}
    for wrong in (np.inf, 0.0, -1.0):
        content["depth"][7] = wrong
        np.savez(path, **content)
        with pytest.raises(DenseVSError, match=r"is damaged: .* not above 0 and finite"):
            list(read_sequences(path))


def test_the_command_refuses_sets_without_a_truth(tmp_path, capsys):
    write_set(tmp_path / "normal.npz")
    content = dict(np.load(tmp_path / "normal.npz"))
    content["depth"][0] = np.nan
    np.savez(tmp_path / "normal.npz", **content)
    assert main(["depth-eval", str(tmp_path), "--methods", "vos-de"]) == 2
    assert "tells no true distance" in capsys.readouterr().err


def test_an_example_without_an_answer_counts_in_full(tmp_path):
    write_set(tmp_path / "normal.npz")
    (sequence,) = read_sequences(tmp_path / "normal.npz")
    still = type(sequence)(sequence.name, sequence.masks, np.zeros(10), sequence.depth)
    (example,) = score_sequence("normal", still, ("robust",))["robust"]
    assert example.relative_error == 1.0
    assert "the camera moves 0 m" in example.failure


def test_the_command_prints_a_score_a_method(tmp_path, capsys):
    write_set(tmp_path / "normal.npz")
    assert main(["depth-eval", str(tmp_path), "--json", str(tmp_path / "scores.json")]) == 0
    printed = capsys.readouterr().out
    for name in ("vos-de", "robust", "learned", "normal 1"):
        assert name in printed
    assert '"truth"' in (tmp_path / "scores.json").read_text()


def test_bad_folders_and_names_are_refused(tmp_path, capsys):
    assert main(["depth-eval", str(tmp_path)]) == 2
    assert "holds no ODMS set" in capsys.readouterr().err
    write_set(tmp_path / "normal.npz")
    assert main(["depth-eval", str(tmp_path), "--methods", "best"]) == 2
    assert "vos-de,robust,learned" in capsys.readouterr().err
    np.savez(tmp_path / "normal.npz", start=np.array([0, 3]))
    with pytest.raises(DenseVSError, match="lacks sequence"):
        list(read_sequences(tmp_path / "normal.npz"))


def small_set(path, **changes):
    """Two sequences of 2 and 3 views, of masks of 1 x 3 pixels."""
    content = {
        "sequence": np.array(["near", "far"]),
        "start": np.array([0, 2, 5]),
        "height_width": np.array([1, 3]),
        "mask_bits": np.packbits(np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 1, 1]], np.uint8), axis=1),
        "camera_back": np.array([0.0, 0.25, 0.0, 0.5, 1.0]),
        "depth": np.array([1.0, 1.25, 2.0, 2.5, 3.0]),
    }
    np.savez(path, **content | changes)
    return list(read_sequences(path))


def test_masks_may_be_a_pixel_high_and_sequences_a_view_long(tmp_path):
    near, far = small_set(tmp_path / "a.npz")
    assert (near.name, far.name) == ("near", "far")
    np.testing.assert_array_equal(near.masks, [[[1, 0, 0]], [[0, 1, 0]]])
    np.testing.assert_array_equal(far.masks, [[[0, 0, 1]], [[1, 1, 0]], [[1, 1, 1]]])
    assert (near.depth.tolist(), far.depth.tolist()) == ([1.0, 1.25], [2.0, 2.5, 3.0])
    assert (near.camera_back.tolist(), far.camera_back.tolist()) == ([0.0, 0.25], [0.0, 0.5, 1.0])
    one, four = small_set(tmp_path / "b.npz", start=np.array([0, 1, 5]), height_width=np.array([3, 1]))
    assert (one.masks.shape, four.masks.shape) == ((1, 3, 1), (4, 3, 1))


@pytest.mark.parametrize(
    "changes",
    [
        {"height_width": np.array([0, 3])},
        {"height_width": np.array([3, 0])},
        {"start": np.array([1, 2, 5])},
        {"start": np.array([0, 0, 5])},
        {"start": np.array([0, 5, 4])},
        {"mask_bits": np.zeros((5, 1), np.uint16)},
        {"mask_bits": np.zeros((5, 2), np.uint8)},
        {"height_width": np.array([3, 3])},  # 9 bits are two bytes
        {"camera_back": np.zeros(4)},
        {"camera_back": np.array([0.0, np.nan, 0.0, 0.5, 1.0])},
    ],
)
def test_arrays_that_do_not_fit_together(tmp_path, changes):
    with pytest.raises(DenseVSError, match=r"a\.npz is damaged"):
        small_set(tmp_path / "a.npz", **changes)


@pytest.mark.parametrize(
    ("estimate", "truth", "failure", "error"),
    [(2.5, 2.0, "", 0.25), (1.5, 2.0, "", 0.25), (2.0, 2.0, "", 0.0), (np.nan, 2.0, "no depth", 1.0)],
)
def test_an_error_is_a_share_of_the_truth(estimate, truth, failure, error):
    assert ExampleResult("one", (0,), estimate, truth, failure, False).relative_error == error


@pytest.mark.parametrize(
    ("interval", "within"),
    [((1.0, 3.0), True), ((2.0, 3.0), True), ((1.0, 2.0), True), ((2.1, 3.0), False), ((1.0, 1.9), False)],
)
def test_an_example_is_scored_where_the_camera_is_nearest(monkeypatch, interval, within):
    """Its truth is that of the nearest of its views, wherever that stands among them."""
    sequence = Sequence("one", np.zeros((4, 5, 7), np.uint8), np.array([0.0, 2.0, 1.0, 3.0]), np.array([9.0, 3, 2, 4]))

    def depth(regions, back, image_size, method):
        assert (regions, back.tolist(), image_size) == (["b", "c", "d"], [2.0, 1.0, 3.0], (5, 7))
        return SimpleNamespace(distance=2.5, interval=interval)

    monkeypatch.setattr(odms, "depth_from_regions", depth)
    found = odms._score(["a", "b", "c", "d"], sequence, np.array([1, 2, 3]), (5, 7), "robust")
    assert found == ExampleResult("one", (1, 2, 3), 2.5, 2.0, "", within)


def test_robot_sequences_of_other_lengths():
    assert example_views("robot", 9) == []
    assert [views.tolist() for views in example_views("robot", 10)] == [list(range(10))]
    assert len(example_views("robot", 15)) == 6 + 1
    assert example_views("robot", 15)[-1].tolist() == [0, 1, 3, 4, 6, 7, 9, 10, 12, 14]
    assert [views.tolist() for views in example_views("normal", 10)] == [list(range(10))]
    assert example_views("normal", 11)[0].tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 8, 10]


@recorded
@pytest.mark.parametrize(("name", "sequences"), [("robot", 32), ("driving", 100), ("normal", 200), ("perturb", 200)])
def test_every_recorded_set_is_read(name, sequences):
    first = next(read_sequences(SETS / f"{name}.npz"))
    assert len(first.masks) == len(first.depth) == len(first.camera_back)
    with np.load(SETS / f"{name}.npz") as content:
        assert len(content["sequence"]) == sequences


@pytest.mark.slow
@recorded
def test_the_paper_s_method_has_its_published_score():
    """8.49 % on the set of clean simulated masks, as the data's description says."""
    examples = [score_sequence("normal", one, ("vos-de",))["vos-de"][0] for one in read_sequences(SETS / "normal.npz")]
    assert len(examples) == 200
    assert 100 * np.mean([example.relative_error for example in examples]) == pytest.approx(8.49, abs=0.02)


@pytest.mark.slow
@recorded
def test_the_object_is_followed_through_real_clutter():
    """Four of the 32 robot sequences, as the whole set takes too long here."""
    errors = {"vos-de": [], "robust": []}
    for index, sequence in enumerate(read_sequences(SETS / "robot.npz")):
        if index not in (1, 11, 23, 31):
            continue
        short = type(sequence)(sequence.name, sequence.masks[::2], sequence.camera_back[::2], sequence.depth[::2])
        for method, examples in score_sequence("robot", short, ("vos-de", "robust")).items():
            errors[method] += [example.relative_error for example in examples]
    assert np.mean(errors["robust"]) < 0.16
    assert np.mean(errors["robust"]) < 0.5 * np.mean(errors["vos-de"])
