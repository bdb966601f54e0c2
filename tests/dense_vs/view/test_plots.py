"""The plot of a reach holds as many joints as a robot has, whatever their names."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.view import plots

FRAMES = 30


def trace(joints):
    rng = np.random.default_rng(0)
    points = rng.normal(size=(FRAMES, 2))
    points[:9] = np.nan  # no point while it babbles
    jacobians = rng.normal(size=(2, FRAMES, 2, joints))
    return SimpleNamespace(
        times=np.arange(FRAMES) / 30, points=points, true_points=points + 0.1, targets=points * 0,
        estimated=jacobians[0], true=jacobians[1],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("names", "rows"),
    [
        (["base", "shoulder", "elbow"], 1),
        ([f"robot0:{n}_a_joint_of_an_arm" for n in range(7)], 3),
        (["a_joint_" * 20, "other"], 2),
    ],
)
def test_panels_keep_their_width_and_every_joint_is_named_inside_the_figure(names, rows, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib", reason="plots need Matplotlib")
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    kept = []
    monkeypatch.setattr(plots, "save_figure", lambda figure, path: kept.append(figure))
    plots.plot_reach(trace(len(names)), names, tmp_path / "reach.png")
    (figure,) = kept
    FigureCanvasAgg(figure).draw()
    for axes in figure.axes:
        assert axes.get_position().width > 0.85
        assert axes.get_position().height > 0.12
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == names
    colors = [line.get_color() for line in legend.get_lines()]
    assert colors == [f"C{n}" for n in range(len(names))]
    assert len({round(text.get_window_extent().y0) for text in legend.get_texts()}) == rows
    if len(max(names, key=len)) < 99:
        inside = legend.get_window_extent().transformed(figure.transFigure.inverted())
        assert min(inside.x0, inside.y0) >= 0
        assert max(inside.x1, inside.y1) <= 1
