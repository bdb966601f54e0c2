"""Which joint is tried as a slide, how long, and which trial is taken: fits that explain what they are told to."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.body_model import joint_kinds
from dense_vs.body_model.chain import BACKGROUND, Chain
from dense_vs.body_model.joint_kinds import _best, _settled, _tried_as_slide, as_slide, with_slides

PARENTS = np.array([-1, 0, 1, -1])
LINKS = np.array([0, 0, 1, 1, 2, 2, 3, 3, BACKGROUND])


def chain(slides=()):
    axes = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.6, 0.8]])
    travel = np.zeros((4, 3))
    for n in slides:
        axes[n], travel[n] = 0.0, [0.1, 0.0, 0.0]
    return Chain(axes, np.arange(12.0).reshape(4, 3), np.zeros(4), PARENTS, travel)


@dataclass
class Fit:
    """A fit whose tracks' errors are told; its slides say which."""

    slides: tuple = ()
    cost: float = 0.01
    error: float = 0.3
    costs: np.ndarray = field(default_factory=lambda: np.full(9, 0.1))
    name: str = "found"

    @property
    def state(self):
        return SimpleNamespace(chain=chain(self.slides))

    links = LINKS


def test_the_best_trial_explains_most_of_what_its_joint_moves():
    found = Fit(costs=np.arange(1.0, 10.0))
    one, two = Fit(costs=np.full(9, 2.0), name="one"), Fit(costs=np.full(9, 3.0), name="two")
    # Joint 3 moves tracks 6 and 7, joint 1 those of links 1 and 2.
    best, share = _best(found, [(3, one), (1, two)])
    assert (best, share) == (one, pytest.approx(4.0 / (7 + 8)))
    best, share = _best(found, [(1, two), (0, one)])
    assert (best, share) == (one, pytest.approx(12.0 / 21.0))
    assert _best(found, []) == (found, np.inf)
    found.costs[6:8] = 0.0
    assert _best(found, [(3, one)])[1] > 1e9
    alone = Fit()
    alone.links = np.full(9, BACKGROUND)
    assert _best(alone, [(3, one)]) == (alone, np.inf)


@pytest.mark.parametrize(
    ("costs", "taken"),
    [
        ([0.5, 0.486], 0.486),  # less than 3 % is the end, and the better one stays
        ([0.5, 0.51], 0.5), ([0.5, 0.484, 0.4, 0.3899], 0.3899), ([0.5, 0.4, 0.3, 0.2, 0.1, 0.05, 0.01], 0.05),
        ([0.5, 0.48, 0.47], 0.47), ([0.5, 0.48, 0.49], 0.48),
    ],
)  # fmt: skip
def test_a_trial_is_adjusted_until_it_explains_no_more(costs, taken):
    """Six times at most."""
    pending = [Fit(cost=one) for one in costs]
    assert _settled(Fit(), lambda one: pending.pop(0)).cost == taken


def test_a_slide_moves_points_by_their_mean_velocity():
    points = np.random.default_rng(0).normal(size=(5, 3))
    made = as_slide(chain(), 2, points)
    c = chain()
    velocity = np.mean([np.cross(c.axes[2], p - c.points[2]) for p in points], axis=0)
    np.testing.assert_allclose(made.travel[2], velocity)
    assert made.axes[2].tolist() == [0.0] * 3
    np.testing.assert_array_equal(made.axes[[0, 1, 3]], c.axes[[0, 1, 3]])
    np.testing.assert_array_equal(made.travel[[0, 1, 3]], 0.0)
    np.testing.assert_array_equal(as_slide(chain(), 2, points[:0]).travel[2], c.axes[2])
    assert made.slides.tolist() == [False, False, True, False]


@dataclass(frozen=True)
class State:
    chain: Chain


@dataclass(frozen=True)
class Found:
    state: State
    points: np.ndarray
    links: np.ndarray
    believed: np.ndarray


def test_the_slide_is_tried_by_what_it_moves_and_is_believed():
    points, believed = np.random.default_rng(1).normal(size=(9, 3)), np.ones(9, bool)
    believed[4] = False
    found = Found(State(chain()), points, LINKS, believed)
    tried = _tried_as_slide(found, 1)
    moved = [2, 3, 5]  # of links 1 and 2
    np.testing.assert_allclose(tried.state.chain.travel, as_slide(chain(), 1, points[moved]).travel)
    assert found.state.chain.slides.sum() == 0


