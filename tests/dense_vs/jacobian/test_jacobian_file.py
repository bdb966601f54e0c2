"""Saved estimates: they go on bit for bit, are whole or absent, and nothing else is taken for one."""

import io
import json
import os
import pickle
import zipfile

import numpy as np
import pytest

from dense_vs import DenseJacobian, DenseVSError
from dense_vs.files import atomic_write, output_folder
from dense_vs.jacobian.stored_state import _check_covariance

HEIGHT, WIDTH, JOINTS = 9, 12, 4


def frame(seed):
    rng = np.random.default_rng(seed)
    return rng.normal(0, 1, (HEIGHT, WIDTH, 2)).astype(np.float32), rng.normal(0, 0.03, JOINTS)


def make(updates=3, **options):
    estimator = DenseJacobian(height=HEIGHT, width=WIDTH, joints=JOINTS, device="cpu", **options)
    for seed in range(updates):
        estimator.update(*frame(seed))
    return estimator


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    path = tmp_path_factory.mktemp("saved") / "jacobian.npz"
    make().save(path)
    return path


def arrays(path):
    with np.load(path) as stored:
        return dict(stored)


def rewritten(saved, folder, **changes):
    """A copy of a saved file with entries replaced, or left out where the change is None."""
    path = folder / "changed.npz"
    content = {name: value for name, value in (arrays(saved) | changes).items() if value is not None}
    np.savez(path, **content)
    return path


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"order": 1, "prediction": "flow", "measurement_noise": 0.1},
        {"covariance": "diagonal", "move_variance": True, "drift_noise": 1.0},
        {"covariance": "fixed", "prediction_iterations": 1},
        {"covariance": "full", "on_bad_flow": "skip"},
        {"process_noise": np.float32(10), "prediction_iterations": np.int64(3)},
    ],
    ids=str,
)
@pytest.mark.parametrize("updates", [2, 3])  # either half of the double buffer
def test_goes_on_as_if_it_had_never_stopped(tmp_path, options, updates):
    estimator = make(updates, **options)
    estimator.save(tmp_path / "jacobian.npz")
    loaded = DenseJacobian.load(tmp_path / "jacobian.npz", device="cpu", threads=1)
    assert loaded.options == estimator.options
    for seed in range(10, 13):
        assert loaded.updates == estimator.updates
        np.testing.assert_array_equal(loaded.jacobian, estimator.jacobian)
        np.testing.assert_array_equal(loaded.covariance, estimator.covariance)
        np.testing.assert_array_equal(loaded.variance, estimator.variance)
        for one in (loaded, estimator):
            one.update(*frame(seed))


def test_several_worlds(tmp_path):
    estimator = DenseJacobian(height=HEIGHT, width=WIDTH, joints=JOINTS, worlds=3, device="cpu")
    flow, dq = (np.stack(parts) for parts in zip(*(frame(seed) for seed in range(3)), strict=True))
    estimator.update(flow, dq)
    estimator.save(tmp_path / "jacobian.npz")
    loaded = DenseJacobian.load(tmp_path / "jacobian.npz", device="cpu")
    np.testing.assert_array_equal(loaded.jacobian, estimator.jacobian)


def test_file_holds_no_pickle(saved):
    with np.load(saved, allow_pickle=False) as stored:
        assert all(stored[name].dtype != object for name in stored.files)
    assert oct(os.stat(saved).st_mode & 0o777) == oct(0o666 & ~current_umask())


def current_umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_failed_write_leaves_the_old_file_and_nothing_else(saved, tmp_path, monkeypatch):
    path = tmp_path / "jacobian.npz"
    path.write_bytes(saved.read_bytes())

    def disk_full(stream, **_):
        stream.write(b"PK half a file")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", disk_full)
    with pytest.raises(DenseVSError, match=r"cannot write .*jacobian\.npz: No space left on device"):
        make().save(path)
    assert path.read_bytes() == saved.read_bytes()
    assert os.listdir(tmp_path) == ["jacobian.npz"]


def test_interrupted_write_leaves_nothing(tmp_path):
    def interrupted():
        with atomic_write(tmp_path / "half.txt", "w") as stream:
            stream.write("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert os.listdir(tmp_path) == []


def test_refuses_places_that_cannot_be_written(tmp_path):
    estimator = make(0)
    with pytest.raises(DenseVSError, match=r"cannot write .*No such file or directory"):
        estimator.save(tmp_path / "missing" / "jacobian.npz")
    (tmp_path / "folder").mkdir()
    with pytest.raises(DenseVSError, match=r"cannot write .*folder"):
        estimator.save(tmp_path / "folder")
    assert os.listdir(tmp_path) == ["folder"]


def test_output_folder(tmp_path):
    assert output_folder(tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").write_text("")
    for place in ("file", "file/below"):
        with pytest.raises(DenseVSError, match="cannot make the folder"):
            output_folder(tmp_path / place)


def array_file(value):
    stream = io.BytesIO()
    np.save(stream, value)
    return stream.getvalue()


NOT_SAVED_JACOBIANS = {
    "empty": b"",
    "text": b"time,a,b\n0,1,2\n",
    "array": array_file(np.zeros(3)),
    "pickle": pickle.dumps({"format": 1}),
    "zip start": b"PK\x03\x04" + bytes(100),
}


@pytest.mark.parametrize("kind", NOT_SAVED_JACOBIANS)
def test_refuses_other_files(tmp_path, kind):
    path = tmp_path / "other.npz"
    path.write_bytes(NOT_SAVED_JACOBIANS[kind])
    with pytest.raises(DenseVSError, match=r"other\.npz .*saved Jacobian"):
        DenseJacobian.load(path)


def test_refuses_a_missing_file_and_a_folder(tmp_path):
    for path in (tmp_path / "missing.npz", tmp_path):
        with pytest.raises(DenseVSError, match=r"cannot read .* as a saved Jacobian"):
            DenseJacobian.load(path)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.95, 0.999])
