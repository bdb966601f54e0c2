"""Figures of masks: what is counted, colored and enlarged, on masks made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.sims.papers.vosvs import segmentations
from dense_vs.sims.papers.vosvs.object_trial import ObjectTrial
from dense_vs.sims.papers.vosvs.segmentations import BEYOND, MISSED, SHOWN, Approached, View
from dense_vs.sims.papers.vosvs.trial_scores import DepthScore, ServoScore


def view(mask, true, shape=(120, 160)):
    masks = []
    for top, left, bottom, right in (mask, true):
        one = np.zeros(shape, bool)
        one[top:bottom, left:right] = True
        masks.append(one)
    return View(np.full((*shape, 3), 100, np.uint8), *masks)


def approached(name, centered, graspable, higher, closer):
    return Approached(name, ObjectTrial(name, 0.0, ServoScore(centered), depth=DepthScore(graspable)), higher, closer)


def test_rows_of_both_views():
    half = view((0, 0, 10, 10), (0, 0, 10, 20))
    whole = view((0, 0, 10, 10), (0, 0, 10, 10))
    ones = [approached(name, name != "Plate", name == "Marker", half, whole) for name in SHOWN]
    ones[1] = approached("Power Drill", False, False, None, None)
    rows = {row.name: row for row in segmentations.table_rows({5: ones})}
    assert len(rows) == 16
    assert rows["Plate: mask IoU at the higher view"].ours == 0.5
    assert rows["Plate: mask IoU at the closer view"].ours == 1.0
    assert np.isnan(rows["Power Drill: mask IoU at the closer view"].ours)
    assert [rows[f"{name}: centered (1) or not (0)"].ours for name in SHOWN] == [0, 0, 1, 1]
    assert [rows[f"{name}: depth good (1) or not (0)"].ours for name in SHOWN] == [0, 0, 1, 0]
    assert [rows[f"{name}: depth good (1) or not (0)"].paper for name in SHOWN] == [1, 1, 0, 0]
    assert all(row.paper == 1 for name, row in rows.items() if "centered" in name)


def test_errors_are_colored():
    one = view((40, 40, 80, 80), (40, 60, 80, 120))
    shown = segmentations.errors_shown(one)
    np.testing.assert_allclose(shown[60, 100], 0.35 * 100 + 0.65 * np.array(MISSED), atol=1)
    np.testing.assert_allclose(shown[60, 50], 0.35 * 100 + 0.65 * np.array(BEYOND), atol=1)
    assert (shown[60, 70] == 100).all()  # right
    assert (shown[10, 10] == 100).all()
    assert (one.image == 100).all()


@pytest.mark.parametrize("corner", [(0, 0), (50, 70), (110, 145)])
def test_a_small_object_is_enlarged_and_its_overlap_stays(corner):
    top, left = corner
    one = view((top, left, top + 8, left + 12), (top, left, top + 8, left + 14))
    large = segmentations.enlarged(one)
    assert large.image.shape == one.image.shape
    assert large.true.sum() > 3 * one.true.sum()
    assert large.iou == pytest.approx(one.iou, abs=0.05)


@pytest.mark.parametrize(
    ("box", "columns", "rows"),
    [
        ((60, 40, 64, 104), 160 * 64 / 94.5, 120 * 4 / 70.875),  # one and a half times as wide as the object
        ((20, 60, 85, 64), 160 * 4 / 128, 120 * 65 / 96),  # one and a half times as high
        ((50, 70, 54, 74), 160 * 4 / 80, 120 * 4 / 60),  # of 60 rows at least
    ],
)
def test_a_view_is_enlarged_to_half_as_much_again_as_the_object(box, columns, rows):
    large = segmentations.enlarged(view(box, box))
    assert large.mask.any(axis=0).sum() == pytest.approx(columns, abs=2.1)
    assert large.mask.any(axis=1).sum() == pytest.approx(rows, abs=2.1)
    y, x = np.nonzero(large.mask)
    assert (x.mean(), y.mean()) == pytest.approx((79.5, 59.5), abs=3)  # in the middle


@pytest.mark.parametrize(("corner", "middle"), [((4, 6), (15.5, 11.5)), ((112, 146), (135.5, 107.5))])
def test_an_object_at_the_border_is_enlarged_inside_the_view(corner, middle):
    """60 x 80 pixels from the border on, each twice as large."""
    top, left = corner
    box = (top, left, top + 4, left + 4)
    large = segmentations.enlarged(view(box, box))
    y, x = np.nonzero(large.mask)
    assert (x.mean(), y.mean()) == middle
    assert large.mask.sum() == 4 * 16


def test_what_fills_the_view_stays_as_it_is():
    one = view((0, 0, 120, 160), (0, 0, 120, 150))
    np.testing.assert_array_equal(segmentations.enlarged(one).true, one.true)
    empty = view((0, 0, 0, 0), (0, 0, 0, 0))
    assert segmentations.enlarged(empty) is empty


def test_tiles_have_the_higher_views_above():
    one = view((0, 0, 10, 10), (0, 0, 10, 20))
    tiles = segmentations.picture_tiles(
        [approached("Plate", True, True, one, one), approached("Marker", 1, 1, None, None)]
    )
    assert [label for label, _ in tiles] == [
        "Plate, higher: IoU 0.500",
        "Marker, higher: IoU none",
        "Plate, closer: IoU 0.500",
        "Marker, closer: IoU none",
    ]


def test_first_and_last_view_of_an_approach_are_kept(monkeypatch):
    """With the truth of the moment that each was taken at."""
    trues = [np.full((4, 4), k % 2 == 0) for k in range(3)]
    world = SimpleNamespace(true_mask=lambda camera, name: trues.pop(0))
    half = np.arange(16).reshape(4, 4) % 4 < 2  # of what it is asked for the segmenter finds the left
    inner = SimpleNamespace(segment=lambda image: half.copy(), forgot=[])
    inner.reset = lambda: inner.forgot.append(True)
    witness = segmentations.Witness(world, "Plate", inner)
    witness.reset()
    assert inner.forgot == [True]

    def locate(world, name, support, segmenter, pinv, *, method, settle_frames, on_view):
        assert (name, support, pinv, method, settle_frames) == ("Plate", 0.25, "J+", "robust", 2)
        for number in range(3):
            image = np.full((4, 4, 3), number, np.uint8)
            on_view(number, image, segmenter.segment(image))
        return ObjectTrial(name, support)

    monkeypatch.setattr(segmentations, "locate", locate)
    one = segmentations.approach_one(world, witness, 0.25, "J+", "robust", 2)
    assert one.higher.image[0, 0, 0] == 0
    assert one.closer.image[0, 0, 0] == 2
    assert (one.higher.iou, one.closer.iou) == (0.5, 0.5)
    for seen in (one.higher, one.closer):
        np.testing.assert_array_equal(seen.mask, half)
        assert seen.true.all()
    monkeypatch.setattr(segmentations, "locate", lambda *_, **__: ObjectTrial("Plate", 0.25))
    assert segmentations.approach_one(world, witness, 0.25, "J+", "robust", 2).closer is None


def test_every_object_is_met_in_its_trial(monkeypatch):
    placed, drove, cluttered, met, stood = [], [], [], [], []
    world = SimpleNamespace(set_posture=stood.append)
    monkeypatch.setattr(segmentations, "above", lambda x, y, height: (x, y, height))
    ready = SimpleNamespace(
        world=world,
        seed=4,
        pinv=lambda config: f"J+ of {config}",
        add_clutter=lambda names, rng: cluttered.append(names),
        segmenter=lambda name: SimpleNamespace(segment=None),
    )

    def approach(world, witness, support, pinv, method, settle):
        met.append((witness.name, support, pinv, method, settle))
        return witness.name

    monkeypatch.setattr(segmentations, "place_objects", lambda world, names, rng: placed.append(names))
    monkeypatch.setattr(segmentations, "drive_to", lambda robot, place, rng: drove.append(place[2]))
    monkeypatch.setattr(segmentations, "ManipulatorRobot", lambda world: "robot")
    monkeypatch.setattr(segmentations, "approach_one", approach)
    bar = SimpleNamespace(update=lambda: None, set_description=lambda _: None)
    results = segmentations.approach_all(ready, SimpleNamespace(settle_frames=2), "robust", bar)
    assert results == list(SHOWN)
    assert stood == [(1.0, 0.0, segmentations.HEIGHT)]  # before the first is driven to
    assert [names[0] for names in placed] == ["Plate", "Power Drill", "Power Drill", "Power Drill"]
    assert placed == cluttered
    assert drove == [0.25, 0.25, 0.125, 0.0]
    assert met == [(name, z, "J+ of base", "robust", 2) for name, z in zip(SHOWN, drove, strict=True)]
    assert set(SHOWN) <= set(segmentations.trial_names())
    assert len(segmentations.trial_names()) == 6
