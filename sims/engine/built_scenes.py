"""Where scenes of commercial arms lie once ``dense-vs arms`` has built them, and by which name they are asked for.

Nothing of these arms is part of this project: their meshes come from packages that others publish.
"""

import os
from pathlib import Path

from dense_vs.errors import DenseVSError

TUNED_ARMS = ("panda", "ur5e", "baxter", "fetch")  # constants were found on some of their views
OTHER_ARMS = ("spot-arm", "tiago", "gr1")  # no constant was found on them
ARM_NAMES = TUNED_ARMS + OTHER_ARMS
FOLDER_VARIABLE = "DENSE_VS_ARMS"


def scenes_folder() -> Path:
    """``$DENSE_VS_ARMS``, else ``dense-vs/arms`` in the user's cache folder."""
    chosen = os.environ.get(FOLDER_VARIABLE)
    if chosen:
        return Path(chosen)
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "dense-vs" / "arms"


def scene_file(name: str) -> Path:
    """MJCF file of a built scene.

    Raises:
        DenseVSError: it has not been built yet.
    """
    path = scenes_folder() / name / "scene.xml"
    if not path.is_file():
        raise DenseVSError(f"the scene of robot {name!r} has not been built; run 'dense-vs arms {name}' once")
    return path
