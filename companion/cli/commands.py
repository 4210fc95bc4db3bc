"""Every command by name, and how any of them ends."""

import signal
import sys
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from companion import __version__
from companion.ports import CompanionError

BAD_INPUT = 2

COMMANDS = {
    "demo": "companion.cli.demo:demo",
    "simulate": "companion.cli.simulate:simulate",
    "experiments": "companion.cli.experiments:experiments",
    "sweep": "companion.cli.sweep:sweep",
    "tune": "companion.cli.tune:tune",
    "arms": "companion.cli.arms:app",
    "preflight": "companion.cli.preflight:preflight",
    "dry-run": "companion.cli.dry_run:dry_run",
}
"""Where each command is: a function, or a group of commands."""


class _Imported(dict[str, Any]):
    """Commands by name; a command's module is imported when that command is wanted: all together take seconds."""

    def __getitem__(self, name: str) -> Any:
        module, attribute = super().__getitem__(name).split(":")
        found = getattr(import_module(module), attribute)
        if not isinstance(found, typer.Typer):
            alone = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
            alone.command(name)(found)
            found = alone
        command = typer.main.get_command(found)
        command.name = name
        signal.signal(signal.SIGINT, signal.default_int_handler)  # from here on the command minds it, see main.py
        return command

    def get(self, name: str, default: Any = None) -> Any:
        return self[name] if name in self else default  # noqa: SIM401 - that is what it is for


class _Group(TyperGroup):
    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = _Imported(COMMANDS)

    def invoke(self, ctx: Any) -> Any:
        """Ctrl-C while a command is imported or begins, before it minds that itself, is not typer's to word."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise InterruptedError from error


app = typer.Typer(
    cls=_Group,
    no_args_is_help=True,
    add_completion=False,
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
