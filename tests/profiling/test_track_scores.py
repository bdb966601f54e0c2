"""Scores of a segmenter that follows an object, on images made by hand."""

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import readme_tracking
import results_file
import tracking
from track_scores import ImageScore, image_score, mask_metrics, time_metrics, track_metrics


def mask(first, last):
    """The columns from first to last of 10 x 10 pixels."""
    pixels = np.zeros((10, 10), dtype=bool)
    pixels[:, first:last] = True
    return pixels


def values(metrics):
    return {metric.name: metric.value for metric in metrics}


def scored(shown=100, masked=100, overlap=0.9, cpu=0.02, wall=0.01, *, everywhere=False, doubted=False):
    return ImageScore(shown, masked, overlap, cpu, wall, everywhere, doubted)


@pytest.mark.parametrize(
    ("found", "true", "shown", "masked", "overlap"),
    [
        (mask(0, 4), mask(2, 6), 40, 40, 1 / 3),
        (mask(0, 4), mask(0, 4), 40, 40, 1.0),
        (mask(0, 4), mask(5, 6), 10, 40, 0.0),
        (mask(0, 0), mask(5, 6), 10, 0, 0.0),
        (mask(0, 1), mask(0, 0), 0, 10, 0.0),
        (mask(0, 0), mask(0, 0), 0, 0, 1.0),
    ],
)
def test_an_image_is_scored(found, true, shown, masked, overlap):
    one = image_score(found, true, 0.03, 0.02, everywhere=False, doubted=False)
    assert (one.shown, one.masked, one.cpu_s, one.wall_s) == (shown, masked, 0.03, 0.02)
    assert one.overlap == pytest.approx(overlap)


def test_only_a_look_at_the_whole_image_comes_of_doubt():
    for everywhere, doubted, counts in ((True, True, True), (True, False, False), (False, True, False)):
        one = image_score(mask(0, 4), mask(0, 4), 0, 0, everywhere=everywhere, doubted=doubted)
        assert (one.everywhere, one.doubted) == (everywhere, counts)


def test_masks_are_told_apart_by_what_the_image_shows():
    images = [
        scored(overlap=1.0),
        scored(overlap=0.5),  # not below
        scored(overlap=0.49),
        scored(shown=30, overlap=0.01),  # the least that counts
        scored(shown=29, overlap=0.0),  # in neither
        scored(shown=1, overlap=0.0),
        scored(shown=0, masked=0, overlap=1.0),
        scored(shown=0, masked=1, overlap=0.0),
        scored(shown=0, masked=0, overlap=1.0),
        scored(shown=0, masked=0, overlap=1.0),
    ]
    assert values(mask_metrics("kind", images)) == {
        "kind: mean IoU": pytest.approx(0.5),
        "kind: images with IoU below 0.5": 0.5,
        "kind: images without the object that have a mask": 0.25,
    }
    assert len(mask_metrics("kind", images[:6])) == 2
    overlap, wrong, false = mask_metrics("kind", images)
    assert [(one.better, one.tolerance) for one in (overlap, wrong, false)] == [
        ("higher", 0.03),
        ("lower", 0.1),
        ("lower", 0.1),
    ]


def test_times_are_percentiles_in_ms():
    images = [scored(cpu=0.001 * k, wall=0.002 * k) for k in range(101)]
    assert values(time_metrics("kind", images)) == {
        "kind: CPU, median [ms]": pytest.approx(50),
        "kind: CPU, 99th percentile [ms]": pytest.approx(99),
        "kind: until the mask, median [ms]": pytest.approx(100),
        "kind: until the mask, 99th percentile [ms]": pytest.approx(198),
    }
    assert all((one.unit, one.better, one.tolerance) == ("ms", "lower", 0.2) for one in time_metrics("kind", images))
    assert time_metrics("kind", []) == []


