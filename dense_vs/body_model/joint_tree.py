"""The order of the joints, from which points each moves.

What a joint carries moves with it: of two joints, the one that moves all that the other moves, and more, stands before
it. Joints that move nothing in common are branches of their own, as a humanoid's arms. Where the points cannot tell,
as no surface between two joints was seen, they keep the order that they are given in.
"""

import numpy as np

LEAST_SHARE = 0.5  # of a joint's points that the joints before it must move as well
SURE = 0.1  # difference of shares from which the order is taken from the points
LEAST_POINTS = 4  # that a joint must move to be learned


def joint_parents(moved_by: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The tree that explains which joints move M points, bool ``(M, N)``, with gross errors among them.

    Returns:
        ``(N,)`` the joint that carries each joint, -1 for none, and bool ``(N,)``, which joints move enough points to
        be learned; the others carry nothing.
    """
    moved_by = np.asarray(moved_by, dtype=float)
    shared = moved_by.T @ moved_by
    counts = shared.diagonal()
    learned = counts >= LEAST_POINTS
    share = shared / np.maximum(counts, 1)  # [a, b]: of the points that b moves, those that a moves too
    parents = np.full(len(counts), -1)
    placed: list[int] = []
    waiting: list[int] = np.flatnonzero(learned).tolist()
    while waiting:
        # Pair by pair the points may say a before b before c before a. Only joints that are placed carry others, so
        # that the tree has no cycle: the joint with the fewest waiting before it is next, of these the one that moves
        # most.
        ahead = {b: sum(_stands_before(a, b, share) for a in waiting if a != b) for b in waiting}
        b = min(waiting, key=lambda n: (ahead[n], -counts[n], n))
        before = [a for a in placed if _stands_before(a, b, share)]
        if before:
            # The nearest of them is the one that most of the others stand before.
            parents[b] = max(before, key=lambda a: (sum(_stands_before(c, a, share) for c in before if c != a), a))
        placed.append(b)
        waiting.remove(b)
    return parents, learned


def _stands_before(a: int, b: int, share: np.ndarray) -> bool:
    """Whether joint a carries joint b."""
    if max(share[a, b], share[b, a]) < LEAST_SHARE:
        return False
    ahead = share[a, b] - share[b, a]
    return bool(ahead > SURE) if abs(ahead) > SURE else a < b
