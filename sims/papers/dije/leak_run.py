"""What the experiment on DIJE's Fig. 4 brings."""

from dataclasses import dataclass, field

import numpy as np

from dense_vs.sims.papers.dije.labeling import Labeller, View


@dataclass
class LeakRun:
    """What a seed brought.

    Attributes:
        labellers: ``"default"``, and the paper's with either transport, ``"(13)"`` and ``"(14)"``.
        transported: by ``"(13)"`` and ``"(14)"``, after 100 frames: leaked area and lost area, both over the arm's, and
            the share of the walker's pixels that had the body's J, mean over those frames.
        shown, shown_labels: the frame in which most of the walker is seen, and the labels of it.
        transport_view, transport_labels: the last frame of the transport and where J has got to.
    """

    seed: int
    labellers: dict[str, Labeller]
    transported: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    shown: View | None = None
    shown_labels: dict[str, np.ndarray] = field(default_factory=dict)
    transport_view: View | None = None
    transport_labels: dict[str, np.ndarray] = field(default_factory=dict)
