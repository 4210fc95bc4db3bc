"""QTM's packets as frames of one body."""

import asyncio
import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from companion.adapters.mocap.newest_frame import NewestFrame
from companion.adapters.qualisys.bodies import (
    RigidBody,
    index_in_frame,
    listed,
    misfit,
    objection,
    other_objection,
    others_in_frame,
)
from companion.adapters.qualisys.packets import body_count, body_pose, body_position_w_m
from companion.core.interfaces import Clock
from companion.core.types import MocapFrame, OtherBody

LOG = logging.getLogger(__name__)


class QualisysSource(NewestFrame):
    """MocapSource interface: one body's newest frame, with the positions of the others. Made by `open_qualisys`.

    No frame is believed unless QTM's list of bodies is known to be the one that the frame was made with: not after QTM
    said that settings changed, nor when a frame holds another number of bodies, until the list has been read again.
    """

    def __init__(self, body: str, where: str, clock: Clock, others: Sequence[str] = ()) -> None:
        """`others` are the bodies of the other vehicles, in the order in which each frame has them."""
        super().__init__(f"QTM at {where}", clock)
        self.packets = 0
        self.stray = ""
        """Address, other than QTM's, that frames came from; they are dropped."""
        self.list_wanted = asyncio.Event()
        """Set while QTM's list of bodies is to be read before another frame is believed."""
        self.doubts = 0
        self.on_frame: Callable[[], None] | None = None
        self._body = body
        self._bodies: tuple[RigidBody, ...] = ()
        self._objection = self._misfit = ""
        self._in_frame: int | None = None
        """Bodies in a frame; None while no frame has come since the list was read."""
        self._index = 0
        self._others = tuple(others)
        self._other_indices: tuple[int | None, ...] = ()
        self._why_unseen: tuple[str, ...] = ("",) * len(self._others)

    @property
    def trouble(self) -> str:
        """Reason why no frame is used, to follow 'QTM at ...'; empty while frames are used."""
        return self._objection or self._misfit

    def why_silent(self) -> str:
        """Return why no frames come, as a sentence; empty when it is not known."""
        if self.trouble:
            return f"{self._where} {self.trouble}"
        return f"frames come from {self.stray}, not from {self._where}" if self.stray else ""

    def take_bodies(self, bodies: tuple[RigidBody, ...]) -> str:
        """Take QTM's list of bodies as just read; returns why ours cannot be flown by, empty when it can."""
        if bodies != self._bodies or self.list_wanted.is_set():
            self._in_frame = None
        before, self._bodies = self._bodies, bodies
        self.list_wanted.clear()
        self._objection = objection(bodies, self._body)
        if bodies != before:
            self._judge_others()
        if before and bodies != before:
            old, new = listed(before) or "none", listed(bodies)
            LOG.warning("%s: its rigid bodies were changed, from %s to %s", self._where, old, new)
            if self._objection:
                LOG.error("no frames are believed: %s %s", self._where, self._objection)
        return self._objection

    def doubt_bodies(self) -> None:
        """Believe no frame until QTM's list of bodies has been read again."""
        self.doubts += 1
        self.list_wanted.set()

    def on_packet(self, packet: Any) -> None:
        """Take a QRTPacket that has just arrived; MalformedError when it cannot be read."""
        received_s = self._clock.now_s()
        self.packets += 1
        number, stamp_s = packet.framenumber, packet.timestamp * 1e-6
        if self.is_overtaken(number, stamp_s):
            return
        if not self._is_of_the_list(body_count(packet)):
            self.counts = replace(self.counts, doubted=self.counts.doubted + 1)
            return
        pose = body_pose(packet, self._index)
        late = self.counts.late
        self.put(
            MocapFrame(
                frame=number,
                stamp_s=stamp_s,
                received_s=received_s,
                position_w_m=pose.position_w_m,
                rotation_w_b=pose.rotation_w_b,
                residual_m=pose.residual_m,
                late=late,
                others=tuple(self._others_of(packet)) if self._others else (),
            )
        )
        if self.on_frame is not None:
            on_frame, self.on_frame = self.on_frame, None
            on_frame()

    def on_stray(self, host: str) -> None:
        """Take note of a frame from an address that is not QTM's."""
        if not self.stray:
            LOG.warning("%s: frames come from %s: they are dropped", self._where, host)
        self.stray = host

    def _is_of_the_list(self, count: int) -> bool:
        """Return True when a frame of `count` bodies matches the list of bodies as last read."""
        if self.list_wanted.is_set() or self._objection:
            return False
        if self._in_frame is None:
            index = index_in_frame(self._bodies, self._body, count)
            if index is None:
                self._tell_misfit(misfit(self._bodies, count))
                self.doubt_bodies()
                return False
            self._in_frame, self._index, self._misfit = count, index, ""
            self._other_indices = others_in_frame(self._bodies, self._others, count)
        if count != self._in_frame:
            self.doubt_bodies()
        return count == self._in_frame

    def _others_of(self, packet: Any) -> Iterator[OtherBody]:
        for name, index, why in zip(self._others, self._other_indices, self._why_unseen, strict=True):
            yield OtherBody(name, None if index is None else body_position_w_m(packet, index), why)

    def _judge_others(self) -> None:
        """Note, and log, which other vehicles QTM's list, just changed, does not show."""
        objections = [other_objection(self._bodies, name) for name in self._others]
        self._why_unseen = tuple(f"{self._where} {why}" if why else "" for why in objections)
        for why in filter(None, self._why_unseen):
            LOG.error("another vehicle is not seen: %s", why)

    def _tell_misfit(self, what: str) -> None:
        if what != self._misfit and self.latest() is not None:
            LOG.error("no frames are believed: %s %s", self._where, what)
        self._misfit = what
