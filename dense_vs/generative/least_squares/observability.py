"""Which parameters the observations leave open, in words."""

import numpy as np

from dense_vs.generative.least_squares.pixel_problem import PixelProblem, PixelState

NULL = 1e-11  # eigenvalue of the normal matrix with a unit diagonal: below, a direction is open
SHARE = 0.25  # of a null direction that a group must hold to be named


def describe_unobservable(problem: PixelProblem, state: PixelState, offsets_open: bool, still: list[int]) -> list[str]:
    """Names of the parameters that images and states do not determine.

    Args:
        problem: at whose solution.
        state: the solution.
        offsets_open: constant joint offsets are always open, as actions give only differences.
        still: joints, counted from 1, that did not move.

    The scale of all lengths is always open and is not named.
    """
    words = [f"joint {joint} did not move: its axis is unknown" for joint in still]
    taken = (problem.weights > 0).sum(axis=(0, 1))
    for feature, count in enumerate(taken):
        if problem.columns.features[feature] < 0 or count < 2:
            words.append(f"feature {feature} was seen in {count} usable images: its place is unknown")
    equations = problem.linearize(state)
    matrix = equations.shared
    if equations.local is not None:
        return words
    diagonal = matrix.diagonal()
    active = diagonal > 1e-12 * diagonal.max()
    scale = 1 / np.sqrt(diagonal[active])
    values, vectors = np.linalg.eigh(scale[:, None] * matrix[np.ix_(active, active)] * scale)
    open_directions = vectors[:, values < NULL]
    expected = 1 + (problem.kernel.inputs["joints"].shape[2] if offsets_open else 0)
    if open_directions.shape[1] <= expected:
        return words
    held = np.zeros(len(diagonal))
    held[active] = (open_directions**2).sum(axis=1)
    for name, first, width in _groups(problem):
        if held[first : first + width].max(initial=0.0) > SHARE:
            words.append(f"{name} is not determined by these observations")
    return words


def _groups(problem: PixelProblem) -> list[tuple[str, int, int]]:
    columns = problem.columns
    groups = [(f"direction of joint {i + 1}", first, 2) for i, first in enumerate(columns.axes) if first >= 0]
    groups += [(f"place of joint {i + 1}", first, 2) for i, first in enumerate(columns.points) if first >= 0]
    groups += [(f"feature {k}", first, 3) for k, first in enumerate(columns.features) if first >= 0]
    groups += [(f"pose of camera {c}", first, 6) for c, first in enumerate(columns.cameras) if first >= 0]
    groups += [
        (f"intrinsics of camera {c}", first, columns.intrinsics_count)
        for c, first in enumerate(columns.intrinsics)
        if first >= 0
    ]
    return groups
