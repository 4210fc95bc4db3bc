"""`companion records`: the list of flights, and their data for other programs."""

import json
import math
import shutil
import sys
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from companion.cli.working import Counted, working
from companion.core.errors import ConfigError

if TYPE_CHECKING:
    from companion.records.flight_summary import FlightSummary

_ANY = 100_000
"""Width of a file or a pipe, in columns."""
_NARROWEST = 16
"""Fewest columns for a wrapped reason; with fewer, the terminal wraps it."""


def records(
    where: Annotated[
        Path | None, typer.Argument(help="A folder of records, or one record.  [default: as configured]")
    ] = None,
    csv: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the record as CSV tables to this folder.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """List flights, newest last; or write one as CSV. Exit code 2 for a file that is no record.

    Files that are no records are listed as unreadable; the reasons follow the list.
    """
    where = where or _configured_folder()
    if csv is not None:
        _write_csv(where, csv)
        return
    found = _flight_summaries(where)
    if as_json:
        typer.echo(json.dumps([_as_dict(one) for one in found], indent=2))
    else:
        _show(found, where)
    for one in found:
        if one.unreadable:
            typer.echo(f"companion: {one.unreadable}", err=True)


def _configured_folder() -> Path:
    """Return the records folder of this computer's service; ./flights where none is installed."""
    from companion.config.locations import INSTALLED, is_installed  # noqa: PLC0415
    from companion.config.records_config import RecordsConfig  # noqa: PLC0415
    from companion.config.toml_files import read_toml, validate  # noqa: PLC0415 - nothing that --help would wait for

    if not is_installed():
        return Path(RecordsConfig().folder)
    typer.echo(f"companion: configuration {INSTALLED}", err=True)
    return Path(validate(RecordsConfig, read_toml(INSTALLED).get("records", {}), INSTALLED, "records").folder)


def _write_csv(where: Path, folder: Path) -> None:
    from companion.records.export import export_csv  # noqa: PLC0415
    from companion.records.read import read_flight  # noqa: PLC0415

    if where.is_dir():
        raise ConfigError(f"{where}: --csv needs one record, as `companion records FLIGHT.mcap --csv {folder}`")
    with working(f"reading {where.name}"):
        record = read_flight(where)
    with working(f"writing {len(record.columns['time_s'])} ticks to {folder}"):
        paths = export_csv(record, folder)
    for path in paths:
        typer.echo(path)


def _flight_summaries(where: Path) -> list["FlightSummary"]:
    """Return the summaries of all records in a folder, newest last, or of one record."""
    from companion.records.flight_summary import summarize_flight  # noqa: PLC0415
    from companion.records.index import flight_summaries  # noqa: PLC0415

    if where.is_dir():
        with Counted("records read") as progress:
            return flight_summaries(where, progress)
    if not where.exists():
        raise ConfigError(f"{where}: no such folder or record")
    return [summarize_flight(where)]


def _as_dict(one: "FlightSummary") -> dict[str, object]:
    values = {name: getattr(one, name) for name in one.__dataclass_fields__}
    plain = {name: None if isinstance(value, float) and math.isnan(value) else value for name, value in values.items()}
    return plain | {"path": str(one.path)}


def _show(found: list["FlightSummary"], where: Path) -> None:
    if not found:
        typer.echo(f"no records in {where}")
        return
    rows = [("record", "length", "size", "law", "ended"), *map(_row, found)]
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    room = shutil.get_terminal_size((80, 24)).columns - sum(widths) - 2 * len(widths)
    lines = [_line(row, widths, room if sys.stdout.isatty() else _ANY) for row in rows]
    typer.echo("\n".join(lines))


def _row(one: "FlightSummary") -> tuple[str, ...]:
    length = "" if math.isnan(one.length_s) else f"{one.length_s:.0f} s"
    ended = "unreadable" if one.unreadable else f"breaks off in {one.ended}" if one.truncated else one.ended
    return one.path.name, length, f"{one.size_mb:.1f} MB", one.law, " ".join(ended.split())


def _line(row: tuple[str, ...], widths: list[int], room: int) -> str:
    """Return a row of the list; a reason that does not fit beside the rest goes on below."""
    name, length, size, law = widths
    head = f"{row[0]:<{name}}  {row[1]:>{length}}  {row[2]:>{size}}  {row[3]:<{law}}  "
    parts = textwrap.wrap(row[4], room) if room >= _NARROWEST else [row[4]]
    return ("\n" + " " * len(head)).join([head + parts[0] if parts else head.rstrip(), *parts[1:]])
