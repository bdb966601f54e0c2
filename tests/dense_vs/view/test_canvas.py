"""Figures come out as pictures; without Matplotlib there is one clear error."""

import sys

import cv2
import pytest

from dense_vs import DenseVSError
from dense_vs.view.canvas import new_figure, save_figure


def test_a_figure_has_its_size(tmp_path):
    pytest.importorskip("matplotlib", reason="plots need Matplotlib")
    figure = new_figure(4, 3)
    figure.subplots().plot([0, 1], [1, 0])
    save_figure(figure, tmp_path / "figure.png", 50)
    picture = cv2.imread(str(tmp_path / "figure.png"))
    assert picture.shape == (150, 200, 3)
    assert picture.std() > 5


def test_without_matplotlib(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(DenseVSError, match="pip install 'dense-vs"):
        new_figure(4, 3)
