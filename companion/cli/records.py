"""`companion records`: which flights there are, and their numbers for other programs."""

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from companion.config_records import RecordsConfig
from companion.ports import ConfigError
from companion.records.export import export_csv
from companion.records.glance import Glance, glance
from companion.records.read import RecordError, read_flight


def records(
    where: Annotated[Path | None, typer.Argument(help="A folder of records, or one record.")] = None,
    csv: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the record as CSV tables to this folder.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """List flights, newest last; or write one as CSV. Exit code 2 for what is no record."""
    where = where or Path(RecordsConfig().folder)
    console = Console()
    if csv is not None:
        if not where.is_file():
            raise ConfigError(f"{where}: --csv needs one record, as `companion records FLIGHT.mcap --csv {csv}`")
        for path in export_csv(read_flight(where), csv):
            console.print(str(path), markup=False, highlight=False, soft_wrap=True)
        return
    found, bad = _glances(where)
    if as_json:
        typer.echo(json.dumps([_as_dict(one) for one in found], indent=2))
    elif found:
        console.print(_table(found))
    else:
        console.print(f"no records in {where}", markup=False, highlight=False, soft_wrap=True)
    for sentence in bad:
        typer.echo(f"companion: {sentence}", err=True)


def _glances(where: Path) -> tuple[list[Glance], list[str]]:
    """All records, oldest first by name; and sentences about files that are none."""
    if where.is_file():
        return [glance(where)], []
    if not where.is_dir():
        raise ConfigError(f"{where}: there is no such folder")
    found, bad = [], []
    for path in sorted([*where.glob("*.mcap"), *where.glob("*.npz")]):
        try:
            found.append(glance(path))
        except RecordError as error:
            bad.append(str(error))
    return found, bad


def _as_dict(one: Glance) -> dict[str, object]:
    begin_s = None if math.isnan(one.begin_s) else one.begin_s
    return asdict(one) | {"path": str(one.path), "begin_s": begin_s}


def _table(found: list[Glance]) -> Table:
    table = Table(box=None, expand=True)
    for head in ("record", "length", "size", "law"):
        table.add_column(head, justify="right" if head in {"length", "size"} else "left", no_wrap=True)
    table.add_column("ended", no_wrap=True, ratio=1)
    for one in found:
        ended = " ".join(f"breaks off in {one.ended}".split() if one.truncated else one.ended.split())
        table.add_row(*map(Text, (one.path.name, f"{one.length_s:.0f} s", f"{one.size_mb:.1f} MB", one.law, ended)))
    return table
