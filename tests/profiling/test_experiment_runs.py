"""Which run of an experiment replaces which, and what tells sections of a page apart."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import experiments
import paper_pages
import readme_experiments

TRIAL = {"paper": "vosvs", "experiment": "trial", "seeds": [501]}
BEFORE = {"method": "robust", "threads": 1, "device": "auto"}  # what a run could say before there were difficulties
NOW = {**BEFORE, "difficulty": "clean", "mask_seconds": None, "objects": None, "jobs": 4}


@pytest.mark.parametrize(
    ("arguments", "replaces"),
    [
        (NOW, True),
        ({**NOW, "jobs": 1, "threads": 2}, True),
        ({**NOW, "difficulty": "hard"}, False),
        ({**NOW, "mask_seconds": 0.1}, False),
        ({**NOW, "objects": ["Mug"]}, False),
        ({**NOW, "method": "vos-de"}, False),
    ],
)
def test_a_clean_trial_replaces_one_of_before(arguments, replaces):
    old, new = {**TRIAL, "arguments": BEFORE}, {**TRIAL, "arguments": arguments}
    assert experiments._replaces(new, old) is replaces
    assert not experiments._replaces({**new, "seeds": [502]}, old)


def run(name, seed, arguments):
    row = {"name": name, "paper": 20, "ours": seed, "unit": "", "seeds": [seed]}
    return {"paper": "vosvs", "experiment": "trial", "seeds": [seed], "arguments": arguments, "rows": [row]}


def test_difficulties_have_sections_of_their_own():
    hard = {**NOW, "difficulty": "hard"}
    page = paper_pages.page_tables([run("VS", 1, BEFORE), run("VS", 2, NOW), run("VS", 3, hard), run("VS", 4, hard)])
    clean, others = page.split("### trial: hard")
    assert "### trial: clean" in clean
    assert "`dense-vs reproduce vosvs trial --difficulty clean`" in clean
    assert "| VS | 20 | 1 | 2 |" in clean
    assert "`dense-vs reproduce vosvs trial`" in others
    assert "| VS | 20 | 3 | 4 |" in others


def test_lines_are_of_one_difficulty():
    hard, clean = readme_experiments.HARD, readme_experiments.CLEAN
    for arguments, of in ((BEFORE, clean), (NOW, clean), ({**NOW, "difficulty": "hard"}, hard)):
        found = [told for told in (hard, clean) if readme_experiments._is_of(run("VS", 1, arguments), "trial", told)]
        assert found == [of]