def test_refuses_a_truncated_file(saved, tmp_path, share):
    content = saved.read_bytes()
    path = tmp_path / "short.npz"
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(DenseVSError, match="saved Jacobian"):
        DenseJacobian.load(path)


def test_refuses_flipped_bits(saved, tmp_path):
    content = bytearray(saved.read_bytes())
    with zipfile.ZipFile(saved) as archive:
        begin = archive.getinfo("state.npy").header_offset
    content[begin + 400] ^= 0xFF
    path = tmp_path / "flipped.npz"
    path.write_bytes(content)
    with pytest.raises(DenseVSError, match="saved Jacobian"):
        DenseJacobian.load(path)


def test_refuses_other_archives(tmp_path):
    path = tmp_path / "other.npz"
    np.savez(path, a=np.zeros(3))
    with pytest.raises(DenseVSError, match="not a saved Jacobian; expected a file that DenseJacobian"):
        DenseJacobian.load(path)


def test_refuses_pickled_objects(saved, tmp_path):
    class Trap:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "sprung"),)

    path = rewritten(saved, tmp_path, state=np.array([Trap()], dtype=object))
    with pytest.raises(DenseVSError, match="saved Jacobian"):
        DenseJacobian.load(path)
    assert not (tmp_path / "sprung").exists()


def options_with(saved, **changes):
    return json.dumps(json.loads(str(arrays(saved)["options"])) | changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "something else"}, "not a saved Jacobian"),
        ({"format_version": 2}, "has format version 2; expected 1"),
        ({"format_version": None}, "has format version None; expected 1"),
        ({"format_version": "new"}, "has format version new; expected 1"),
        ({"state": None}, "is damaged"),
        ({"covariance": None}, "is damaged"),
        ({"updates": None}, "is damaged"),
        ({"updates": "many"}, "is damaged"),
        ({"options": None}, "is damaged"),
        ({"options": "{not json"}, "is damaged"),
        ({"options": "[1, 2]"}, "is damaged"),
        ({"state": np.zeros((1, HEIGHT, WIDTH, 2, 3), np.float32)}, r"state has shape \(1, 9, 12, 2, 3\).*expected"),
        ({"state": np.zeros((1, HEIGHT, WIDTH, 2, 14))}, "state has .*dtype float64; expected .*float32"),
        ({"state": np.full((1, HEIGHT, WIDTH, 2, 14), np.nan, np.float32)}, "is damaged.*expected finite values"),
        ({"covariance": np.zeros((1, 4, 4))}, r"covariance has shape \(1, 4, 4\)"),
    ],
    ids=lambda value: str(list(value)) if isinstance(value, dict) else "",
)
def test_refuses_damaged_content(saved, tmp_path, changes, message):
    with pytest.raises(DenseVSError, match=message):
        DenseJacobian.load(rewritten(saved, tmp_path, **changes), device="cpu")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joints": 5}, "is damaged: state"),
        ({"height": 0}, "is damaged: height is 0"),
        ({"color": 1}, "is damaged.*'color'"),
        ({"device": "cpu"}, "is damaged.*'device'"),
    ],
)
def test_refuses_options_that_do_not_fit(saved, tmp_path, changes, message):
    path = rewritten(saved, tmp_path, options=options_with(saved, **changes))
    with pytest.raises(DenseVSError, match=message):
        DenseJacobian.load(path, device="cpu")


@pytest.mark.parametrize(
    ("covariance", "diagonal", "message"),
    [
        ([[2.0, 1.0], [1.0, 2.0]], False, None),
        ([[0.0, 0.0], [0.0, 0.0]], False, None),
        ([[1.0, 1.0], [1.0, 1.0]], False, None),  # a variance of 0
        ([[2.0, 1.0], [0.5, 2.0]], False, "is not symmetric"),
        ([[2.0, -1.0], [1.0, 2.0]], False, "is not symmetric"),
        ([[1.0, 2.0], [2.0, 1.0]], False, "has a variance of -0.9999"),
        ([[1.0, 2.0], [2.0, 1.0]], True, None),  # variances alone
        ([[1.0, 0.0], [-0.5, 1.0]], True, "has a variance of -0.5"),
    ],
)
def test_a_covariance_is_symmetric_and_has_no_variance_below_zero(covariance, diagonal, message):
    good = np.eye(2)
    for worlds in ([covariance], [good, covariance], [covariance, good]):
        if message is None:
            _check_covariance(np.array(worlds), diagonal)
        else:
            with pytest.raises(DenseVSError, match=message):
                _check_covariance(np.array(worlds), diagonal)
