"""Rooms keep to their place: who imports whom, how large a file and a function may be, and that each names its duty."""

import ast
import itertools
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = {"dense_vs": "dense_vs", "dense_vs.kernels": "kernels", "dense_vs.sims": "sims"}

# From the ground up. A room imports itself and what is named for it; nothing imports upward.
GROUND = {"errors", "checks", "arrays", "device", "files", "lazy_names", "memory"}
KERNEL_ROOMS = {
    "kernels.cpu_threads": set(),
    "kernels.recorded": set(),
    "kernels.launch": {"kernels.cpu_threads", "kernels.recorded"},
    "kernels.views": set(),
    "kernels.image": set(),
    "kernels.flow": {"kernels.image"},
    "kernels.jacobian": {"kernels.image"},
    "kernels.tracking": {"kernels.image"},
    "kernels.body": {"kernels.image", "kernels.jacobian"},
    "kernels.masks": {"kernels.image"},
    "kernels.arm": set(),
    "kernels.control": set(),
    "kernels.simulation": {"kernels.image"},
}
LAUNCHING = {"kernels.cpu_threads", "kernels.recorded", "kernels.launch", "kernels.views"}
ROOMS = {
    "robot": set(),
    "health": {"robot"},
    "recording": {"robot"},
    "drivers": {"robot"},
    "flow": set(),
    "jacobian": set(),
    "body": {"jacobian"},
    "pipeline": {"health", "recording", "flow", "jacobian", "body"},
    "generative": set(),
    "body_model": {"generative", "flow"},
    "point_servo": {"robot", "health", "recording", "flow", "jacobian", "body", "body_model", "pipeline"},
    "segmentation": set(),
    "mask_servo": {"robot", "segmentation"},
    "depth": {"robot", "segmentation"},
    "grasp": {"robot", "segmentation", "mask_servo"},
}
ALGORITHMS = set(ROOMS)
ROOMS["view"] = ALGORITHMS
ROOMS["sweep"] = {"view"}
ROOMS["live"] = ALGORITHMS | {"view"}
ROOMS["cli"] = ALGORITHMS | {"view", "sweep", "live"}
SIMS_ROOMS = {
    "sims.engine": set(),
    "sims.arms": {"sims.engine"},
    "sims.batch": {"sims.engine"},
    "sims.marked_arm": set(),
    "sims.workcell": {"sims.engine", "sims.marked_arm"},
    "sims.mobile_manipulator": {"sims.engine"},
    "sims.depth_training": set(),
    "sims.flow_training": set(),
    "sims.papers": {"sims.engine", "sims.batch", "sims.marked_arm", "sims.workcell", "sims.mobile_manipulator"},
    "sims.cli": {
        "sims.engine",
        "sims.arms",
        "sims.batch",
        "sims.papers",
        "sims.depth_training",
        "sims.flow_training",
    },
}
EXTERNAL = {"sims.cli": {"cli", "live"}}  # its commands share the command line's arguments and show robots on the page


def modules():
    """Import name and file of every module."""
    for name, folder in FOLDERS.items():
        for file in sorted((ROOT / folder).rglob("*.py")):
            parts = file.relative_to(ROOT / folder).with_suffix("").parts
            yield ".".join([name, *(part for part in parts if part != "__init__")]), file


def room_of(module: str) -> str:
    """Room of an import name; a module outside of any room is a room by itself."""
    parts = module.split(".")[1:]
    if not parts:
        return ""
    return ".".join(parts[:2]) if parts[0] in ("kernels", "sims") else parts[0]


