"""Run a measuring program with the arguments that its committed result names.

    python profiling/as_committed.py surfaces surfaces_7 --jobs 8 --json out/surfaces_7.json

The first word is the program, the second the result in ``profiling/results``. Options after them go before those of the
result. What belongs to a machine and not to what is measured is not repeated: where data lie, jobs, a limit of time,
that a run was gone on with.
"""

import json
import os
import shlex
import sys
from pathlib import Path
from typing import Any

from results_file import RESULTS

FOLDER = Path(__file__).parent
OF_A_MACHINE = ("data", "out", "jobs", "limit", "resume")
OFF = {"body_model": "--no-model"}  # flags that are switched off by another name


def options_of(arguments: dict[str, Any], program: str) -> list[str]:
    """Arguments of a result as they are typed.

    Args:
        arguments: as the result holds them.
        program: its source, which tells whether a flag is switched on (``--name``) or off (``--no-name``).
    """
    words: list[str] = []
    for name, value in arguments.items():
        option = f"--{name.replace('_', '-')}"
        off = OFF.get(name, f"--no-{option.removeprefix('--')}")
        if name in OF_A_MACHINE or value is None or value == "":
            continue
        if isinstance(value, bool):
            if f'"{option}"' in program:
                words += [option] if value else []
            elif f'"{off}"' in program:
                words += [] if value else [off]
            else:
                raise SystemExit(f"the program has no option for {name}; expected {option} or {off}")
        else:
            words += [option, *map(str, value if isinstance(value, list) else [value])]
    return words


def main() -> None:
    """Run the command."""
    if len(sys.argv) < 3:
        raise SystemExit(__doc__)
    program, name, *more = sys.argv[1:]
    script = FOLDER / f"{program}.py"
    arguments = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))["arguments"]
    words = [str(script), *options_of(arguments, script.read_text(encoding="utf-8")), *more]
    print("python", shlex.join(words), flush=True)
    os.execv(sys.executable, [sys.executable, *words])


if __name__ == "__main__":
    main()
