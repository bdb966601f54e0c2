"""How an image of small matrices lies in memory, and how a pixel's is read, written and sampled.

``"matrices"``: a pixel's (2, C) matrix is one element of a (worlds, H, W) array. A CPU walks a row and finds
all of a pixel in one cache line.

``"planes"``: the 2 C numbers of a pixel, row after row, are cut into groups of 4 (of 2 where 4 does not divide them),
and each group is an image of its own: (worlds groups, H, W) of vectors, group g of world w being image
w groups + g. Neighboring threads of a GPU then read neighboring addresses, 16 bytes each by one instruction. Warp
does not promise the compiler that its vectors are aligned, so the accesses are written in CUDA; that of a CPU is the
plain one.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any, Literal

import warp as wp

from dense_vs.kernels.image.bilinear import Taps, bilinear

Layout = Literal["matrices", "planes"]

# The offset within a plane is a 32-bit number that the groups of a pixel share, the plane's address one that its
# pixels share: that leaves one instruction of addressing a read.
_PLANE = """
    auto *pixels = reinterpret_cast<Packed*>(image.data) + (size_t)plane * ((size_t)image.shape[1] * image.shape[2]);
    const int at = y * image.shape[2] + x;
"""
_READ = """
#if defined(__CUDA_ARCH__)
    const float%(size)d found = pixels[at];
    return wp::vec_t<%(size)d, wp::float32>(%(found)s);
#else
    return pixels[at];
#endif
"""
_WRITE = """
#if defined(__CUDA_ARCH__)
    pixels[at] = make_float%(size)d(%(given)s);
#else
    pixels[at] = group;
#endif
"""
_TYPE = """
#if defined(__CUDA_ARCH__)
    using Packed = float%(size)d;
#else
    using Packed = wp::vec_t<%(size)d, wp::float32>;
#endif
"""


@cache
def group_size(columns: int) -> int:
    """Entries of a (2, columns) matrix that lie together in layout ``"planes"``."""
    return 4 if (2 * columns) % 4 == 0 else 2


def state_image(State: Any, columns: int, layout: Layout) -> SimpleNamespace:
    """Array type ``StateImage`` of an image of (2, columns) matrices ``State``, and the functions of a pixel:

    ``read_state(image, world, y, x)``, ``write_state(image, world, y, x, state)``, and ``sample_state(image, world,
    taps)``, bilinear.
    """
    return _matrices(State) if layout == "matrices" else _planes(State, columns)


@cache
def variance_image(joints: int) -> SimpleNamespace:
    """The same for a vector of N numbers a pixel, always in planes: ``VarianceImage``, ``read_variance``,
    ``write_variance``, ``sample_variance``, and ``group``, how many numbers lie together. With an odd N a zero follows.
    """
    columns = (joints + 1) // 2
    Matrix = wp.types.matrix((2, columns), wp.float32)
    JointVector = wp.types.vector(joints, wp.float32)
    planes = _planes(Matrix, columns)
    Image = planes.StateImage
    read_matrix, write_matrix, sample_matrix = planes.read_state, planes.write_state, planes.sample_state

    @wp.func
    def vector_of(matrix: Matrix) -> JointVector:
        vector = JointVector()
        for i in range(wp.static(joints)):
            vector[i] = matrix[i // wp.static(columns), i % wp.static(columns)]
        return vector

    @wp.func
    def read_variance(image: Image, world: int, y: int, x: int) -> JointVector:
        return vector_of(read_matrix(image, world, y, x))

    @wp.func
    def write_variance(image: Image, world: int, y: int, x: int, variance: JointVector):
        matrix = Matrix()
        for i in range(wp.static(joints)):
            matrix[i // wp.static(columns), i % wp.static(columns)] = variance[i]
        write_matrix(image, world, y, x, matrix)

    @wp.func
    def sample_variance(image: Image, world: int, taps: Taps) -> JointVector:
        return vector_of(sample_matrix(image, world, taps))

    return SimpleNamespace(
        VarianceImage=Image,
        read_variance=read_variance,
        write_variance=write_variance,
        sample_variance=sample_variance,
        group=group_size(columns),
    )


def _matrices(State: Any) -> SimpleNamespace:
    StateImage = wp.array3d(dtype=State)

    @wp.func
    def read_state(image: StateImage, world: int, y: int, x: int) -> State:
        return image[world, y, x]

    @wp.func
    def write_state(image: StateImage, world: int, y: int, x: int, state: State):
        image[world, y, x] = state

    return SimpleNamespace(
        StateImage=StateImage, read_state=read_state, write_state=write_state, sample_state=bilinear(State)
    )


def _planes(State: Any, columns: int) -> SimpleNamespace:
    size = group_size(columns)
    groups = 2 * columns // size
    Group = wp.types.vector(size, wp.float32)
    StateImage = wp.array3d(dtype=Group)
    lanes = {
        "size": size,
        "found": ", ".join(f"found.{lane}" for lane in "xyzw"[:size]),
        "given": ", ".join(f"group[{lane}]" for lane in range(size)),
    }

    @wp.func_native((_TYPE + _PLANE + _READ) % lanes)
    def read_group(image: StateImage, plane: int, y: int, x: int) -> Group: ...

    @wp.func_native((_TYPE + _PLANE + _WRITE) % lanes)
    def write_group(image: StateImage, plane: int, y: int, x: int, group: Group): ...

    @wp.func
    def read_state(image: StateImage, world: int, y: int, x: int) -> State:
        state = State()
        for g in range(wp.static(groups)):
            group = read_group(image, world * wp.static(groups) + g, y, x)
            for lane in range(wp.static(size)):
                k = g * wp.static(size) + lane
                state[k // wp.static(columns), k % wp.static(columns)] = group[lane]
        return state

    @wp.func
    def write_state(image: StateImage, world: int, y: int, x: int, state: State):
        for g in range(wp.static(groups)):
            group = Group()
            for lane in range(wp.static(size)):
                k = g * wp.static(size) + lane
                group[lane] = state[k // wp.static(columns), k % wp.static(columns)]
            write_group(image, world * wp.static(groups) + g, y, x, group)

    @wp.func
    def sample_state(image: StateImage, world: int, taps: Taps) -> State:
        state = State()
        for g in range(wp.static(groups)):
            plane = world * wp.static(groups) + g
            upper = (
                read_group(image, plane, taps.top, taps.left) * taps.upper_left
                + read_group(image, plane, taps.top, taps.right) * taps.upper_right
            )
            lower = (
                read_group(image, plane, taps.bottom, taps.left) * taps.lower_left
                + read_group(image, plane, taps.bottom, taps.right) * taps.lower_right
            )
            group = upper + lower
            for lane in range(wp.static(size)):
                k = g * wp.static(size) + lane
                state[k // wp.static(columns), k % wp.static(columns)] = group[lane]
        return state

    return SimpleNamespace(
        StateImage=StateImage, read_state=read_state, write_state=write_state, sample_state=sample_state
    )