def imports(file: Path):
    """Modules of ours that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "dense_vs":
            for alias in node.names:
                yield node.module if node.module.count(".") > 1 else f"{node.module}.{alias.name}"
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.split(".")[0] == "dense_vs")


def allowed(room: str) -> set[str]:
    kernels = set(KERNEL_ROOMS) - {"kernels.simulation"}
    if room in GROUND:
        return GROUND | kernels
    if room in KERNEL_ROOMS:
        return KERNEL_ROOMS[room] | LAUNCHING
    if room in ROOMS:
        return GROUND | kernels | ROOMS[room]
    return GROUND | set(KERNEL_ROOMS) | ALGORITHMS | {"view"} | SIMS_ROOMS[room] | EXTERNAL.get(room, set())


FACES = {"", "kernels", "sims"}  # they name what lies below them
FILES = [(module, file) for module, file in modules() if room_of(module) not in FACES and room_of(module) != "__main__"]


def test_every_module_is_in_a_room():
    known = GROUND | set(KERNEL_ROOMS) | set(ROOMS) | set(SIMS_ROOMS)
    assert {room_of(module) for module, _ in FILES} <= known


@pytest.mark.parametrize("room", sorted({room_of(module) for module, _ in FILES}))
def test_a_room_imports_only_what_it_may(room):
    wrong = [
        f"{module} imports {name}"
        for module, file in FILES
        if room_of(module) == room
        for name in imports(file)
        if room_of(name) not in allowed(room) | {room}
    ]
    assert not wrong


def test_the_order_of_rooms_has_no_cycle():
    for table in (KERNEL_ROOMS, ROOMS, SIMS_ROOMS):
        done: set[str] = set()
        for room, below in table.items():
            assert below <= done, f"{room} stands before what it imports"
            done.add(room)


# Inside the generative model, from the ground up; a part imports itself and those above it in this list.
GENERATIVE_PARTS = [
    "report",
    "observations",
    "rotations",
    "parameters",
    "prediction",
    "least_squares",
    "reconstruction",
    "kinematics",
    "inference",
    "learning",
    "model_checks",
    "model_file",
    "model",
]


def test_the_parts_of_the_generative_model_import_downward_only():
    home, wrong = "dense_vs.generative", []
    for module, file in FILES:
        part = module.removeprefix(f"{home}.").split(".")[0]
        if not module.startswith(f"{home}."):
            continue
        below = GENERATIVE_PARTS[: GENERATIVE_PARTS.index(part) + 1]
        for name in imports(file):
            if name.startswith(f"{home}.") and name.split(".")[2] not in below:
                wrong.append(f"{module} imports {name}")
            if name == home:
                wrong.append(f"{module} imports the face of its own room")
    assert not wrong


LINES_OF_A_FILE, LINES_OF_A_FUNCTION, LINES_OF_A_KERNEL = 400, 80, 120
# What is still longer than that; nothing may be added.
TOO_LONG = {}


def has_kernels(function) -> bool:
    """Whether it is a Warp kernel or function, or a factory of some."""
    decorators = (ast.unparse(one) for node in ast.walk(function) for one in getattr(node, "decorator_list", ()))
    return any(name.startswith(("wp.kernel", "wp.func", "kernel")) for name in decorators)


def too_long(file: Path) -> set[str]:
    """Names of functions that are too long, and "" where the file is."""
    text = file.read_text(encoding="utf-8")
    found = {""} if len(text.splitlines()) > LINES_OF_A_FILE else set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            most = LINES_OF_A_KERNEL if has_kernels(node) else LINES_OF_A_FUNCTION
            if node.end_lineno - node.lineno + 1 > most:
                found.add(node.name)
    return found


@pytest.mark.parametrize("folder", ["dense_vs", "kernels", "sims", "profiling", "tests", "tools", "examples"])
def test_files_and_functions_fit_a_screen_or_some(folder):
    files = {file.relative_to(ROOT).as_posix(): file for file in sorted((ROOT / folder).rglob("*.py"))}
    found = {name: long for name, file in files.items() if (long := too_long(file))}
    assert not {name: new for name, long in found.items() if (new := long - TOO_LONG.get(name, set()))}


def test_every_package_says_its_duty():
    for module, file in modules():
        if file.name == "__init__.py":
            said = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
            assert len(said.split()) >= 5, f"{module} does not say what it is for"


@pytest.mark.parametrize("room", sorted(set(ROOMS) - {"view", "live", "cli"}))
def test_a_room_says_truly_what_it_may_import(room):
    said = ast.get_docstring(ast.parse((ROOT / "dense_vs" / room / "__init__.py").read_text(encoding="utf-8"))) or ""
    may = said.partition("May import:")[2].partition("\n\n")[0]
    assert {one.split(".")[0] for one in re.findall(r":mod:`dense_vs\.([\w.]+)`", may)} == ROOMS[room]


SUPPRESSED = re.compile(r"#\s*(noqa|(type|pyright):\s*ignore|pragma: no cover)(:?\s*[A-Z]+\d+|\[\w+\])?(?P<reason>.*)")


@pytest.mark.parametrize("folder", ["dense_vs", "kernels", "sims", "profiling", "tests", "tools", "examples"])
def test_a_suppressed_check_gives_its_reason(folder):
    """In words behind it, or in a comment above."""
    for file in sorted((ROOT / folder).rglob("*.py")):
        lines = ["", *file.read_text(encoding="utf-8").splitlines()]
        for number, (above, line) in enumerate(itertools.pairwise(lines), 1):
            found = None if file == Path(__file__) else SUPPRESSED.search(line)
            words = found is None or len(found["reason"].split()) > 2 or above.lstrip().startswith("#")
            assert words, f"{file.relative_to(ROOT)}, line {number}"


def test_no_room_names_the_simulator():
    """Not even in a string: the core finds what is above it by entry points."""
    for module, file in modules():
        if module.startswith("dense_vs.sims"):
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                assert not node.value.startswith("dense_vs.sims"), f"{module}, line {node.lineno}"


@pytest.mark.parametrize(("paper", "equations"), [("DIJE", 17), ("VOS-VS", 23), ("Gothoskar", 15)])
def test_every_equation_is_named_where_it_is_implemented(paper, equations):
    """A reader who searches for "DIJE (14)" lands on the line."""
    text = "\n".join(file.read_text(encoding="utf-8") for _, file in modules())
    assert [number for number in range(1, equations + 1) if f"{paper} ({number})" not in text] == []
