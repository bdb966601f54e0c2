"""A row of the filter's update at once, for a CPU: DIJE (10) and (12) with one gain, DIJE (9) to (11) with variances.

A GPU does the same in Warp, in ``single_pass_update.py`` and ``diagonal_single_pass.py``. On a CPU Warp hands a pixel's
matrix on by value, through memory, and looks up an array's strides at every access; here a pixel's numbers are sampled
and corrected in registers of the machine's width. The state stays a matrix a pixel: a tap is then one or two cache
lines, where planes would need a gather for every number. A block of pixels is taken in steps, so that none waits for
what another step decides: first where its taps lie, then the numbers. Taps wander up and down by the flow, which
defeats the cache's own guesses: rows to come are asked for ahead, 1.9 times as fast.
"""

from typing import Any

import warp as wp

from dense_vs.kernels.image.row_taps import BLOCK_TAPS
from dense_vs.kernels.jacobian.innovation_bounds import FADE, NEAR, SLACK

_MOST_LANES = 16  # float32 numbers in the widest registers

_SIZE = """
    const int width = state_in.shape[2], height = state_in.shape[1];
"""
# A pixel's numbers in chunks of so many lanes. Where these do not divide their count the last chunk begins earlier, and
# some numbers are in two: they are computed twice, to the same value, and counted once in sums.
_PIXELS = """
    constexpr int columns = %(columns)d, numbers = 2 * columns, lanes = %(lanes)d;
    constexpr int chunks = (numbers + lanes - 1) / lanes;
    typedef float Lanes __attribute__((ext_vector_type(lanes), aligned(4)));
    struct Rows { Lanes x[chunks], y[chunks]; };
    struct State { Lanes chunk[chunks]; };
    const size_t world_begin = (size_t)world * height * width, row_begin = world_begin + (size_t)y * width;
    const float *states = reinterpret_cast<const float*>(state_in.data + world_begin);
    const auto begin = [](int chunk) { return chunk + 1 < chunks ? chunk * lanes : numbers - lanes; };
    const auto sum = [](Lanes a) { return %(sum)s; };
    // A row of numbers beside each row of a pixel's matrix, with zeros beside the other row.
    const auto beside = [&](const auto &row, bool twice) {
        Rows out;
        for (int chunk = 0; chunk < chunks; ++chunk)
            for (int lane = 0; lane < lanes; ++lane) {
                const int k = begin(chunk) + lane;
                const bool counted = twice || k >= chunk * lanes;
                out.x[chunk][lane] = counted && k < columns ? row[k] : 0.0f;
                out.y[chunk][lane] = counted && k >= columns ? row[k - columns] : 0.0f;
            }
        return out;
    };
    const auto state_at = [&](size_t place) {
        State state;
        for (int c = 0; c < chunks; ++c)
            state.chunk[c] = *reinterpret_cast<const Lanes*>(states + place * numbers + begin(c));
        return state;
    };
    const auto times = [&](const State &state, const Rows &row) {
        if constexpr (numbers == lanes) {  // each row is a half
            const Lanes both = state.chunk[0] * (row.x[0] + row.y[0]);
            const auto half_sum = [](auto a) { return %(half_sum)s; };
            return Pair{half_sum(both.lo), half_sum(both.hi)};
        }
        Lanes along_x = 0.0f, along_y = 0.0f;
        for (int c = 0; c < chunks; ++c) {
            along_x += state.chunk[c] * row.x[c];
            along_y += state.chunk[c] * row.y[c];
        }
        return Pair{sum(along_x), sum(along_y)};
    };
"""
_MOVED = """
    const Pair *flows = reinterpret_cast<const Pair*>(flow_in.data + row_begin);
    float *out = reinterpret_cast<float*>(state_out.data + row_begin);
    const auto is_flow = [](Pair u) {
        const float ux = u.x, uy = u.y;  // the bits of a vector's element are taken from its first one
        return (__builtin_bit_cast(int, ux) & 0x7F800000) < 0x48000000
            && (__builtin_bit_cast(int, uy) & 0x7F800000) < 0x48000000;
    };
    const auto moved_state = [&](const Taps &taps, int k) {
        const float *later = states + (size_t)(taps.place[2][k] + 2 * width) * numbers;  // no read
        for (int n = 0; n < numbers; n += 16) __builtin_prefetch(later + n);
        State corner[4];
        for (int c = 0; c < 4; ++c) corner[c] = state_at(taps.place[c][k]);
        State state;
        for (int n = 0; n < chunks; ++n)
            state.chunk[n] = (corner[0].chunk[n] * taps.weight[0][k] + corner[1].chunk[n] * taps.weight[1][k])
                + (corner[2].chunk[n] * taps.weight[2][k] + corner[3].chunk[n] * taps.weight[3][k]);
        return state;
    };
"""

