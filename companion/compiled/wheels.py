"""Wheels with the compiled law, for computers without a C compiler: `python -m companion.compiled.wheels [FOLDER]`.

One for each machine that a compiler is there for, this computer's own or a cross compiler. Its name says the oldest
glibc that has what the code calls.
"""

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from companion.compiled.library import MACHINE, build, library_path

COMPILERS = {"x86_64": "x86_64-linux-gnu-gcc", "aarch64": "aarch64-linux-gnu-gcc"}
"""Names as on Debian."""
_ROOT = Path(__file__).parents[2]
_PARTS = ("companion", "mock_autopilot", "pyproject.toml", "README.md", "LICENSE")
_VERSION = re.compile(r"\bGLIBC_2\.(\d+)\b")


def main(arguments: list[str] | None = None) -> int:
    """Return 0 when a wheel for this computer, and for every machine that was asked for, was written."""
    parser = argparse.ArgumentParser(prog="python -m companion.compiled.wheels", description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("dist"), help="where to write (default dist)")
    parser.add_argument("--machine", action="append", choices=sorted(COMPILERS), help="repeatable; default: all there")
    options = parser.parse_args(arguments)
    options.folder.mkdir(parents=True, exist_ok=True)
    wanted = options.machine or [MACHINE, *(one for one in COMPILERS if one != MACHINE and _compiler(one))]
    return max(_write(machine, options.folder) for machine in wanted)


def _compiler(machine: str) -> str | None:
    names = (COMPILERS[machine], "cc") if machine == MACHINE else (COMPILERS[machine],)
    return next((name for name in names if shutil.which(name)), None)


def _write(machine: str, folder: Path) -> int:
    if machine not in COMPILERS:
        return _without(machine, f"they are for {' and '.join(COMPILERS)}")
    compiler = _compiler(machine)
    if compiler is None:
        return _without(machine, f"there is no {COMPILERS[machine]}; on Debian: apt-get install {_package(machine)}")
    with tempfile.TemporaryDirectory() as temporary:
        source = Path(temporary)
        _copy_to(source)
        compiled = source / "companion" / "compiled"
        said = build(compiled, machine, compiler)
        if not library_path(compiled, machine).is_file():
            return _without(machine, said)
        glibc = _oldest_glibc(compiled)
        if glibc is None:
            return _without(machine, f"{compiler} compiles for another C library than glibc")
        platform = f"manylinux_2_{glibc}_{machine}"
        command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
        options = ["-C", f"--build-option=--plat-name={platform}", "-w", str(folder)]
        code = subprocess.run([*command, *options, str(source)], check=False).returncode  # noqa: S603
    if code == 0:
        sys.stdout.write(f"{machine}: {said}; its wheel for {platform} is in {folder}\n")
    return code


def _without(machine: str, why: str) -> int:
    sys.stderr.write(f"no wheel for {machine}: {why}\n")
    return 1


def _package(machine: str) -> str:
    return f"gcc-{machine.replace('_', '-')}-linux-gnu"


def _copy_to(folder: Path) -> None:
    """Copy what a wheel is made of, so that nothing of an earlier build is in it, and nothing stays in the checkout."""
    leave = shutil.ignore_patterns("_flight*", "__pycache__")
    for part in _PARTS:
        if (_ROOT / part).is_dir():
            shutil.copytree(_ROOT / part, folder / part, ignore=leave)
        else:
            shutil.copy(_ROOT / part, folder / part)


def _oldest_glibc(compiled: Path) -> int | None:
    """Return the n of the oldest glibc 2.n that has all that the libraries call; None where it is another library."""
    command = ["readelf", "-W", "--dyn-syms", *map(str, compiled.glob("_flight*.so"))]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout  # noqa: S603
    return max((int(minor) for minor in _VERSION.findall(said)), default=None)


if __name__ == "__main__":
    sys.exit(main())
