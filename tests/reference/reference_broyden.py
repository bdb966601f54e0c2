"""The Hadamard-Broyden update of VOS-VS (11) in plain float64, element by element."""

import numpy as np


def hadamard_broyden(pinv, dq, de, coupling, alpha):
    """J+ after one update; ``coupling`` None is Broyden's own."""
    n, k = pinv.shape
    predicted = [sum(pinv[i, j] * de[j] for j in range(k)) for i in range(n)]
    row = [sum(dq[i] * pinv[i, j] for i in range(n)) for j in range(k)]
    denominator = sum(dq[i] * predicted[i] for i in range(n))
    updated = np.empty((n, k))
    for i in range(n):
        for j in range(k):
            coupled = 1.0 if coupling is None else coupling[i][j]
            updated[i, j] = pinv[i, j] + alpha * coupled * (dq[i] - predicted[i]) * row[j] / denominator
    return updated
