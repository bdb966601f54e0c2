"""Clusters of image Jacobians: the assignment of DIJE's Algorithm 2 and the steps of the k-means in its Algorithm 1.

A pixel's vector is its 2 x N image Jacobian, its distance from a centre the Frobenius norm of the difference. Of
centres at the same distance the one of the lowest index is the nearest. A pixel with an entry that is not finite
belongs to no cluster: its index is -1 and no sum holds it.

Sums are made a row at a time, in float64 and in the order of the columns, and the rows are then added in their
order. So the result does not depend on how many threads share the rows.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

wp.set_module_options({"enable_backward": False})

UNASSIGNED = -1


@cache
def kmeans_kernels(joints: int) -> SimpleNamespace:
    """Kernels for images of 2 x ``joints`` Jacobians, with their element type ``Jacobian``.

    ``assign`` is launched over (worlds, H, W); ``sum_rows`` and ``spread_rows`` over (worlds, H, 1), a thread a row;
    ``add_rows`` with a thread a world, cluster and entry.
    """
    Jacobian = wp.types.matrix((2, joints), wp.float32)
    module = f"{__name__}_{joints}"

    @wp.func
    def known(vector: Jacobian) -> bool:
        """Whether all entries are numbers, by the exponents' bits; see ``flow_field.finite``."""
        exponent = int(0x7F800000)
        found = bool(True)
        for i in range(wp.static(joints)):
            x = wp.cast(vector[0, i], int) & exponent
            y = wp.cast(vector[1, i], int) & exponent
            found = found and x != exponent and y != exponent
        return found

    @wp.func
    def squared_distance(a: Jacobian, b: Jacobian) -> float:
        d = a - b
        return wp.ddot(d, d)

    @wp.func
    def nearest(vector: Jacobian, centres: wp.array2d(dtype=Jacobian), world: int, count: int) -> wp.vec2:
        """Index of the nearest of the first ``count`` centres, and the squared distance from it."""
        best = int(0)
        least = squared_distance(vector, centres[world, 0])
        for k in range(1, count):
            distance = squared_distance(vector, centres[world, k])
            if distance < least:
                least = distance
                best = k
        return wp.vec2(float(best), least)

    @wp.kernel(module=module, enable_backward=False)
    def assign(
        row_begin: int,
        column_step: int,
        # In:
        jacobian_in: wp.array3d(dtype=Jacobian),
        centres_in: wp.array2d(dtype=Jacobian),  # (worlds, K)
        count_in: wp.array(dtype=int),  # (worlds,) centres in use
        own_in: wp.array2d(dtype=wp.int8),  # (worlds, K) 1 where the cluster is the robot's own body, else 0
        least_squared: float,  # J not larger than this, squared, tells nothing
        # Out:
        cluster_out: wp.array3d(dtype=wp.int8),
        label_out: wp.array3d(dtype=wp.int8),  # 1 own, 0 not own, -1 unknown
    ):
        """Algorithm 2: the nearest centre of every pixel, and whether its cluster is the robot's own body."""
        world, row, column = wp.tid()
        y = row_begin + row
        count = count_in[world]
        for x in range(column, jacobian_in.shape[2], column_step):
            vector = jacobian_in[world, y, x]
            cluster = wp.int8(-1)
            label = wp.int8(-1)
            if count > 0 and known(vector):
                k = int(nearest(vector, centres_in, world, count)[0])
                cluster = wp.int8(k)
                if wp.ddot(vector, vector) > least_squared:
                    label = own_in[world, k]
            cluster_out[world, y, x] = cluster
            label_out[world, y, x] = label

    @wp.kernel(module=module, enable_backward=False)
    def sum_rows(
        row_begin: int,
        column_step: int,
        # In:
        jacobian_in: wp.array3d(dtype=Jacobian),
        member_in: wp.array3d(dtype=wp.int8),  # (worlds, H, W) pixels that count: those above 0
        centres_in: wp.array2d(dtype=Jacobian),
        count_in: wp.array(dtype=int),
        # Out:
        sums_out: wp.array4d(dtype=wp.float64),  # (worlds, H, K, 2 N + 1): x entries, y entries, number of pixels
        farthest_out: wp.array2d(dtype=wp.vec2),  # (worlds, H): squared distance and column of the farthest pixel
    ):
        """Sum of every cluster's vectors, and the vector farthest from its centre, in each row."""
        world, row, _ = wp.tid()
        y = row_begin + row
        count = count_in[world]
        for k in range(sums_out.shape[2]):
            for i in range(sums_out.shape[3]):
                sums_out[world, y, k, i] = wp.float64(0.0)
        farthest = wp.vec2(-1.0, -1.0)
        for x in range(jacobian_in.shape[2]):
            vector = jacobian_in[world, y, x]
            if member_in[world, y, x] > wp.int8(0) and known(vector):
                found = nearest(vector, centres_in, world, count)
                k = int(found[0])
                for i in range(wp.static(joints)):
                    sums_out[world, y, k, i] += wp.float64(vector[0, i])
                    sums_out[world, y, k, wp.static(joints) + i] += wp.float64(vector[1, i])
                sums_out[world, y, k, wp.static(2 * joints)] += wp.float64(1.0)
                if found[1] > farthest[0]:
                    farthest = wp.vec2(found[1], float(x))
        farthest_out[world, y] = farthest

    @wp.kernel(module=module, enable_backward=False)
    def add_rows(
        # In:
        rows_in: wp.array4d(dtype=wp.float64),  # (worlds, H, K, 2 N + 1)
        # Out:
        sums_out: wp.array3d(dtype=wp.float64),  # (worlds, K, 2 N + 1)
    ):
        """The rows' sums added up in the order of the rows."""
        world, k, i = wp.tid()
        total = wp.float64(0.0)
        for y in range(rows_in.shape[1]):
            total += rows_in[world, y, k, i]
        sums_out[world, k, i] = total

    @wp.kernel(module=module, enable_backward=False)
    def spread_rows(
        row_begin: int,
        column_step: int,
        # In:
        jacobian_in: wp.array3d(dtype=Jacobian),
        member_in: wp.array3d(dtype=wp.int8),
        centres_in: wp.array2d(dtype=Jacobian),
        count_in: wp.array(dtype=int),
        # Out:
        spread_out: wp.array2d(dtype=wp.float64),  # (worlds, H)
    ):
        """Sum of the squared distances from the nearest centre in each row; with no centre, the number of pixels."""
        world, row, _ = wp.tid()
        y = row_begin + row
        count = count_in[world]
        total = wp.float64(0.0)
        for x in range(jacobian_in.shape[2]):
            vector = jacobian_in[world, y, x]
            if member_in[world, y, x] > wp.int8(0) and known(vector):
                if count > 0:
                    total += wp.float64(nearest(vector, centres_in, world, count)[1])
                else:
                    total += wp.float64(1.0)
        spread_out[world, y] = total

    return SimpleNamespace(
        Jacobian=Jacobian, assign=assign, sum_rows=sum_rows, add_rows=add_rows, spread_rows=spread_rows
    )
