"""Every command by name, and how any of them ends."""

import ast
import signal
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from companion import __version__
from companion.ports import CompanionError

BAD_INPUT = 2

PANELS = {
    "Operate (over MQTT, from any machine)": {
        "status": "companion.cli.operate_look:status",
        "watch": "companion.cli.operate_look:watch",
        "arm": "companion.cli.operate:arm",
        "takeoff": "companion.cli.operate:takeoff",
        "hold": "companion.cli.operate:hold",
        "goto": "companion.cli.operate:goto",
        "track": "companion.cli.operate:track",
        "controller": "companion.cli.operate:controller",
        "land": "companion.cli.operate:land",
        "abort": "companion.cli.operate:abort",
        "resume": "companion.cli.operate:resume",
        "kill": "companion.cli.operate:kill",
        "disarm": "companion.cli.operate:disarm",
        "params": "companion.cli.operate:params",
    },
    "The service": {
        "serve": "companion.cli.serve:serve_command",
        "mocap-bridge": "companion.cli.mocap_bridge:mocap_bridge",
    },
    "The vehicle and its room": {
        "preflight": "companion.cli.operate_preflight:preflight",
        "dry-run": "companion.cli.dry_run:dry_run",
        "arms": "companion.cli.arms:app",
    },
    "After a flight": {
        "records": "companion.cli.records:records",
        "replay": "companion.cli.replay:replay_command",
        "report": "companion.cli.report:report",
        "calibrate": "companion.cli.calibrate:calibrate_command",
    },
    "Without a vehicle": {
        "demo": "companion.cli.demo:demo",
        "simulate": "companion.cli.simulate:simulate",
        "experiments": "companion.cli.experiments:experiments",
        "sweep": "companion.cli.sweep:sweep",
        "tune": "companion.cli.tune:tune",
    },
}
"""Where each command is: a function, or a group of commands; as --help lists them."""
COMMANDS = {name: place for panel in PANELS.values() for name, place in panel.items()}


def _imported(name: str) -> Any:
    """The command itself; only when it is wanted: all together take seconds to import."""
    module, attribute = COMMANDS[name].split(":")
    found = getattr(import_module(module), attribute)
    if not isinstance(found, typer.Typer):
        alone = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
        alone.command(name)(found)
        found = alone
    command = typer.main.get_command(found)
    command.name = name
    signal.signal(signal.SIGINT, signal.default_int_handler)  # from here on the command minds it, see main.py
    return command


def _glance(name: str) -> TyperCommand:
    """What --help and a shell's completion show of a command: its docstring, read without importing it."""
    panel = next(title for title, commands in PANELS.items() if name in commands)
    module, attribute = COMMANDS[name].split(":")
    found = find_spec(module)
    assert found is not None
    assert found.origin is not None
    source = ast.parse(Path(found.origin).read_text(encoding="utf-8"))
    functions = [node for node in source.body if isinstance(node, ast.FunctionDef)]
    says = [
        ast.get_docstring(one) for one in functions if one.name.lstrip("_") == attribute or _is_callback(one, attribute)
    ]
    return TyperCommand(name, help=(says[0] or "") if says else "", rich_help_panel=panel)


def _is_callback(function: ast.FunctionDef, group: str) -> bool:
    """Whether it is the one whose docstring is that of a group of commands."""
    return any(ast.unparse(decorator).startswith(f"{group}.callback(") for decorator in function.decorator_list)


class _Group(TyperGroup):
    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = dict.fromkeys(COMMANDS, TyperCommand(None))  # their names; see get_command

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002 - a method of typer's
        """Enough to be listed."""
        return _glance(cmd_name) if cmd_name in COMMANDS else None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """What runs, or tells its options and arguments."""
        name, command, rest = super().resolve_command(ctx, args)
        return name, None if command is None or name is None else _imported(name), rest

    def invoke(self, ctx: Any) -> Any:
        """Ctrl-C while a command is imported or begins, before it minds that itself, is not typer's to word."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise InterruptedError from error


app = typer.Typer(
    cls=_Group,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback()
def companion(
    version: Annotated[bool, typer.Option("--version", help="Show the version.", is_eager=True)] = False,
) -> None:
    """Flight software of a dual-arm aerial manipulator."""
    if version:
        typer.echo(__version__)
        raise typer.Exit


def run() -> None:
    """Run the command line; what is the user's to mend is one sentence and an exit code, never a traceback.

    Raises KeyboardInterrupt when Ctrl-C came before the command minded it.
    """
    try:
        app()
    except InterruptedError:
        raise KeyboardInterrupt from None
    except CompanionError as error:
        typer.echo(f"companion: {error}", err=True)
        sys.exit(BAD_INPUT)
    except OSError as error:
        if error.filename is None:
            raise
        typer.echo(f"companion: {error.filename}: {error.strerror}", err=True)
        sys.exit(BAD_INPUT)