def test_both_ways_and_the_share_of_doubt():
    tracked = [
        scored(overlap=0.8, cpu=0.01),
        scored(overlap=0.8, cpu=0.02),
        scored(overlap=0.4, cpu=0.09, everywhere=True, doubted=True),
        scored(overlap=0.8, cpu=0.05, everywhere=True),
    ]
    found = values(track_metrics(tracked, [scored(overlap=0.7, cpu=0.06)]))
    assert found["tracking: mean IoU"] == pytest.approx(0.7)
    assert found["anew: mean IoU"] == pytest.approx(0.7)
    assert found["tracking: images with IoU below 0.5"] == 0.25
    assert found["anew: images with IoU below 0.5"] == 0.0
    assert found["tracking: images whose window was doubted"] == 0.25
    assert found["tracking: images looked at as a whole"] == 0.5
    assert found["tracking, all images: CPU, median [ms]"] == pytest.approx(35)
    assert found["tracking, window: CPU, median [ms]"] == pytest.approx(15)
    assert found["tracking, doubted: CPU, median [ms]"] == pytest.approx(90)
    assert found["anew: CPU, median [ms]"] == pytest.approx(60)


def test_the_camera_s_way_has_a_jump_and_a_look_elsewhere():
    way = tracking.path(np.array([0.03, -0.05]), 40)
    assert way.shape == (40, 2)
    length = np.linalg.norm(np.diff(np.vstack([[0.03, -0.05], way]), axis=0), axis=1)
    steady = np.delete(length, [12, 25, 28])
    np.testing.assert_allclose(steady, 0.01, rtol=1e-9)
    assert 0.09 <= length[12] <= 0.11
    assert np.linalg.norm(way[12]) < np.linalg.norm(way[11]) + 0.11
    np.testing.assert_allclose(way[[25, 26, 27], 1] - way[[24, 24, 24], 1], 1.0, atol=0.04)
    assert np.abs(np.delete(way, [25, 26, 27], axis=0)).max() < 0.25


class Remembered:
    """A segmenter that says what it is asked."""

    def __init__(self):
        self.resets, self.everywhere, self.doubt = 0, True, None

    def reset(self):
        self.resets += 1

    def segment(self, image):
        return image


def test_only_who_forgets_is_reset():
    segmenter = Remembered()
    one = tracking.ask(segmenter, mask(0, 4), mask(2, 6))
    assert (segmenter.resets, one.everywhere, one.doubted) == (0, True, False)
    assert one.overlap == pytest.approx(1 / 3)
    assert one.wall_s >= 0
    assert one.cpu_s >= 0
    segmenter.doubt = "something"
    assert tracking.ask(segmenter, mask(0, 4), mask(2, 6), forget=True).doubted
    assert segmenter.resets == 1


def test_times_are_those_between_the_image_and_its_mask(monkeypatch):
    cpu, wall = iter([10.0, 10.5]), iter([20.0, 20.25])
    clock = SimpleNamespace(process_time=lambda: next(cpu), perf_counter=lambda: next(wall))
    monkeypatch.setattr(tracking, "time", clock)
    one = tracking.ask(Remembered(), mask(0, 4), mask(2, 6))
    assert (one.cpu_s, one.wall_s) == (0.5, 0.25)


def test_what_passes_by_is_shown_with_its_own_truth_and_nothing_where_it_is_away(monkeypatch):
    """The world shows its number of postures; the object is in the first two images."""
    placed, stood, ways = {}, [], []

    def path(start, count):
        ways.append((np.abs(start).max(), count))
        return np.array([[0.1, 0.2], [0.3, -0.4], [-0.5, 0.6]])[:count]

    monkeypatch.setattr(tracking, "above", lambda x, y, height: (x, y, height))
    monkeypatch.setattr(tracking, "path", path)
    world = SimpleNamespace(
        objects={"Mug": SimpleNamespace(links=0), "Plastic Chain": SimpleNamespace(links=9)},
        place=lambda name, place, turn: placed.update({name: place}),
        lay_chain=lambda name, place, rng: placed.update({name: place}),
        set_posture=stood.append,
        image=lambda camera: (camera, "image", len(stood)),
        true_mask=lambda camera, name: mask(0, 4) if len(stood) < 3 else mask(0, 0),
    )
    found = list(tracking.passing(world, "Mug", 3, np.random.default_rng(0)))
    assert [image for image, _ in found] == [("grasp", "image", number) for number in (1, 2, 3)]
    for (_, true), shown in zip(found, (40, 40, 0), strict=True):
        assert true.sum() == shown
    x, y, z = tracking.SUPPORTS[1]
    offsets = np.array([[0.1, 0.2, 0.75], [0.3, -0.4, 0.747], [-0.5, 0.6, 0.744]])  # slowly nearer
    np.testing.assert_allclose(stood, offsets + np.array([x, y, 0.0]))
    ((off, count),) = ways
    assert 0 < off <= 0.06
    assert count == 3
    assert placed.pop("Mug") == (x, y, z)
    assert sorted(placed.values()) == [(x, y - 0.16, z), (x, y + 0.16, z)]  # two others beside it
    assert set(placed) < set(tracking.BESIDE)
    list(tracking.passing(world, "Plastic Chain", 1, np.random.default_rng(0)))
    assert placed["Plastic Chain"] == (x, y, z)