_FLOW = """
    Pair *flows = reinterpret_cast<Pair*>(flow_out.data + row_begin);
    const Rows steps = beside(regressor, false);
    for (int x = 0; x < width; ++x) flows[x] = times(state_at((size_t)y * width + x), steps);
"""

_SHARED = """
    const Pair *shifts = reinterpret_cast<const Pair*>(shift_in.data + world_begin);
    const Pair *model = reinterpret_cast<const Pair*>(model_flow_in.data + world_begin);
    const Rows gains = beside(gain, true), spanned = beside(measured, false);
    const bool limited = rest > 0.0f || bound > 0.0f;
    Taps taps, by_flow;
    float error_x[block], error_y[block], other_x[block], other_y[block];
    for (int first = 0; first < width; first += block) {
        const int count = width - first < block ? width - first : block;
        const Pair *flow = flows + first;
        moved_taps(taps, shifts, iterations, first, count);
        for (int k = 0; k < count; ++k) {
            const Pair error = one_frame && is_flow(flow[k]) ? flow[k] - sampled(model, taps, k) : Pair{0.0f, 0.0f};
            error_x[k] = error.x, error_y[k] = error.y;
        }
        if (or_flow && one_frame) {
            for (int k = 0; k < count; ++k) by_flow.shift_x[k] = flow[k].x, by_flow.shift_y[k] = flow[k].y;
            taps_at(by_flow, first, count);
            for (int k = 0; k < count; ++k) {
                const Pair other = flow[k] - sampled(model, by_flow, k);
                other_x[k] = other.x, other_y[k] = other.y;
            }
            for (int k = 0; k < count; ++k) {
                const float squared = error_x[k] * error_x[k] + error_y[k] * error_y[k];
                const float other = other_x[k] * other_x[k] + other_y[k] * other_y[k];
                const bool taken = (squared > %(near)sf) & (other < squared);
                for (int c = 0; c < 4; ++c) {
                    taps.place[c][k] = taken ? by_flow.place[c][k] : taps.place[c][k];
                    taps.weight[c][k] = taken ? by_flow.weight[c][k] : taps.weight[c][k];
                }
                error_x[k] = taken ? other_x[k] : error_x[k];
                error_y[k] = taken ? other_y[k] : error_y[k];
            }
        }
        for (int k = 0; k < count; ++k) {
            const State prior = moved_state(taps, k);
            Pair error{error_x[k], error_y[k]};
            if (!one_frame && is_flow(flow[k])) error = flow[k] - times(prior, spanned);
            float kept = 1.0f;
            if (limited && is_flow(flow[k])) {
                const Pair u = flow[k], predicted = u - error;
                const float squared = u.x * u.x + u.y * u.y;
                const float length = __builtin_sqrtf(error.x * error.x + error.y * error.y);
                const float most = bound * (__builtin_sqrtf(squared) + %(slack)sf);
                const float motion = predicted.x * predicted.x + predicted.y * predicted.y;
                if (measures && (squared > motion ? squared : motion) < rest * rest)
                    kept = %(fade)sf, error = Pair{0.0f, 0.0f};
                else if (bound > 0.0f && length > most)
                    error *= most / length;
            }
            float *to = out + (size_t)(first + k) * numbers;
            for (int c = 0; c < chunks; ++c)
                *reinterpret_cast<Lanes*>(to + begin(c)) =
                    kept * prior.chunk[c] + (error.x * gains.x[c] + error.y * gains.y[c]);
        }
    }
"""

