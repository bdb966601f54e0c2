"""How likely each cluster of J is part of the robot's body: the evaluation in Algorithm 1 of DIJE.

A cluster inherits the value of the previous cluster whose centre is nearest to its own, changed by how far it has
moved:

    consistency = 1 / sqrt(dist / |centre| + 0.1)        value <- value x 0.1 (consistency - 1) + 1

and the values are normalized to a sum of 1. By the usual precedence this is (value x 0.1 (consistency - 1)) + 1,
which leaves every value near 1 and so near 1 / K after the normalization. Read as a product,
value x (0.1 (consistency - 1) + 1), what is inherited multiplies from run to run until one cluster has nearly
all of it. Both are here; the paper's threshold of 0.2 is 1 / K for its K = 5.

The ratio dist / |centre| is ill-conditioned for a centre near zero, that of a background which J still knows
little about. A centre at zero says that nothing moves there and counts as inconsistent: consistency 0.
"""

from typing import Literal, get_args

import numpy as np

from dense_vs.errors import DenseVSError

Reading = Literal["printed", "product"]


def evaluate_clusters(
    centres: np.ndarray,
    previous_centres: np.ndarray | None,
    previous_evaluation: np.ndarray | None,
    reading: Reading = "printed",
) -> np.ndarray:
    """Values of the clusters, float64 ``(k,)`` that sum to 1; of equal distances the lowest index inherits.

    Args:
        centres: ``(k, 2, N)``.
        previous_centres, previous_evaluation: ``(m, 2, N)`` and ``(m,)`` of the run before; None or empty in the first.
        reading: of the formula.

    Raises:
        DenseVSError: unknown reading.
    """
    if reading not in get_args(Reading):
        raise DenseVSError(f"reading is {reading!r}; expected one of {', '.join(get_args(Reading))}")
    values = np.ones(len(centres))
    if previous_centres is not None and previous_evaluation is not None and len(previous_centres):
        for k, centre in enumerate(centres.astype(np.float64)):
            distances = np.linalg.norm(previous_centres.astype(np.float64) - centre, axis=(1, 2))
            nearest = int(np.argmin(distances))
            size = np.linalg.norm(centre)
            consistency = 1.0 / np.sqrt(distances[nearest] / size + 0.1) if size > 0 else 0.0
            change = 0.1 * (consistency - 1.0)
            inherited = previous_evaluation[nearest]
            values[k] = inherited * (change + 1.0) if reading == "product" else inherited * change + 1.0
    return values / values.sum() if len(values) else values
