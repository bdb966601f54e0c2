"""Pictures of learning J+: Fig. 8 (ways in the image), Fig. 9 (elements over updates), Fig. 18 (the robot's view)."""

from pathlib import Path
from typing import Any

import numpy as np

from dense_vs.files import atomic_write
from dense_vs.sims.papers.vosvs.pictures import outlined, write_tiles

COLOURS = {"hadamard": "tab:blue", "featurewise": "tab:green", "original": "tab:red"}


def draw_learning(learnt: list[Any], out: Path) -> None:
    """Write ``learn.png`` and ``learn_view.png``."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from dense_vs.sims.papers.vosvs.learn import LABELS
    from dense_vs.sims.papers.vosvs.learning import INITIAL

    figure = Figure(figsize=(2.8 * len(learnt), 11.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(4, len(learnt), squeeze=False)
    for column, one in enumerate(learnt):
        image, elements, apart, others = axes[:, column]
        said: list[str] = []
        for update, outcome in one.outcomes.items():
            state = "" if outcome.converged else ", not converged"
            put_back = f", put back {outcome.restarts}x" if outcome.restarts else ""
            back = f", {outcome.retreats} steps back" if outcome.retreats else ""
            said.append(f"{LABELS[update]}: {outcome.looks} looks{state}{back}{put_back}")
            for number, episode in enumerate(until_converged(outcome.episodes)):
                label = LABELS[update] if number == 0 and column == 0 else None
                image.plot(*episode.centroids.T, ".-", ms=3, lw=1, color=COLOURS[update], label=label, alpha=0.8)
        image.plot(*one.one.target, "k+", ms=12)
        image.set(xlim=(0, 640), ylim=(480, 0), title=f"H {one.one.name}", aspect="equal")
        image.set_xlabel("\n".join(said), fontsize=6)
        for panel, update in ((elements, "hadamard"), (apart, "featurewise"), (others, "original")):
            history = one.outcomes[update].history
            for row, joint in enumerate(one.one.joints):
                for feature in range(2):
                    coupled = one.one.coupling[row, feature] > 0
                    style = {"lw": 1.6 if coupled else 0.8, "ls": "-" if coupled else ":"}
                    line = panel.plot(history[:, row, feature], color=f"C{row}", **style)[0]
                    if coupled:
                        line.set_label(f"{joint} / s_{'xy'[feature]}")
                        panel.axhline(one.true[row, feature], color=f"C{row}", lw=0.8, ls="--")
            reach = 2.5 * np.abs(one.true).max() if np.isfinite(one.true).all() else 5 * INITIAL
            panel.set_ylim(-reach, reach)
            panel.axhline(0.0, color="grey", lw=0.5)
        elements.legend(fontsize=6)
        elements.set_title("J+ by (11); truth dashed", fontsize=8)
        apart.set_title("(11) a feature at a time", fontsize=8)
        others.set_title("original Broyden; H = 0 dotted", fontsize=8)
        others.set_xlabel("updates")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    with atomic_write(out / "learn.png") as stream:
        figure.savefig(stream, format="png", dpi=100)
    base = next((one for one in learnt if one.one.name == "base"), None)
    if base is not None:
        _draw_view(base, out / "learn_view.png")


def until_converged(episodes: list) -> list:
    """The episodes up to the first that ended at the target."""
    from dense_vs.mask_servo.loop import ServoEnd

    for number, episode in enumerate(episodes):
        if episode.end is ServoEnd.CONVERGED:
            return episodes[: number + 1]
    return episodes


def _draw_view(base: Any, path: Path) -> None:
    """Fig. 18: what the camera saw while H_base was learnt, masks outlined, the target marked."""
    frames = []
    for episode in until_converged(base.outcomes["hadamard"].episodes):
        frames += list(zip(episode.images, episode.masks, strict=True))
    chosen = np.unique(np.linspace(0, max(len(frames) - 1, 0), 8).astype(int)) if frames else []
    tiles = [(f"look {number}", outlined(frames[number][0], frames[number][1], base.one.target)) for number in chosen]
    write_tiles(tiles, path)
