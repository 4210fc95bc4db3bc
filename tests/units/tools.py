"""Running a program and reading all that it prints."""

import os
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
SYSTEMD = ROOT / "systemd"


def said(*command: str | Path, code: int = 0) -> str:
    """Return all that the command prints; it must end with this exit code."""
    path = f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"
    words = [str(word) for word in command]
    done = subprocess.run(words, capture_output=True, text=True, check=False, env={**os.environ, "PATH": path})
    out = done.stdout + done.stderr
    assert done.returncode == code, out
    return out
