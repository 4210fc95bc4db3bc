"""Speed of a command's start, checked by the modules it may load: names, not milliseconds."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

_TYPER = {"annotated_doc", "shellingham", "typer"}
_MODELS = {"annotated_types", "pydantic", "pydantic_core", "typing_extensions", "typing_inspection"}
_BROKER = {"aiomqtt", "paho"}
_NO_SERVICE = "mqtt://127.0.0.1:9"
"""The discard port, on which nobody listens."""

_RUN = """
import contextlib, io, sys
from companion.cli.main import main
said = io.StringIO()
with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
    try:
        main()
    except SystemExit:
        pass
print(*sorted(sys.modules))
print(said.getvalue())
"""
_ITS_OWN = {"companion", "sitecustomize"}


def loaded(*words: str) -> tuple[set[str], str]:
    """Every module that `companion WORDS` loads, and what it says."""
    ran = subprocess.run([sys.executable, "-c", _RUN, *words], capture_output=True, text=True, check=True)
    modules, answer = ran.stdout.split("\n", maxsplit=1)
    return set(modules.split()), answer


def foreign(modules: set[str]) -> set[str]:
    """Packages that are neither Python's nor ours."""
    tops = {name.partition(".")[0] for name in modules} - set(sys.stdlib_module_names) - _ITS_OWN
    return {name for name in tops if not name.startswith("_")}


@pytest.mark.parametrize("words", [(), ("--help",), ("--version",), ("help",), ("stop",)])
def test_what_only_lists_commands_loads_typer_alone(words: tuple[str, ...]) -> None:
    modules, _ = loaded(*words)
    parses = words in {("help",), ("stop",)}  # typer parses a word by pydantic
    assert foreign(modules) <= _TYPER | (_MODELS if parses else set())
    assert not modules & {
        "asyncio",
        "ssl",
        "logging.handlers",
        "companion.core.types",
        "companion.config.companion_config",
    }


@pytest.mark.parametrize("words", [("arms",), ("arms", "--help"), ("arms", "live", "--help")])
def test_a_group_lists_its_commands_without_importing_them(words: tuple[str, ...]) -> None:
    modules, _ = loaded(*words)
    assert foreign(modules) <= _TYPER | _MODELS
    assert not modules & {"companion.cli.arms.commands", "companion.cli.arms.live", "asyncio"}


@pytest.mark.parametrize(("command", "draws"), [("status", False), ("watch", False), ("hold", True), ("arms", True)])
def test_a_command_to_the_service_answers_without_numpy(command: str, draws: bool) -> None:
    words = ("arms", "live", "hold") if command == "arms" else (command,)
    modules, answer = loaded(*words, "--broker", _NO_SERVICE)
    assert answer.startswith("companion: no broker at"), "it came to its answer"
    assert foreign(modules) <= _TYPER | _MODELS | _BROKER | ({"rich"} if draws else set())
    assert not modules & {
        "companion.core.types",
        "companion.config.companion_config",
        "companion.config.trajectory_files",
    }


def test_a_list_of_records_needs_neither_numpy_nor_rich(tmp_path: Path) -> None:
    modules, answer = loaded("records", str(tmp_path))
    assert answer.startswith("no records in")
    assert foreign(modules) <= _TYPER | _MODELS | {"mcap", "lz4", "zstandard"}


@pytest.mark.parametrize("command", ["serve", "demo", "simulate", "report"])
def test_no_command_loads_matplotlib_before_it_draws(command: str) -> None:
    modules, _ = loaded(command, "--help")
    assert "matplotlib" not in modules
    devices = {"mavsdk", "qtm_rt", "dynamixel_sdk"}
    if command in {"simulate", "report"}:
        assert not modules & devices, "it speaks to no device"
