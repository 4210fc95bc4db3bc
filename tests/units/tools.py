"""The system's own tools, which pip cannot give: without them a test is skipped at a desk, and fails in CI."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SYSTEMD = ROOT / "systemd"


def tool(name: str) -> str:
    """Its path; who lacks it is told the package, see .ci/packages."""
    found = shutil.which(name, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")
    if found is None:
        say = f"{name} is not installed: run .ci/packages as root"
        if os.environ.get("CI"):
            pytest.fail(say)
        pytest.skip(say)
    return found


def said(*command: str | Path, code: int = 0) -> str:
    """All that the command prints; it must end with this exit code."""
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    out = done.stdout + done.stderr
    assert done.returncode == code, out
    return out
