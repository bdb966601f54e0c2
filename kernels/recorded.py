"""Launches on the same arrays, recorded once: packing arguments takes longer than many a launch."""

import ctypes
from collections.abc import Sequence
from copy import copy
from typing import Any

import warp as wp


class CpuLaunch:
    """A recorded launch on a CPU with its arguments packed for good, which Warp does at every launch anew.

    Args:
        command: recorded by Warp; its arrays are to be kept alive.
        grid: its dimensions, where parts may have the same.
    """

    __slots__ = ("_arguments", "_bounds", "_command", "_first", "_forward", "_grid", "_references")

    def __init__(self, command: Any, grid: Any = None):
        self._command, self._forward, self._bounds = command, command.hooks.forward, command.bounds
        self._grid = grid
        given = command.params[1:]  # the first are the bounds
        names = [argument.label for argument in command.kernel.adj.args]
        fields = [(name, type(value)) for name, value in zip(names, given, strict=True)]
        self._first = names[0]
        packed: Any = type("Arguments", (ctypes.Structure,), {"_fields_": fields})
        self._point_to(packed(*given))

    def _point_to(self, arguments: ctypes.Structure) -> None:
        self._arguments = arguments  # as long as the references
        self._references = ctypes.byref(self._bounds), ctypes.byref(arguments)

    def launch(self, stream: Any = None) -> None:
        """Run on the arrays' present content; the result is there on return."""
        self._forward(*self._references)

    def part(self, begin: int, grid: tuple[int, ...]) -> "CpuLaunch":
        """The same launch of another part: where it begins, the kernel's first argument, and its grid."""
        other = CpuLaunch.__new__(CpuLaunch)
        other._command, other._grid, other._bounds = self._command, self._grid, self._bounds
        other._forward, other._first = self._forward, self._first
        if grid != self._grid:
            other._command = copy(self._command)
            other._command.set_dim(grid)
            other._grid, other._bounds = grid, other._command.bounds
        arguments: Any = type(self._arguments).from_buffer_copy(self._arguments)
        setattr(arguments, self._first, begin)
        other._point_to(arguments)
        return other


def recorded(kernel: Any, grid: Any, arguments: Sequence[Any], device: Any) -> Any:
    """A launch to be run again and again by its ``launch()``.

    Args:
        kernel: of one thread a block on a CPU.
        grid: its dimensions.
        arguments: inputs before outputs; to be kept alive.
        device: Warp device of the arrays.
    """
    command: Any = wp.launch(
        kernel, dim=grid, inputs=list(arguments), device=device, record_cmd=True, record_tape=False
    )
    return CpuLaunch(command, grid) if command.device.is_cpu else command


def recorded_parts(
    kernel: Any, parts: Sequence[tuple[int, tuple[int, ...]]], arguments: Sequence[Any], device: Any
) -> list[Any]:
    """Launches of one kernel on the same arrays.

    Args:
        kernel: takes where its part begins first.
        parts: where each begins, and its grid; one on a GPU, whose cores share it out.
        arguments: what follows, inputs before outputs.
        device: Warp device of the arrays.
    """
    (begin, grid), *others = parts
    first = recorded(kernel, grid, [begin, *arguments], device)
    return [first, *(first.part(*other) for other in others)]
