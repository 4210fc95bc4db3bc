"""Forwards QTM's frames to the broker, from the room's workstation; the other end is `mocap.source = "mqtt"`."""

import asyncio
import logging
from dataclasses import dataclass

from companion.adapters.mqtt import MocapOut, open_mocap_out
from companion.adapters.qualisys import QualisysSource, open_qualisys
from companion.config.mocap_config import MocapConfig
from companion.config.operator_config import OperatorConfig
from companion.core.interfaces import Clock, MocapError
from companion.core.types import Array, MocapFrame
from companion.estimation import estimator
from companion.estimation.estimator import EstimatorParams, EstimatorState, Verdict
from companion.protocol.mocap import MocapPose, Vector

LOG = logging.getLogger(__name__)

_AGAIN_S = 1.0
"""Between two attempts to find QTM and the body."""
_SILENT_S = 0.5
_SILENT = "QTM sends no frames: is the capture stopped, or the network cut?"
_USABLE = frozenset({Verdict.ACCEPTED, Verdict.STARTED})


@dataclass(frozen=True)
class Glance:
    """How it goes."""

    frames: int
    """From QTM so far."""
    sent: int
    age_s: float
    """Since the newest frame came; infinite before the first."""
    dropped: int
    """By the way from QTM: lost, overtaken or broken."""
    passed_over: int
    """By the way to the broker, which had not taken the one before."""
    tracked: bool
    trouble: str
    """What keeps frames from the vehicle; empty when nothing does."""


class Bridge:
    """One vehicle's."""

    def __init__(self, config: MocapConfig, broker: OperatorConfig, clock: Clock) -> None:
        self._config, self._broker, self._clock = config, broker, clock
        self._params = EstimatorParams(delay_s=config.delay_s)
        self._estimate = EstimatorState()
        self._source: QualisysSource | None = None
        self._out: MocapOut | None = None
        self._frames = self._dropped = 0
        self._trouble = "QTM is looked for"

    async def run(self) -> None:
        """Until cancelled; MocapError when another bridge forwards this vehicle, ConfigError for a bad login file."""
        async with open_mocap_out(self._broker) as out:
            self._out = out
            reading = asyncio.create_task(self._read(out), name="companion.mocap_bridge")
            try:
                await asyncio.wait({reading, out.refused}, return_when=asyncio.FIRST_COMPLETED)
                (reading if reading.done() else out.refused).result()
            finally:
                reading.cancel()
                await asyncio.gather(reading, return_exceptions=True)

    def glance(self) -> Glance:
        """As it is now."""
        out, frame = self._out, self._source.latest() if self._source is not None else None
        age_s = self._clock.now_s() - frame.received_s if frame is not None else float("inf")
        return Glance(
            self._frames,
            out.sent if out is not None else 0,
            age_s,
            self._dropped + (_dropped_by(self._source) if self._source is not None else 0),
            out.passed_over if out is not None else 0,
            frame is not None and frame.tracked,
            "; ".join(filter(None, (self._trouble, out.why if out is not None else ""))),
        )

    async def _read(self, out: MocapOut) -> None:
        """From QTM, again and again; what keeps it from us is told once, and to whoever asks over the broker."""
        said = ""
        while True:
            try:
                async with open_qualisys(self._config, self._clock) as source:
                    self._source, said = source, ""
                    await self._forward(source, out)
            except MocapError as error:
                self._say(str(error), out)
                if str(error) != said:
                    said = str(error)
                    LOG.error("%s", said)  # noqa: TRY400 - the sentence is for the operator
            if self._source is not None:
                self._dropped, self._source = self._dropped + _dropped_by(self._source), None
            await asyncio.sleep(_AGAIN_S)

    async def _forward(self, source: QualisysSource, out: MocapOut) -> None:
        while True:
            if not await source.wait_frame(_SILENT_S):
                self._say(source.why_silent() or _SILENT, out)
                continue
            frame = source.latest()
            assert frame is not None
            self._estimate = estimator.step(self._estimate, frame, self._params)
            out.show(pose_of(self._config.body, frame, self._estimate))
            self._frames += 1
            if self._trouble:
                self._say("", out)

    def _say(self, trouble: str, out: MocapOut) -> None:
        self._trouble = trouble
        out.say_trouble(trouble)


def pose_of(body: str, frame: MocapFrame, estimate: EstimatorState) -> MocapPose:
    """Return a frame as it goes over the bus.

    `estimate` is the one after this frame; its velocity counts only if it took the frame.
    """
    vehicle = estimate.vehicle if estimate.verdict in _USABLE else None
    a, b, c = frame.rotation_w_b.tolist()
    return MocapPose(
        body=body,
        frame=frame.frame,
        stamp_s=frame.stamp_s,
        position_w_m=_vector(frame.position_w_m) if frame.tracked else None,
        rotation_w_b=(*a, *b, *c) if frame.tracked else None,
        velocity_w_mps=_vector(vehicle.velocity_w_mps) if vehicle is not None else None,
        residual_m=frame.residual_m if abs(frame.residual_m) < float("inf") else None,
        late=frame.late,
    )


def _vector(of: Array) -> Vector:
    x, y, z = of.tolist()
    return x, y, z


def _dropped_by(source: QualisysSource) -> int:
    counts = source.counts
    return counts.lost + counts.late + counts.malformed + counts.doubted
