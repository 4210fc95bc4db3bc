"""The panel of `companion status`, and the lines of `companion watch`."""

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from companion.cli.operator.output_formats import phase_of, words_of
from companion.cli.terminal import show_cursor
from companion.client import client
from companion.client.messages import Link, Message
from companion.client.pending_command import armed_of
from companion.protocol.telemetry import WAITING, Happened, Kind, LawLink, Presence, State

_SILENT_S = 1.0
_OLD_S = 0.5
"""Age above which a pose is said to be old."""
_REFRESH_HZ = 5.0
_LAST = ("autopilot", "fault", "warning")
"""Rows at the end of the table of several vehicles, in this order."""
_STYLES = {Kind.FAULT: "yellow", Kind.PHASE: "bold", Kind.COMMAND: "cyan", Kind.REPLY: "cyan"}


def show_once(consoles: Sequence[client.Console]) -> None:
    """Print the panel with the newest states once."""
    Console(highlight=False).print(panels(consoles))


@contextmanager
def live_panel(consoles: Sequence[client.Console]) -> Iterator[None]:
    """Show the panel live until the block ends."""
    out = Console(highlight=False)
    with Live(console=out, refresh_per_second=_REFRESH_HZ, transient=False, get_renderable=lambda: panels(consoles)):
        show_cursor(out)
        yield


def show_event(message: Message, vehicle: str = "") -> None:
    """Print an event as one line with its time of day, and the vehicle's name if given."""
    Console(highlight=False, soft_wrap=True).print(_event(message, f"{vehicle}: " if vehicle else ""))


def _event(message: Message, who: str) -> Text:
    if isinstance(message, Happened):
        return Text(f"{_clock(message.time_s)}  {who}{words_of(message)}", style=_STYLES.get(message.kind, ""))
    if isinstance(message, Presence):
        text = f"the service runs, version {message.version}" if message.online else "the service is gone"
        return Text(f"{_clock(time.time())}  {who}{text}", style="" if message.online else "red")
    assert isinstance(message, Link)
    text = "connected again" if message.there else message.why
    return Text(f"{_clock(time.time())}  {who}{text}", style="yellow")


def _clock(time_s: float) -> str:
    return time.strftime("%H:%M:%S", time.localtime(time_s))


def panels(consoles: Sequence[client.Console]) -> RenderableType:
    """Return the panel of one vehicle, or a table with a column for each."""
    if len(consoles) == 1:
        return panel(consoles[0])
    table = Table(box=None, pad_edge=False)
    table.add_column(style="dim", no_wrap=True)
    columns = []
    for console in consoles:
        warning, state = warning_of(console), console.state
        assert state is not None
        table.add_column(Text(console.vehicle, style="bold"), overflow="fold", style="dim" if warning else "")
        columns.append([("link", Text(warning, style="red"))] * bool(warning) + _rows(state))
    for name in _merged([[name for name, _ in rows] for rows in columns]):
        table.add_row(name, *(Text("\n").join(value for of, value in rows if of == name) for rows in columns))
    return table


def _merged(lists: Sequence[Sequence[str]]) -> list[str]:
    """Return all names once, each behind the one that it follows in its own list; those of _LAST at the end."""
    merged: list[str] = []
    for names in lists:
        place = 0
        for name in names:
            if name not in merged:
                merged.insert(place, name)
            place = merged.index(name) + 1
    return sorted(merged, key=lambda name: _LAST.index(name) if name in _LAST else -1)


def panel(console: client.Console) -> RenderableType:
    """Return the newest state as a table, with a warning when it is old."""
    state, warning = console.state, warning_of(console)
    assert state is not None
    table = Table(box=None, show_header=False, pad_edge=False, style="dim" if warning else "")
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    for name, value in _rows(state):
        table.add_row(name, value)
    return Group(Text(console.where, style="dim"), *([Text(warning, style="red")] if warning else []), table)