class Searching:
    """Trials whose glances, costs after adjustment and costs after a restart are told, by the joints that slide."""

    def __init__(self, monkeypatch, glances, adjusted, restarted=None):
        self.glances, self.adjusted, self.restarted = glances, adjusted, restarted or {}
        self.taken, self.begun = [], []
        monkeypatch.setattr(
            joint_kinds, "_tried_as_slide", lambda fit, n: replace(fit, slides=(*fit.slides, n), name="tried")
        )
        monkeypatch.setattr(joint_kinds, "_settled", self.settled)

    def settled(self, trial, take):
        self.taken.append(trial.slides)
        share = self.adjusted.get(trial.slides, 1.0)
        return replace(trial, costs=0.1 * share * np.ones(9), name="settled")

    def glance(self, fit):
        return self.glances.get(fit.slides, 1.0)

    def restart(self, slides):
        self.begun.append(tuple(np.flatnonzero(slides).tolist()))
        return Fit(self.begun[-1], costs=0.1 * self.restarted.get(self.begun[-1], 1.0) * np.ones(9), name="restarted")

    def run(self, found, learned=(True,) * 4, noise=0.1):
        return with_slides(found, np.array(learned), noise, take=None, glance=self.glance, restart=self.restart)


@pytest.mark.parametrize(("share", "slides"), [(0.96, ()), (0.94, (1,))])
def test_a_slide_has_to_explain_clearly_more(monkeypatch, share, slides):
    searching = Searching(monkeypatch, {(1,): 0.5, (2,): 0.7, (1, 2): 0.6, (1, 0): 0.7}, {(1,): share})
    found = Fit()
    best = searching.run(found)
    assert best.slides == slides
    assert (best is found) == (not slides)
    assert searching.taken[:2] == [(1,), (2,)]
    assert len(searching.taken) == (2 if not slides else 4)  # the rest are tried again
    assert searching.begun == []


def test_the_two_most_promising_that_are_not_far_worse_are_adjusted(monkeypatch):
    searching = Searching(monkeypatch, {(): 1.0, (0,): 1.49, (1,): 1.51, (2,): 1.6, (3,): 2.0}, {})
    searching.run(Fit())
    assert searching.taken == [(0,)]
    searching = Searching(monkeypatch, {(): 1.0, (0,): 0.9, (1,): 0.8, (2,): 0.7, (3,): 0.1}, {})
    searching.run(Fit(), learned=(True, True, True, False))
    assert searching.taken == [(2,), (1,)]


@pytest.mark.parametrize(("cost", "error", "again"), [(0.051, 0.21, True), (0.049, 0.21, False), (0.051, 0.19, False)])
def test_a_poor_fit_is_begun_anew_with_two_joints(monkeypatch, cost, error, again):
    """With those that nothing carries, and the most promising ones: above 5 % and twice the noise."""
    glances = {(0,): 0.9, (1,): 0.5, (2,): 0.6, (3,): 0.8}
    searching = Searching(monkeypatch, glances, {})
    found = Fit(cost=cost, error=error)
    assert searching.run(found) is found
    assert searching.begun == ([(0,), (3,)] if again else [])
    searching = Searching(monkeypatch, glances, {}, {(0,): 0.5, (0, 1): 0.96})
    best = searching.run(found)
    assert best.slides == ((0,) if again else ())


def test_where_one_joint_is_carried_by_nothing_the_most_promising_is_begun_too(monkeypatch):
    searching = Searching(monkeypatch, {(0,): 0.9, (1,): 0.6, (2,): 0.5}, {(2,): 0.97})
    found = Fit(cost=0.2, error=9.0)
    assert searching.run(found, learned=(True, True, True, False)) is found
    assert searching.begun == [(0,), (2,)]
    held = Fit((3,), cost=0.2, error=9.0)
    searching = Searching(monkeypatch, {(3, 1): 0.6}, {})
    searching.run(held, learned=(False, True, True, True))
    assert searching.begun == [(1, 3), (2, 3)]  # what slides already goes on doing so
