"""The root of all commands, and how any of them ends."""

import signal
import sys
from typing import Annotated, Any

import typer

from companion import __version__
from companion.cli.catalogue import ROOT
from companion.cli.lazy import SETTINGS, LazyGroup, group_of
from companion.cli.operator.exit_codes import BAD_INPUT
from companion.cli.word_hints import hint_for
from companion.core.errors import CompanionError
from companion.core.validation_messages import plain


class _Root(LazyGroup):
    """The group of all commands, with `help` and hints for words that are no commands."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that runs; `help COMMAND` is COMMAND --help. UsageError, with a hint, for another word."""
        if args[0] == "help":
            return self._help(ctx, args[1:])
        hint = "" if args[0] in self.commands else hint_for(args[0])
        if hint and not ctx.resilient_parsing:
            ctx.fail(f"No such command {args[0]!r}.\n{hint}")
        return super().resolve_command(ctx, args)

    def _help(self, ctx: Any, words: list[str]) -> Any:
        if ctx.resilient_parsing:
            return None, None, []  # the shell completes the names of commands
        if not words:
            typer.echo(ctx.get_help(), color=ctx.color)
            ctx.exit()
        return self.resolve_command(ctx, [*words, "--help"])

    def invoke(self, ctx: Any) -> Any:
        """Run the command; InterruptedError for a Ctrl-C before the command installs its own handler."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise InterruptedError from error
        except typer.BadParameter as error:
            _reword(error)
            raise


def _reword(error: typer.BadParameter) -> None:
    """Replace pydantic's message about an option's value, which typer passes on, by the project's own wording."""
    details: list[Any] = getattr(error.__cause__, "errors", list)()
    said = plain(details[0]) if details else ""
    if said.startswith("must"):  # and not one of typer's own sentences
        error.message = f"{said}, not {details[0]['input']}"


def _restore_interrupts() -> None:
    """Restore Python's handler of Ctrl-C: from here on the command handles it itself, see main.py."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def _print_version(requested: bool) -> None:
    if requested:
        typer.echo(__version__)
        raise typer.Exit


app = typer.Typer(
    cls=group_of(ROOT, _restore_interrupts, _Root),
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings=SETTINGS,
)


@app.callback(help=ROOT.about)
def companion(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version.", is_eager=True, callback=_print_version)
    ] = False,
) -> None:
    """Accept the options that come before a command."""


def run() -> None:
    """Run the command line; a user's mistake ends in one sentence and an exit code, never a traceback.

    Raises KeyboardInterrupt when Ctrl-C came before the command handled it.
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
