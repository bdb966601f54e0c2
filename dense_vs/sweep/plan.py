"""Reads the file that says what to run: every combination of options and seeds becomes a task."""

import os
import re
import tomllib
from collections.abc import Iterator
from itertools import product
from typing import Any

from dense_vs.checks import shown
from dense_vs.errors import DenseVSError
from dense_vs.files import input_file
from dense_vs.sweep.task import Task

MOST_BYTES = 16 << 20  # of a sweep file; it names at most 100,000 tasks
_ALLOWED = {"command", "arguments", "seeds", "options"}
_OURS = {"out", "json", "seed"}
_MOST = 100_000  # tasks; more is taken for a slip


def read_plan(path: str | os.PathLike[str]) -> list[Task]:
    """The tasks of a sweep file, in its order.

    The file is TOML with one ``[[experiment]]`` for each command::

        [[experiment]]
        command = "reach"             # or "reproduce dije labels"
        seeds = "0:8"                 # 0 to 7, or a list; left out for a command that takes no --seed
        [experiment.options]
        robot = ["arm", "planar"]     # a list is swept over; a list in it is one value of several words
        targets = 3
        no-video = true               # a flag

    Raises:
        DenseVSError: unreadable, not TOML, with names it does not know, or with the same task twice.
    """
    path = input_file(path, "a sweep file", most=MOST_BYTES)
    try:
        with open(path, "rb") as stream:
            content = tomllib.load(stream)
    except (OSError, ValueError, RecursionError) as error:  # ValueError also of a number with too many digits
        raise DenseVSError(f"cannot read {path} as a sweep file: {error}") from error
    experiments = content.get("experiment")
    if set(content) != {"experiment"} or not isinstance(experiments, list) or not experiments:
        found = ", ".join(sorted(content)) or "nothing"
        raise DenseVSError(f"{path} holds {found}; expected [[experiment]] tables and nothing else")
    tasks: dict[str, Task] = {}
    for number, experiment in enumerate(experiments, start=1):
        where = f"{path}, experiment {number}"
        for task in _tasks(experiment, where):
            if task.name in tasks:
                raise DenseVSError(f"{where} asks again for: {' '.join(task.arguments)}")
            tasks[task.name] = task
            if len(tasks) > _MOST:
                raise DenseVSError(f"{path} asks for more than {_MOST} tasks")
    return list(tasks.values())


def _tasks(experiment: Any, where: str) -> Iterator[Task]:
    if not isinstance(experiment, dict) or not set(experiment) <= _ALLOWED:
        unknown = sorted(set(experiment) - _ALLOWED) if isinstance(experiment, dict) else [str(experiment)]
        raise DenseVSError(f"{where} has {', '.join(unknown)}; expected some of {', '.join(sorted(_ALLOWED))}")
    command = experiment.get("command")
    if not isinstance(command, str) or not command.split() or command.split()[0] == "sweep":
        raise DenseVSError(f"{where} has command {shown(command)}; expected the words of a command other than sweep")
    words = (*command.split(), *_words(experiment.get("arguments", []), f"{where}, arguments"))
    options = experiment.get("options", {})
    if not isinstance(options, dict):
        raise DenseVSError(f"{where} has options {shown(options)}; expected a table")
    if taken := sorted(_OURS & set(options)):
        raise DenseVSError(f"{where} sets {', '.join(taken)}; seeds are given by 'seeds', and files go to the sweep's")
    choices = [[(name, value) for value in _values(options[name], f"{where}, {name}")] for name in options]
    for chosen in product(*choices):
        arguments = [*words]
        for name, value in chosen:
            arguments += _option(name, value, where)
        group = " ".join(arguments)
        for seed in _seeds(experiment.get("seeds"), where):
            of_seed = () if seed is None else ("--seed", str(seed))
            task = Task("", group, (*arguments, *of_seed), seed)
            yield Task(f"{words[0]}-{task.key('')}", group, task.arguments, seed)


def _values(value: Any, where: str) -> list[Any]:
    if isinstance(value, list) and not value:
        raise DenseVSError(f"{where} is an empty list; expected at least one value")
    return value if isinstance(value, list) else [value]


def _option(name: str, value: Any, where: str) -> list[str]:
    if value is True:
        return [f"--{name}"]
    return [] if value is False else [f"--{name}", *_words(value, f"{where}, {name}")]


def _words(value: Any, where: str) -> list[str]:
    words = value if isinstance(value, list) else [value]
    if any(isinstance(word, bool) or not isinstance(word, str | int | float) for word in words):
        raise DenseVSError(f"{where} is {shown(value)}; expected text, numbers or a list of them")
    try:
        return [str(word) for word in words]
    except ValueError as error:  # a whole number of more digits than Python writes
        raise DenseVSError(f"{where} is {shown(value)}; expected numbers of fewer digits") from error


def _seeds(seeds: Any, where: str) -> list[int | None]:
    if seeds is None:
        return [None]
    if isinstance(seeds, str):
        first, colon, end = seeds.partition(":")
        numbers = colon and all(re.fullmatch("[0-9]{1,20}", part) for part in (first, end))
        if numbers and int(first) < int(end) <= int(first) + _MOST:
            return list(range(int(first), int(end)))
    elif isinstance(seeds, list) and seeds and all(type(seed) is int and 0 <= seed < 1 << 64 for seed in seeds):
        return list(seeds)
    raise DenseVSError(f'{where} has seeds {shown(seeds)}; expected "A:B" for A to B - 1, or a list of whole numbers')
