"""What an installed copy holds, what importing it costs, and that every test can fail."""

import ast
import importlib
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import dense_vs

ROOT = Path(__file__).resolve().parents[1]
SOURCES = {"dense_vs": "dense_vs", "dense_vs.kernels": "kernels", "dense_vs.sims": "sims"}


@pytest.fixture(scope="module")
def setuptools_table():
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]


def python_packages():
    """Import name of every folder with an ``__init__.py`` under the three code folders."""
    found = set()
    for name, folder in SOURCES.items():
        for init in (ROOT / folder).rglob("__init__.py"):
            below = init.parent.relative_to(ROOT / folder).parts
            found.add(".".join([name, *below]))
    return found


def test_every_package_is_listed(setuptools_table):
    """One that is not listed goes missing from the wheel without a word."""
    assert sorted(setuptools_table["packages"]) == sorted(python_packages())
    assert setuptools_table["package-dir"] == SOURCES


def test_every_folder_with_code_is_a_package():
    for folder in SOURCES.values():
        for module in (ROOT / folder).rglob("*.py"):
            assert (module.parent / "__init__.py").is_file(), f"{module} is in no package"


def test_data_files_are_listed(setuptools_table):
    data = setuptools_table["package-data"]
    for name, folder in SOURCES.items():
        patterns = data.get(name, [])
        listed = {path for pattern in patterns for path in (ROOT / folder).glob(pattern)}
        present = {p for p in (ROOT / folder).rglob("*") if p.is_file() and p.suffix not in (".py", ".pyc")}
        assert present == listed


def test_package_names_resolve_to_their_folders():
    for name, folder in SOURCES.items():
        module = importlib.import_module(name)
        assert module.__file__ is not None
        assert (ROOT / folder / "__init__.py").samefile(module.__file__)
        assert module.__doc__


def test_type_checkers_find_the_same_files():
    for link, target in (("__init__.py", "dense_vs/__init__.py"), ("kernels", "kernels"), ("sims", "sims")):
        path = ROOT / ".typing" / "dense_vs" / link
        assert path.is_symlink()
        assert path.resolve() == ROOT / target
        assert path.exists()


def imported_by(statement, folder):
    """Modules that a fresh interpreter has after a statement; it runs elsewhere, to import what is installed."""
    code = f"import sys; {statement}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=folder)
    return set(done.stdout.split())


@pytest.mark.parametrize(
    ("statement", "left_out"),
    [
        ("import dense_vs", {"warp", "cv2", "mujoco", "mujoco_warp", "av", "numpy"}),
        ("import dense_vs; dir(dense_vs)", {"warp", "cv2", "mujoco", "numpy"}),
        ("from dense_vs import DenseJacobian, FlowEstimator, JointLog", {"mujoco", "mujoco_warp", "av", "matplotlib"}),
        ("import dense_vs.cli", {"mujoco", "mujoco_warp", "warp", "cv2", "numpy"}),
        ("import dense_vs.sims.cli.reach, dense_vs.sims.cli.record", {"mujoco", "mujoco_warp", "matplotlib", "av"}),
    ],
)
def test_heavy_imports_stand_where_they_are_used(statement, left_out, tmp_path):
    assert not imported_by(statement, tmp_path) & left_out


def test_commands_without_a_simulator_installed(tmp_path):
    code = (
        "import sys; sys.modules['mujoco'] = sys.modules['mujoco_warp'] = None; from dense_vs.cli import main; "
        "sys.exit(main(['reach', '--out', 'out']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("dense-vs: ")
    assert "pip install 'dense-vs[sims]'" in done.stderr
    assert done.stderr.count("\n") == 1


def test_public_names_are_all_there():
    for name in dense_vs.__all__:
        assert getattr(dense_vs, name).__name__ == name
    assert dir(dense_vs) == sorted(dense_vs.__all__)
    with pytest.raises(AttributeError, match="module 'dense_vs' has no attribute 'Nothing'"):
        _ = dense_vs.Nothing


def can_fail(function):
    """Whether a test asserts something: ``assert``, a comparison of ``numpy.testing``, ``pytest.raises``."""
    for node in ast.walk(function):
        if isinstance(node, ast.Assert) and not isinstance(node.test, ast.Constant):
            return True
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name.startswith("assert_") or name in ("raises", "fail", "exit"):
                return True
    return False


def test_every_test_can_fail():
    for file in (ROOT / "tests").rglob("test_*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                assert can_fail(node), f"{file.name}::{node.name} asserts nothing"
