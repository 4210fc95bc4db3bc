"""Newest knowledge of all vehicles, and its distribution to every open page."""

import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from companion import __version__
from companion.arms.model import ArmModel
from companion.page import frames
from companion.page.arm_points import arms_b_m, model_of
from companion.page.outlet import Outlet
from companion.protocol.about import About
from companion.protocol.telemetry import Happened, Presence, State

_EVENTS = 200


@dataclass(kw_only=True)
class _Known:
    """Newest messages of one vehicle, ready to send."""

    about: str = ""
    presence: str = ""
    state: State | None = None
    heard_s: float = 0.0
    """Arrival of the state less its age then, monotonic."""
    model: ArmModel | None = None


class Hub:
    """Distributor: what is heard from the broker goes to all pages at once. Never waits."""

    def __init__(self, password: bool) -> None:
        """`password`: whether logging in is possible."""
        self._password = password
        self._vehicles: dict[str, _Known] = {}
        self._outlets: dict[Outlet, bool] = {}
        """Open pages, and whether each may command."""
        self._broker = frames.broker(False, "not connected yet")
        self._events: deque[tuple[str, Happened]] = deque(maxlen=_EVENTS)

    @property
    def vehicles(self) -> tuple[str, ...]:
        """Names of the vehicles."""
        return tuple(self._vehicles)

    @property
    def pages(self) -> int:
        """Number of open pages."""
        return len(self._outlets)

    @contextmanager
    def page(self, can_command: bool) -> Iterator[Outlet]:
        """Open a page's outlet: all that is known is in it first."""
        outlet = Outlet()
        outlet.put(self._hello(can_command))
        outlet.put(self._broker)
        for name, known in self._vehicles.items():
            outlet.put(known.about or frames.about(name, "null"))
            if known.presence:
                outlet.put(known.presence)
            if known.state is not None:
                outlet.show(name, self._state_frame(name, known, known.state))
        for name, event in self._events:
            outlet.put(frames.event(name, event, old=True))
        self._outlets[outlet] = can_command
        try:
            yield outlet
        finally:
            del self._outlets[outlet]

    def beat(self) -> None:
        """Send a sign of life."""
        self._show("", frames.beat(time.time()))

    def note_broker(self, linked: bool, why: str = "") -> None:
        """Take whether the broker is connected, and why not."""
        told = frames.broker(linked, why)
        if told != self._broker:
            self._broker = told
            self._put(told)

    def note_vehicle(self, name: str) -> None:
        """Add a vehicle."""
        if name in self._vehicles:
            return
        known = self._vehicles | {name: _Known()}
        self._vehicles = {one: known[one] for one in sorted(known)}
        for outlet, can_command in self._outlets.items():
            outlet.put(self._hello(can_command))

    def note_about(self, name: str, about: About | None) -> None:
        """Take a vehicle's description."""
        known = self._vehicles[name]
        told = frames.about(name, "null" if about is None else about.model_dump_json())
        if told != known.about:
            known.about, known.model = told, model_of(about)
            self._put(told)

    def note_presence(self, name: str, presence: Presence) -> None:
        """Take what a vehicle's service, or the broker for it, says of its presence."""
        known, told = self._vehicles[name], frames.presence(name, presence)
        if told != known.presence:
            known.presence = told
            self._put(told)

    def note_state(self, name: str, state: State, age_s: float) -> None:
        """Take a state of this age, s."""
        known = self._vehicles[name]
        known.state, known.heard_s = state, time.monotonic() - age_s
        self._show(name, self._state_frame(name, known, state))

    def note_event(self, name: str, event: Happened) -> None:
        """Take an event."""
        self._events.append((name, event))
        self._put(frames.event(name, event))

    def _hello(self, can_command: bool) -> str:
        return frames.hello(self.vehicles, can_command, self._password, __version__, time.time())

    @staticmethod
    def _state_frame(name: str, known: _Known, state: State) -> str:
        return frames.state(name, state, time.monotonic() - known.heard_s, arms_b_m(known.model, state))

    def _put(self, frame: str) -> None:
        for outlet in self._outlets:
            outlet.put(frame)

    def _show(self, key: str, frame: str) -> None:
        for outlet in self._outlets:
            outlet.show(key, frame)
