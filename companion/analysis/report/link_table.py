"""Numbers of the link to a law on the ground as a table. Pure."""

from collections.abc import Sequence

from companion.analysis.report.link_numbers import LinkNumbers
from companion.analysis.report.number_tables import ms
from companion.analysis.report.tables import Cell, Grid

_COLUMNS = (
    "", "messages (1/s)", "events", "again", "beats", "lost", "payload (B/s)", "down (1/s)", "down (B/s)",
    "age, median (ms)", "99 %", "max", "longest silence (ms)",
)  # fmt: skip


def link_table(links: Sequence[LinkNumbers]) -> Grid | None:
    """Return the table of messages, bytes and ages; None for a law on board."""
    if not links:
        return None
    whole = links[-1]
    note = (
        "Messages up to the vehicle: events bring a new command, again repeats one that was not acknowledged, beats "
        f"only show that the ground is alive; a plain stream would send {whole.cycles_per_s:.0f} a second. Payload: "
        "with tags, without the headers of IP and UDP; down: reports and plans of the vehicle. Age: from the sending "
        "to the arrival. Silence: time since the ground has confirmed the command in use."
    )
    return Grid("Link to the law on the ground", _COLUMNS, tuple(map(_row, links)), note)


def _row(link: LinkNumbers) -> tuple[Cell, ...]:
    messages = max(link.events + link.again + link.beats, 1)
    return (
        Cell(link.name), Cell(f"{link.messages_per_s:.1f}"), Cell(str(link.events)), Cell(str(link.again)),
        Cell(str(link.beats)), Cell(f"{link.lost / messages:.1%}"), Cell(f"{link.bytes_per_s:.0f}"),
        Cell(f"{link.messages_down_per_s:.1f}"), Cell(f"{link.bytes_down_per_s:.0f}"),
        ms(link.age_median_s), ms(link.age_p99_s), ms(link.age_max_s), ms(link.silence_max_s),
    )  # fmt: skip
