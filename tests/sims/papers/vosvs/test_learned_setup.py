"""What an experiment begins with is learned when it is asked for, a few times over, and kept."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.papers.vosvs import learned_setup
from dense_vs.sims.papers.vosvs.jacobian_learning import Update
from dense_vs.sims.papers.vosvs.learned_setup import LearnedSetup, require_cpu


@pytest.fixture
def setup(monkeypatch):
    """A setup whose learning converges as told; what was learned, with what and from which numbers."""
    made = SimpleNamespace(options=None, stored=0, masks=[], learned=[], ends=[])

    def world(objects, **options):
        made.options = (objects, options)
        return SimpleNamespace(store=lambda: setattr(made, "stored", made.stored + 1))

    def masks(world, name, seed):
        made.masks.append((name, seed))
        return f"masks of {name}"

    def learn(world, one, name, segmenter, rng, *, update, looks):
        number = len(made.learned)
        made.learned.append((one.name, name, segmenter, update, looks, rng.normal()))
        return SimpleNamespace(converged=made.ends.pop(0), pinv=number)

    monkeypatch.setattr(learned_setup, "MobileWorld", world)
    monkeypatch.setattr(learned_setup, "learn_segmenter", masks)
    monkeypatch.setattr(learned_setup, "learn_configuration", learn)
    return made


def drawn(*purpose):
    return np.random.default_rng(purpose).normal()


def test_learning_ends_with_the_first_that_converges_and_is_kept(setup):
    ready = LearnedSetup(["Mug"], 7, 2)
    expected = {"seed": 7, "threads": 2, "additions": (), "shadows": False}
    assert setup.options == (["Mug"], expected)
    setup.ends = [False, True]
    assert ready.pinv("head") == 1
    assert ready.pinv("head") == 1
    assert [one[:5] for one in setup.learned] == [("head", "Mug", "masks of Mug", Update.FEATUREWISE, 150)] * 2
    assert [one[5] for one in setup.learned] == [drawn(7, 51, 0), drawn(7, 51, 1)]  # elsewhere each time
    assert setup.stored == 4  # put away before and after
    assert setup.masks == [("Mug", 7)]


def test_what_does_not_converge_three_times_is_an_error(setup):
    ready = LearnedSetup(None, 7)
    setup.ends = [False, False, False, True]
    with pytest.raises(DenseVSError, match="'base' was not learned in 3 times 150 looks"):
        ready.pinv("base")
    assert ready.learning("base").pinv == 2  # the last of them
    assert [one[1] for one in setup.learned] == ["Plastic Chain"] * 3


def test_each_configuration_and_update_is_learned_with_its_own_object(setup):
    ready = LearnedSetup(None, 7)
    setup.ends = [True] * 4
    found = [ready.learning("base"), ready.learning("base", Update.PRINTED), ready.learning("base grasp")]
    assert [one.pinv for one in found] == [0, 1, 2]
    assert ready.learning("base", Update.PRINTED) is found[1]
    assert [(one[1], one[3]) for one in setup.learned] == [
        ("Plastic Chain", Update.FEATUREWISE),
        ("Plastic Chain", Update.PRINTED),
        ("Tuna", Update.FEATUREWISE),
    ]
    assert ready.segmenter("Tuna") == "masks of Tuna"
    assert setup.masks == [("Plastic Chain", 7), ("Tuna", 7)]  # once each


def test_only_the_cpu_will_do():
    for device in ("auto", "cpu"):
        require_cpu(device)
    for device in ("cuda", "cuda:0", ""):
        with pytest.raises(DenseVSError, match="expected 'cpu' or 'auto'"):
            require_cpu(device)
