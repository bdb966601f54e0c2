"""Stand-ins for what a loop's body makes: priors, and fits."""

from types import SimpleNamespace

import pytest
from body_stand_ins import body, frame, gray, model

from dense_vs.point_servo import learned_body


@pytest.fixture
def drawn(monkeypatch):
    """Priors that are made, and how the estimator is drawn to them."""
    made = []

    class Prior:
        def __init__(self, known, *, share, least_agreement, corrected, moved, blended):
            self.given, self.asked, self.begun = (known, share, least_agreement), (corrected, moved, blended), []
            self.agrees, self.agreement = True, 1.0
            made.append(self)

        def begin(self, *given):
            self.begun.append(given)

    monkeypatch.setattr(learned_body, "BodyPrior", Prior)
    watch = SimpleNamespace(doubts="", latest=[], see=lambda gray, positions: None)
    monkeypatch.setattr(learned_body, "BodyWatch", lambda model, history: watch)
    return made


@pytest.fixture
def learning(monkeypatch, drawn):
    """A body whose fits give a model, and the calls of the fit."""
    calls = []
    result = {"model": model(), "explained": 0.6, "alike": 0.9}

    def fit(images, joints, *, track_options, fit_options, dense):
        calls.append((images, joints, track_options.stride))
        result["dense"], result["slides"] = dense, fit_options.slides
        result.setdefault("begun", []).append((fit_options.seed, fit_options.starts))
        if isinstance(result["model"], Exception):
            raise result["model"]
        return result["model"]

    monkeypatch.setattr(learned_body, "BodyModel", type("Stand", (), {"fit": staticmethod(fit)}))
    monkeypatch.setattr(learned_body, "explained_share", lambda *given: calls.append(given) or result["explained"])
    monkeypatch.setattr(learned_body, "likeness", lambda one, images: result.update(judged=images) or result["alike"])
    one = body()
    for k in range(200):
        one.see(frame(gray(k)))
    return one, calls, result, drawn
