"""Wheels bring the compiled law to computers without a C compiler."""

import re
import runpy
import shutil
from pathlib import Path
from zipfile import ZipFile

import pytest

from companion.compiled.library import MACHINE
from companion.compiled.wheels import main


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="without a C compiler there is nothing compiled")
def test_a_wheel_for_this_computer_brings_a_law_that_loads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path), "--machine", MACHINE]) == 0
    (wheel,) = tmp_path.glob("*.whl")
    assert re.fullmatch(rf"dauam_companion-.*-py3-none-manylinux_2_\d+_{MACHINE}\.whl", wheel.name)
    assert wheel.name.removesuffix(".whl").split("none-")[1] in capsys.readouterr().out
    with ZipFile(wheel) as file:
        names = [name for name in file.namelist() if name.startswith("companion/compiled/_flight")]
        file.extractall(tmp_path / "installed")
    assert f"companion/compiled/_flight-{MACHINE}.so" in names
    assert all(name.endswith(f"-{MACHINE}.so") for name in names), "another machine's would never load"
    loaded = runpy.run_path(str(tmp_path / "installed" / "companion" / "compiled" / "library.py"))["library"]()
    assert loaded is not None


def test_another_machine_than_those_two_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("companion.compiled.wheels.MACHINE", "riscv64")
    assert main([str(tmp_path / "dist")]) == 1
    assert capsys.readouterr().err == "no wheel for riscv64: they are for x86_64 and aarch64\n"


def test_without_a_compiler_there_is_no_wheel_and_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main([str(tmp_path / "dist"), "--machine", "aarch64"]) == 1
    assert capsys.readouterr().err == (
        "no wheel for aarch64: there is no aarch64-linux-gnu-gcc; on Debian: apt-get install gcc-aarch64-linux-gnu\n"
    )
    assert not list((tmp_path / "dist").iterdir())