def test_the_first_image_has_nothing_before_it_and_is_in_no_score(monkeypatch):
    """Three images an object, of which the first shows all; who forgets marks what who follows does not."""
    reported, made = {}, []

    class Segmenter(Remembered):
        def __init__(self, seed):
            super().__init__()
            made.append(self)

        def fit(self, images, masks):
            return self

        def segment(self, image):
            return ~image if self.resets else image

    def passing(world, name, count, rng):
        assert count == 3
        yield mask(0, 10), mask(0, 10)
        yield mask(0, 4), mask(2, 6)
        yield mask(0, 4), mask(0, 0)

    def track_metrics(tracked, anew):
        reported.update(tracked=tracked, anew=anew)
        return "metrics"

    world = SimpleNamespace(store=lambda: None)
    monkeypatch.setattr(tracking, "MobileWorld", lambda *_, **__: world)
    monkeypatch.setattr(tracking, "annotate", lambda *_: SimpleNamespace(images=[], masks=[]))
    monkeypatch.setattr(tracking, "FewShotSegmenter", Segmenter)
    monkeypatch.setattr(tracking, "passing", passing)
    monkeypatch.setattr(tracking, "track_metrics", track_metrics)
    monkeypatch.setattr(tracking, "report", lambda metrics, _: 5 if metrics == "metrics" else 0)
    monkeypatch.setattr(sys, "argv", ["tracking.py", "--objects", "Mug", "Tuna", "--images", "3"])
    assert tracking.main() == 5
    shown = {name: [(one.shown, one.masked) for one in images] for name, images in reported.items()}
    assert shown == {"tracked": [(40, 40), (0, 40)] * 2, "anew": [(40, 60), (0, 60)] * 2}
    assert [one.resets for one in made] == [0, 0]  # the one that forgets is a copy


def test_lines_are_of_a_result_that_is_there(tmp_path, monkeypatch):
    monkeypatch.setattr(results_file, "RESULTS", tmp_path)
    monkeypatch.setattr(results_file, "OPTIONAL", frozenset({"tracking"}))
    assert readme_tracking.tracking_lines() == []
    assert readme_tracking.few_tracking_lines() == []
    tracked = [scored(overlap=0.8, cpu=0.02), scored(overlap=0.4, cpu=0.02, everywhere=True, doubted=True)]
    metrics = [vars(metric) for metric in track_metrics(tracked, [scored(overlap=0.7, cpu=0.06, wall=0.03)])]
    content = {"metrics": metrics, "machine": {"cores": 2}, "date": "2026-01-02T03", "commit": "abc"}
    (tmp_path / "tracking.json").write_text(json.dumps(content))
    (line, empty) = readme_tracking.tracking_lines()
    assert empty == ""
    for part in ("2026-01-02, commit abc", "takes 20 ms of CPU", "60 and 30 ms", "0.600 (anew 0.700)", "50.0% of the"):
        assert part in line
    assert readme_tracking.few_tracking_lines()[0].endswith("| 20 / 20; 0.60 |")
