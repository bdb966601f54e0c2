"""ViSP's vpServo, through the small program ``visp_servo.cpp`` that is compiled against an installed ViSP.

Debian and Ubuntu have it as ``libvisp-dev``. Without it everything here says so by :class:`VispMissingError`.
"""

import contextlib
import hashlib
import shutil
import struct
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.marked_arm.classical_ibvs import INTERACTIONS, Gain, IbvsProblem

SOURCE = Path(__file__).with_name("visp_servo.cpp")
LIBRARIES = ("-lvisp_vs", "-lvisp_visual_features", "-lvisp_core")
PACKAGE = "visp"  # of pkg-config

_COMPILE_SECONDS = 300


class VispMissingError(DenseVSError):
    """ViSP, or what a program against it is compiled with, is not installed."""


class VispServo:
    """A running ``visp_servo``; a context manager.

    Raises:
        VispMissingError: no ViSP.
        DenseVSError: the program does not compile.
    """

    def __init__(self, program: Path | None = None):
        self._program = build_program() if program is None else program
        self._process = subprocess.Popen([self._program], stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def __enter__(self) -> "VispServo":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the program."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):  # of what an ended program never read
                    pipe.close()
        self._process.wait()

    @property
    def version(self) -> str:
        """ViSP's."""
        found = subprocess.run([self._program, "--version"], capture_output=True, text=True, check=True)
        return found.stdout.strip()

    def steps(self, problem: IbvsProblem, gain: Gain, interaction: str = "current") -> np.ndarray:
        """Joint steps (B, n) [rad] by ViSP; arguments as :func:`dense_vs.sims.marked_arm.classical_ibvs.ibvs_steps`.

        Raises:
            DenseVSError: the program ended.
        """
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        hands, joints = len(problem.points), problem.flange_jacobian.shape[-1]
        size = 8 * hands * joints
        try:
            stdin.write(packed(problem, gain, interaction))
            stdin.flush()
            answer = stdout.read(size)
        except (BrokenPipeError, ValueError):
            answer = b""
        if len(answer) != size:
            raise DenseVSError(
                f"{self._program.name} ended with {self._process.poll()} and {len(answer)} of {size} bytes"
            )
        return np.frombuffer(answer).reshape(hands, joints).copy()


def packed(problem: IbvsProblem, gain: Gain, interaction: str) -> bytes:
    """A batch as ``visp_servo.cpp`` reads it."""
    hands, cameras, points = problem.points.shape[:3]
    joints = problem.flange_jacobian.shape[-1]
    numbers = (hands, cameras, points, joints, INTERACTIONS.index(interaction), 0)
    header = struct.pack("6i3d", *numbers, gain.at_zero, gain.at_infinity, gain.slope)
    parts = (
        *(problem.points, problem.depths, problem.desired, problem.desired_depths),
        *(problem.T_camera_flange, problem.flange_jacobian),
    )
    table = np.concatenate([np.asarray(part, dtype=np.float64).reshape(hands, -1) for part in parts], axis=1)
    return header + table.tobytes()


def build_program(folder: Path | None = None) -> Path:
    """Compile ``visp_servo.cpp`` unless that was done before; the program's path.

    Args:
        folder: to keep it in; one beside other temporary files when None.

    Raises:
        VispMissingError: no ViSP, or no compiler.
        DenseVSError: it does not compile.
    """
    flags = compile_flags()
    key = hashlib.sha256(SOURCE.read_bytes() + " ".join(flags).encode()).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / "dense_vs_visp" if folder is None else folder
    program = folder / f"visp_servo_{key}"
    if program.is_file():
        return program
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        fresh = Path(scratch) / program.name
        command = ["c++", "-O2", *flags, str(SOURCE), "-o", str(fresh), *LIBRARIES]
        done = _run(command, "a C++ compiler (Debian: g++)")
        if done.returncode:
            raise DenseVSError(f"{SOURCE.name} does not compile: {done.stderr.strip()[-2000:]}")
        fresh.replace(program)  # whole or not at all
    return program


def compile_flags() -> Sequence[str]:
    """What pkg-config says of ViSP.

    Raises:
        VispMissingError: it knows of none, or is missing itself.
    """
    done = _run(["pkg-config", "--cflags", "--libs-only-L", PACKAGE], "pkg-config")
    if done.returncode:
        raise VispMissingError(f"pkg-config knows no {PACKAGE!r}; expected ViSP 3 (Debian: libvisp-dev)")
    return done.stdout.split()


def _run(command: list[str], what: str) -> subprocess.CompletedProcess[str]:
    if shutil.which(command[0]) is None:
        raise VispMissingError(f"{command[0]} was not found; expected {what} and ViSP 3 (Debian: libvisp-dev)")
    return subprocess.run(command, capture_output=True, text=True, timeout=_COMPILE_SECONDS, check=False)
