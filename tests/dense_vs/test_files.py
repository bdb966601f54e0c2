"""Files that are whole or absent, whatever ends their writer, and archives that claim more than they hold."""

import io
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from dense_vs import DenseJacobian, DenseVSError
from dense_vs.device import resolve_device, room_for
from dense_vs.files import atomic_write, check_writable, file_path, read_arrays, read_format

KILLED = """
import os, signal, sys
from dense_vs.files import atomic_write
with atomic_write(sys.argv[1]) as stream:
    stream.write(b"half")
    stream.flush()
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_killed_writer_left_goes_with_the_next_save(tmp_path):
    path = tmp_path / "state.npz"
    path.write_bytes(b"whole")
    for _ in range(2):
        subprocess.run([sys.executable, "-c", KILLED, str(path)], check=False, timeout=60)
    assert path.read_bytes() == b"whole"
    assert len(list(tmp_path.iterdir())) == 2  # the second one removed what the first left
    mine = tmp_path / ".state.npz.mine"
    mine.write_text("kept")
    with atomic_write(path) as stream:
        stream.write(b"new")
    assert path.read_bytes() == b"new"
    assert sorted(tmp_path.iterdir()) == sorted([path, mine])


def test_a_file_that_is_being_written_is_left_alone(tmp_path):
    path = tmp_path / "state.npz"
    with atomic_write(path) as first:
        first.write(b"first")
        with atomic_write(path) as second:
            second.write(b"second")
        assert path.read_bytes() == b"second"
    assert path.read_bytes() == b"first"
    assert list(tmp_path.iterdir()) == [path]


def test_an_error_leaves_what_was_there(tmp_path):
    path = tmp_path / "state.npz"
    path.write_bytes(b"whole")

    def fail():
        with atomic_write(path) as stream:
            stream.write(b"half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert path.read_bytes() == b"whole"
    assert list(tmp_path.iterdir()) == [path]


def test_whether_a_file_can_be_written_is_asked_before(tmp_path):
    check_writable(tmp_path / "new.npz")
    assert not list(tmp_path.iterdir())
    for path, message in ((tmp_path / "no" / "new.npz", "cannot write"), (tmp_path, "is a folder")):
        with pytest.raises(DenseVSError, match=message):
            check_writable(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="a system without pipes in folders")
def test_nothing_takes_the_place_of_a_pipe_or_a_device(tmp_path):
    """Root may replace /dev/full by a file, and would."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path in (pipe, Path("/dev/null")):
        with pytest.raises(DenseVSError, match="device or a pipe"):
            check_writable(path)
        with pytest.raises(DenseVSError, match="device or a pipe"), atomic_write(path) as stream:
            stream.write(b"whole")
    assert pipe.is_fifo()
    assert Path("/dev/null").is_char_device()
    assert list(tmp_path.iterdir()) == [pipe]


@pytest.mark.parametrize("path", ["x" * 5000, "a\0b", 3, None, 1.5])
def test_names_that_no_file_can_have(path):
    with pytest.raises(DenseVSError, match="path"):
        file_path(path)


def archive(path, shape, content, name="a.npy"):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": shape})
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as stored:
        stored.writestr(name, header.getvalue() + content)
    return path


@pytest.mark.parametrize("shape", [(10**6, 10**6), (10**12,), (9,), (0, 10**12)])
def test_a_header_that_claims_another_size_is_refused(tmp_path, shape):
    with pytest.raises(DenseVSError, match="claims the shape"):
        read_arrays(archive(tmp_path / "a.npz", shape, b"\0" * 64), "a test")


def test_arrays_that_are_not_wanted_are_not_read(tmp_path, monkeypatch):
    path = archive(tmp_path / "a.npz", (8,), b"\0" * 64)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as stored:
        stored.writestr("large.npy", b"\0" * (64 << 20))
    monkeypatch.setattr("dense_vs.files.free_memory", lambda: 1 << 20)
    assert list(read_arrays(path, "a test", ("a",))) == ["a"]
    with pytest.raises(DenseVSError, match=r"take 0\.1 GiB; 0\.0 GiB are free"):
        read_arrays(path, "a test")


