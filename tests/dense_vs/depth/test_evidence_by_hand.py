"""What the views of an approach say in all: which of them count, and the answer for the nearest one, by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.depth import evidence as evidence_module
from dense_vs.depth.evidence import Evidence, gather_evidence
from dense_vs.depth.scale_posterior import DistancePosterior
from dense_vs.errors import DenseVSError


def region(name, border=False, widths=(8.0, 40.0)):
    return SimpleNamespace(name=name, touches_border=border, widths=np.array(widths))


def evidence(offset=0.1, order=(2, 0, 3), back=(0.0, 0.2, 0.5), widths=(8.0, 40.0)):
    regions = tuple(region(k, widths=widths) for k in range(4))
    return Evidence(tuple(regions[k] for k in order), np.array(back), np.array(order), (48, 64), offset, regions)


def posterior(low=0.9, high=1.3, spread=0.2):
    """Of quantiles and of a deviation that are told."""
    return SimpleNamespace(view_weight=np.array([1.0, 0.5, 0.25]), log_std=lambda: spread,
                           quantile=lambda share: {0.16: low, 0.84: high}[share])  # fmt: skip


def test_the_answer_is_for_the_nearest_view_of_all():
    found = evidence().result(posterior(), "robust", 1.0)
    assert found.distance == pytest.approx(0.9)
    assert found.interval == pytest.approx((0.8, 1.2))
    assert found.log_std == pytest.approx(0.2 / 0.9)  # the same error of a shorter way
    assert found.used.tolist() == [True, False, True, True]
    assert found.weight.tolist() == [0.5, 0.0, 1.0, 0.25]
    assert found.observable
    assert found.method == "robust"
    assert [one.name for one in found.regions] == [0, 1, 2, 3]


def test_the_nearest_view_is_in_front_of_the_object():
    """By a twentieth of the distance at least, whatever farther views say."""
    found = evidence(offset=0.99).result(posterior(0.98, 1.01, 0.01), "robust", 1.0)
    assert found.distance == pytest.approx(0.05)
    assert found.interval == pytest.approx((0.05, 0.05))
    assert found.log_std == pytest.approx(0.01 / 0.05)
    assert evidence(offset=0.94).result(posterior(0.96, 1.04), "robust", 1.0).distance == pytest.approx(0.06)
    far = evidence(offset=0.94).result(posterior(0.96, 1.04), "robust", 1.0)
    assert far.interval == pytest.approx((0.05, 0.1))


@pytest.mark.parametrize(("spread", "width", "told"), [(0.449, 9.1, True), (0.451, 9.1, False), (0.449, 8.9, False)])
def test_a_distance_is_told_to_a_half_and_by_three_pixels_of_growth(spread, width, told):
    """Over 0.5 m of 1 m and 0.5 m the object grows by a third; the nearest view is 0.1 m nearer."""
    found = evidence(widths=(1.0, width)).result(posterior(spread=spread), "robust", 1.0)
    assert found.observable == told


def test_growth_of_exactly_three_pixels_counts():
    assert evidence(offset=0.0, back=(0.0, 0.5, 1.0), widths=(6.0,)).result(posterior(), "robust", 1.0).observable


def test_the_posterior_is_of_what_is_used(monkeypatch):
    asked = []
    monkeypatch.setattr(evidence_module, "distance_posterior", lambda *given: asked.append(given) or "posterior")
    one = evidence()
    assert one.posterior("model") == "posterior"
    assert asked == [(one.shapes, one.camera_back, (48, 64), "model")]


@pytest.fixture
def gathered(monkeypatch):
    def run(back, found):
        """Regions as they are followed, nearest first; "-" is none, "c" is cut by the border."""
        asked = []

        def follow(views, ascending, size):
            asked.append((views, ascending, size))
            made = [None if one == "-" else region(k, one == "c") for k, one in enumerate(found)]
            return made

        monkeypatch.setattr(evidence_module, "follow_region", follow)
        return gather_evidence([f"view {k}" for k in range(len(back))], np.array(back), (48, 64)), asked

    return run


def test_views_are_followed_from_the_nearest_on(gathered):
    found, asked = gathered([0.7, 0.2, 0.4, 0.9], "wwww")
    assert asked[0][0] == ["view 1", "view 2", "view 0", "view 3"]
    np.testing.assert_allclose(asked[0][1], [0.0, 0.2, 0.5, 0.7])
    assert asked[0][2] == (48, 64)
    assert found.order.tolist() == [1, 2, 0, 3]
    np.testing.assert_allclose(found.camera_back, [0.0, 0.2, 0.5, 0.7])
    assert found.nearest_offset == 0.0
    assert [one.name for one in found.regions] == [2, 0, 1, 3]
    assert [one.name for one in found.shapes] == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("found", "kept", "offset"),
    [
        ("cwww", [1, 2, 3], 0.1), ("-cwww", [2, 3, 4], 0.3), ("cwcw", [0, 1, 2, 3], 0.0), ("ww--", [0, 1], 0.0),
        ("w-ww", [0, 2, 3], 0.0), ("-ccw", [1, 2, 3], 0.1),
    ],
)  # fmt: skip
def test_views_that_the_border_cuts_are_left_out_where_three_are_whole(gathered, found, kept, offset):
    back = [0.0, 0.1, 0.3, 0.6, 1.0][: len(found)]
    one, _ = gathered(back, found)
    assert one.order.tolist() == kept
    assert one.nearest_offset == pytest.approx(offset)
    np.testing.assert_allclose(one.camera_back, np.array(back)[kept] - offset)
    assert [region is None for region in one.regions] == [letter == "-" for letter in found]


def test_whole_views_from_one_place_are_not_enough(gathered):
    one, _ = gathered([0.0, 0.0, 0.0, 0.5], "wwwc")
    assert one.order.tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize(("back", "found"), [([0.0, 0.1], "w-"), ([0.3, 0.3], "ww"), ([0.0, 0.1], "--")])
def test_what_tells_no_distance(gathered, back, found):
    with pytest.raises(DenseVSError):
        gathered(back, found)


def test_quantiles_and_deviation_of_a_posterior():
    distance = np.array([1.0, 2.0, 4.0])
    one = DistancePosterior(distance, np.array([0.25, 0.5, 0.25]), np.ones(2))
    assert one.log_std() == pytest.approx(np.log(2) * np.sqrt(0.5))