def warning_of(console: client.Console) -> str:
    """Return why the newest state is not the vehicle's state now; empty while it is."""
    age_s, presence = console.state_age_s(), console.presence
    if not console.linked:
        return f"no connection to the broker for {age_s:.0f} s"
    if age_s > _SILENT_S:  # any client could have published a status
        gone = presence is not None and not presence.online
        return f"the service does not run; last heard {age_s:.0f} s ago" if gone else f"nothing heard for {age_s:.0f} s"
    waited_s = console.state_waited_s()
    if not waited_s:
        return ""
    return f"this is {waited_s:.1f} s old: the network or the broker is slow, or the two computers' clocks differ"


def _rows(state: State) -> list[tuple[str, Text]]:
    """Return names and values of what is known, in the order of the panel."""
    flies = {True: ", in the air", False: ", on the ground", None: ""}[state.in_air]
    rows = [("phase", f"{phase_of(state)}{f': {state.reason}' if state.reason else ''}")]
    if state.phase != WAITING:
        rows.append(("vehicle", f"{armed_of(state)}{flies}"))
    if state.mode:
        rows.append(("PX4 mode", state.mode))
    if state.doing is not None:
        rows.append(("doing", f"{state.doing.verb}{f': {state.doing.text}' if state.doing.text else ''}"))
    rows += _motion(state)
    if state.battery is not None:
        volts = "" if state.battery_v is None else f", {state.battery_v:.1f} V"
        rows.append(("battery", f"{state.battery:.0%}{volts}"))
    if state.controller:
        share = "" if state.sent_share is None else f", updates in {state.sent_share:.0%} of its cycles"
        rows.append(("controller", f"{state.controller}{share}"))
    if state.law_link is not None:
        rows += _law_link(state.law_link)
    if state.arms is not None:
        rows.append(("arms", state.arms))
    if state.text:
        when = "" if state.text_age_s is None else f" ({state.text_age_s:.0f} s ago)"
        rows.append(("autopilot", f"{state.text}{when}"))
    return [
        *((name, Text(value)) for name, value in rows),
        *(("fault", Text(fault, style="yellow")) for fault in state.faults),
        *(("warning", Text(warning, style="red")) for warning in state.warnings),
    ]


def _law_link(link: LawLink) -> list[tuple[str, str]]:
    """Return the place of a law on the ground, and how its link does."""
    if not link.connected:
        return [("ground law", f"none{f'; refused: {link.refused}' if link.refused else ''}")]
    sees = ", its law has failed" if link.failed else ", without a fresh pose" if link.blind else ""
    times = [
        _milliseconds("silent for", link.silence_s),
        _milliseconds("commands' age", link.age_s),
        _milliseconds("round trip", link.round_trip_s),
    ]
    sent = link.received + link.missing + link.late
    counts = f"{sent} messages/s, {link.missing} lost, {link.late} late"
    foreign = f", {link.foreign} foreign" if link.foreign else ""
    return [("ground law", f"{link.host}{sees}"), ("its link", f"{', '.join([*times, counts])}{foreign}")]


def _milliseconds(what: str, time_s: float | None) -> str:
    return f"{what} not known" if time_s is None else f"{what} {1e3 * time_s:.1f} ms"


def _motion(state: State) -> list[tuple[str, str]]:
    rows = []
    if state.position_w_m is not None:
        x_m, y_m, z_m = state.position_w_m
        yaw = "" if state.yaw_rad is None else f", yaw {state.yaw_rad:+.2f} rad"
        old = f", {state.age_s:.1f} s old" if state.age_s is not None and state.age_s > _OLD_S else ""
        rows.append(("position", f"{x_m:+.2f} {y_m:+.2f} {z_m:+.2f} m{yaw}{old}"))
    if state.velocity_w_mps is not None:
        tilt = "" if state.tilt_rad is None else f", tilt {state.tilt_rad:.2f} rad"
        rows.append(("speed", f"{math.hypot(*state.velocity_w_mps):.2f} m/s{tilt}"))
    if state.error_m is not None:
        rows.append(("error", f"{100.0 * state.error_m:.1f} cm"))
    return rows