def test_what_does_not_fit_the_memory_is_refused_before_it_is_taken():
    device = resolve_device("cpu")
    wanted = pytest.raises(DenseVSError, match=r"needs about 16384\.0 GiB; cpu had .* worlds fit")
    with wanted, room_for("a test", 1 << 14, 1 << 30, device):
        raise AssertionError("nothing is made")
    with pytest.raises(DenseVSError, match="dense image Jacobian of 4 worlds needs"):
        DenseJacobian(height=16384, width=16384, joints=64, worlds=4, device="cpu")
    with pytest.raises(DenseVSError, match="needs about"), room_for("a test", 1, 10, device):
        raise RuntimeError("Failed to allocate 10 bytes on device 'cpu'")


def saved(tmp_path, **changes):
    estimator = DenseJacobian(height=8, width=8, joints=2, device="cpu", threads=1)
    estimator.save(tmp_path / "j.npz")
    with np.load(tmp_path / "j.npz") as stored:
        arrays = {name: stored[name] for name in stored.files}
    np.savez(tmp_path / "bad.npz", **(arrays | {name: change(arrays[name]) for name, change in changes.items()}))
    return tmp_path / "bad.npz"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"updates": lambda _: np.array(-1)}, "updates is -1"),
        ({"updates": lambda _: np.array(2.5)}, "updates is 2.5"),
        ({"displacement": lambda d: d + 1e30}, r"displacement holds 1e\+30"),
        ({"state": lambda s: s + np.float32(3e38)}, "state holds"),
        ({"covariance": lambda c: c + np.triu(np.full(c.shape[1:], 1e3), 1)}, "not symmetric"),
        ({"covariance": lambda c: -c}, "variance of -"),
        ({"options": lambda o: np.array(str(o).replace('"height": 8', '"height": 4096'))}, "state has shape"),
    ],
)
def test_a_saved_jacobian_that_no_filter_came_to(tmp_path, changes, message):
    with pytest.raises(DenseVSError, match=message):
        DenseJacobian.load(saved(tmp_path, **changes), device="cpu")


def test_the_process_goes_on_after_numpys_order():
    two = DenseJacobian(height=8, width=8, joints=2, order=np.int64(2), device="cpu")
    assert type(two.options.order) is int
    assert DenseJacobian(height=8, width=8, joints=2, device="cpu").options.order == 2


FORM = {"what": "a saved thing", "form": "dense-vs thing", "writer": "Thing.save"}


@pytest.mark.parametrize(
    ("stored", "versions", "message"),
    [
        (
            {"format": "dense-vs other", "format_version": 1},
            (1,),
            "is not a saved thing; expected a file that Thing.save",
        ),
        ({"format_version": 1}, (1,), "is not a saved thing"),
        ({"format": "dense-vs thing", "format_version": 3}, (1, 2), "has format version 3; expected 1 or 2"),
        ({"format": "dense-vs thing"}, (1,), "has format version None; expected 1"),
        ({"format": "dense-vs thing", "format_version": [1, 2]}, (1,), r"has format version \[1 2\]; expected 1"),
    ],
)
def test_another_format_and_another_version_are_refused(tmp_path, stored, versions, message):
    path = tmp_path / "thing.npz"
    np.savez(path, **stored)
    with pytest.raises(DenseVSError, match=message):
        read_format(path, versions=versions, **FORM)


@pytest.mark.parametrize("version", [1, 2])
def test_a_format_of_a_version_that_can_be_read(tmp_path, version):
    path = tmp_path / "thing.npz"
    np.savez(path, format="dense-vs thing", format_version=version, value=np.arange(3), other=np.zeros(2))
    arrays = read_format(path, versions=(1, 2), names=("format", "format_version", "value"), **FORM)
    assert arrays["value"].tolist() == [0, 1, 2]
    assert "other" not in arrays


def test_what_is_no_archive_has_no_format(tmp_path):
    (tmp_path / "thing.npz").write_bytes(b"something else")
    with pytest.raises(DenseVSError, match=r"cannot read .* as a saved thing"):
        read_format(tmp_path / "thing.npz", versions=(1,), **FORM)
