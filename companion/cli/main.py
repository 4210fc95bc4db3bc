"""The `companion` command."""

import sys
from typing import Annotated

import typer

from companion import __version__
from companion.cli import arms, demo, experiments, simulate, sweep
from companion.ports import CompanionError

BAD_INPUT = 2

app = typer.Typer(
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


app.command("demo")(demo.demo)
app.command("simulate")(simulate.simulate)
app.command("experiments")(experiments.experiments)
app.command("sweep")(sweep.sweep)
app.add_typer(arms.app, name="arms")


def main() -> None:
    """Run the command line; what is the user's to mend is one sentence and an exit code, never a traceback."""
    try:
        app()
    except CompanionError as error:
        typer.echo(f"companion: {error}", err=True)
        sys.exit(BAD_INPUT)


if __name__ == "__main__":
    main()
