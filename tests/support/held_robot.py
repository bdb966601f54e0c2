"""What the watchdog's test lets it call: writes down that the robot was told to hold."""

import json
from pathlib import Path


def hold(path: str, robot: str) -> None:
    """Write the robot's name to a file; the first time it fails, as a bus that is not free yet."""
    file = Path(path)
    if not file.with_suffix(".tried").exists():
        file.with_suffix(".tried").touch()
        raise ConnectionError("the port is busy")
    file.write_text(json.dumps({"held": robot}))
