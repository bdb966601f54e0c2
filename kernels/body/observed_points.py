"""What was seen of points of a body, as the kernels that compare it with a chain take it."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class ObservedPoints:
    """O places in which M points on links were seen, and the links' poses in the T images.

    Points come one after another, each with its places side by side, so what belongs to a point stays in the cache.

    Attributes:
        starts: ``(M + 1,)``; those of point m are the places ``starts[m]`` to ``starts[m + 1]``.
        link_of: ``(M,)`` that the points are on.
        images: ``(O,)`` that each was seen in.
        places: ``(O,)`` [px].
        directions: ``(O,)``, what errors are multiplied by.
        rotation, translation: ``(T, links)``, of home positions into the camera's frame.
    """

    starts: wp.array(dtype=int)
    link_of: wp.array(dtype=int)
    images: wp.array(dtype=int)
    places: wp.array(dtype=wp.vec2d)
    directions: wp.array(dtype=wp.mat22d)
    rotation: wp.array2d(dtype=wp.mat33d)
    translation: wp.array2d(dtype=wp.vec3d)
