"""`companion records merge`: the records of a vehicle and of its law on the ground in one file."""

from pathlib import Path
from typing import Annotated

import typer

from companion.cli.output import check_file, check_folder_of, kept
from companion.cli.working import working
from companion.core.errors import ConfigError


def merge_command(
    vehicle: Annotated[Path, typer.Argument(metavar="VEHICLE", help="Record of `companion serve`.")],
    ground: Annotated[Path, typer.Argument(metavar="GROUND", help="Record of `companion law` of the same flight.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write the file here.  [default: VEHICLE-merged.mcap]")
    ] = None,
) -> None:
    """Put the two records of a flight by a law on the ground into one file, which report and Foxglove show.

    The ground's topics begin with /ground/; its times are converted to the vehicle's clock. Exit code 2 where the two
    are not of one flight.
    """
    from companion.records.split.merge import merge  # noqa: PLC0415 - nothing that --help would wait for

    into = out or vehicle.with_name(f"{vehicle.stem}-merged.mcap")
    if into in {vehicle, ground}:
        raise ConfigError(f"--out {into} is one of the records: give the file another name")
    check_folder_of(into, "out")
    check_file(into, "out")
    done = []
    with working(f"merging {vehicle.name} and {ground.name}"):
        lost = kept(into, lambda to: done.append(merge(vehicle, ground, to)))
    if lost:
        raise ConfigError(lost)
    (merged,) = done
    typer.echo(
        f"{into}: session {merged.session}, {merged.ground_messages} messages of the ground, whose clock is "
        f"{-merged.offset_s:+.6f} s from the vehicle's"
    )