_DIAGONAL = """
    const float *variances = reinterpret_cast<const float*>(variance_in.data + world_begin);
    const float *own = variances + (size_t)y * width * columns;
    float *variances_out = reinterpret_cast<float*>(variance_out.data + row_begin);
    Pair *shifts = reinterpret_cast<Pair*>(shift.data + world_begin);
    const Rows steps = beside(dq, false);
    float step[columns];
    for (int i = 0; i < columns; ++i) step[i] = dq[i];
    Taps taps;
    for (int first = 0; first < width; first += block) {
        const int count = width - first < block ? width - first : block;
        if (finds_shift)
            for (int k = 0; k < count; ++k) {
                const size_t place = (size_t)y * width + first + k;
                shifts[place] = times(state_at(place), steps);
            }
        moved_taps(taps, shifts, iterations, first, count);
        for (int k = 0; k < count; ++k) {
            const Pair flow = flows[first + k];
            const bool known = is_flow(flow);
            float variance[columns], projected[columns], gain[numbers];
            if (move_variance) {
                for (int i = 0; i < columns; ++i) {
                    const auto tap = [&](int corner) {
                        return variances[(size_t)taps.place[corner][k] * columns + i] * taps.weight[corner][k];
                    };
                    variance[i] = (tap(0) + tap(1)) + (tap(2) + tap(3));
                }
            } else {
                for (int i = 0; i < columns; ++i) variance[i] = own[(size_t)(first + k) * columns + i];
            }
            float innovation_variance = measurement_noise;
            for (int i = 0; i < columns; ++i) {
                variance[i] = __builtin_elementwise_min(variance[i] + growth, max_variance);
                projected[i] = variance[i] * step[i];
                innovation_variance += projected[i] * step[i];
            }
            const float scale = known ? 1.0f / innovation_variance : 0.0f;
            for (int i = 0; i < columns; ++i) gain[i] = gain[columns + i] = projected[i] * scale;
            const State prior = moved_state(taps, k);
            const Pair error = known ? flow - times(prior, steps) : Pair{0.0f, 0.0f};
            float *to = out + (size_t)(first + k) * numbers;
            for (int c = 0; c < chunks; ++c) {
                Lanes of_gain, errors;
                for (int lane = 0; lane < lanes; ++lane) {
                    of_gain[lane] = gain[begin(c) + lane];
                    errors[lane] = begin(c) + lane < columns ? error.x : error.y;
                }
                *reinterpret_cast<Lanes*>(to + begin(c)) = prior.chunk[c] + errors * of_gain;
            }
            for (int i = 0; i < columns; ++i)
                variances_out[(size_t)(first + k) * columns + i] = variance[i] - gain[i] * projected[i];
        }
    }
"""


def flow_row(types: Any) -> wp.Function:
    """Warp function for :func:`.state_types.state_types`: a row of ``predicted_flow``."""
    StateImage, StateRow = types.StateImage, types.StateRow

    @wp.func_native(_native(types, _FLOW))
    def row(state_in: StateImage, regressor: StateRow, flow_out: wp.array3d(dtype=wp.vec2), world: int, y: int): ...

    return row


def shared_row(types: Any) -> wp.Function:
    """The same of ``update_shared``."""
    StateImage, StateRow = types.StateImage, types.StateRow

    @wp.func_native(_native(types, _MOVED + _SHARED))
    def row(
        state_in: StateImage,
        shift_in: wp.array3d(dtype=wp.vec2),
        iterations: int,
        or_flow: bool,
        rest: float,
        bound: float,
        flow_in: wp.array3d(dtype=wp.vec2),
        model_flow_in: wp.array3d(dtype=wp.vec2),
        one_frame: bool,
        measures: bool,
        measured: StateRow,
        gain: StateRow,
        state_out: StateImage,
        world: int,
        y: int,
    ): ...

    return row


def diagonal_row(types: Any) -> wp.Function:
    """The same of ``update_diagonal``."""
    StateImage, JointVector = types.StateImage, types.JointVector

    @wp.func_native(_native(types, _MOVED + _DIAGONAL))
    def row(
        state_in: StateImage,
        variance_in: wp.array3d(dtype=JointVector),
        shift: wp.array3d(dtype=wp.vec2),
        finds_shift: bool,
        iterations: int,
        move_variance: bool,
        flow_in: wp.array3d(dtype=wp.vec2),
        dq: JointVector,
        growth: float,
        measurement_noise: float,
        max_variance: float,
        state_out: StateImage,
        variance_out: wp.array3d(dtype=JointVector),
        world: int,
        y: int,
    ): ...

    return row


def _native(types: Any, text: str) -> str:
    """C++ of a row, for a CPU alone: a GPU's compiler lacks the vectors."""
    numbers = 2 * types.columns
    lanes = min(_MOST_LANES, 1 << numbers.bit_length() - 1)
    settings = {"columns": types.columns, "lanes": lanes, "sum": _sum("a", lanes), "half_sum": _sum("a", lanes // 2)}
    limits = {"near": float(NEAR), "fade": float(FADE), "slack": float(SLACK)}
    return f"#if !defined(__CUDA_ARCH__)\n{_SIZE}{BLOCK_TAPS}{_PIXELS}{text}#endif\n" % (settings | limits)


def _sum(name: str, lanes: int) -> str:
    """C++ for the sum of a vector's lanes, halves added to halves."""
    if lanes == 1:
        return name
    if lanes == 2:
        return f"{name}.lo + {name}.hi"
    return f"[](auto b) {{ return {_sum('b', lanes // 2)}; }}({name}.lo + {name}.hi)"
