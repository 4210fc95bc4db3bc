"""Bridge from QTM to the broker, on the room's workstation; the receiving end is `mocap.source = "mqtt"`."""

import asyncio
import logging
from dataclasses import dataclass

from companion.adapters.mqtt.mocap_out import MocapOut, open_mocap_out
from companion.adapters.qualisys.connect import open_qualisys
from companion.adapters.qualisys.source import QualisysSource
from companion.config.mocap_config import MocapConfig
from companion.config.operator_config import OperatorConfig
from companion.core.interfaces import Clock, MocapError
from companion.core.types import Array, MocapFrame
from companion.estimation import estimator
from companion.estimation.estimator import EstimatorParams, EstimatorState, Verdict
from companion.protocol.mocap import MocapPose, Vector

LOG = logging.getLogger(__name__)

_AGAIN_S = 1.0
"""Time between two attempts to connect to QTM and find the body."""
_SILENT_S = 0.5
_SILENT = "QTM sends no frames: is the capture stopped, or the network cut?"
_USABLE = frozenset({Verdict.ACCEPTED, Verdict.STARTED})


@dataclass(frozen=True, kw_only=True)
class Glance:
    """Counters and state of a bridge at one instant."""

    frames: int
    """Frames received from QTM so far."""
    sent: int
    age_s: float
    """Time since the newest frame was received; infinite before the first."""
    dropped: int
    """Frames lost between QTM and the bridge: missing, out of order or malformed."""
    passed_over: int
    """Frames not sent because the broker had not yet taken the one before."""
    tracked: bool
    trouble: str
    """Reason why frames do not reach the vehicle; empty when they do."""


class Bridge:
    """Bridge that forwards the frames of one vehicle's body."""

    def __init__(self, config: MocapConfig, broker: OperatorConfig, clock: Clock) -> None:
        self._config, self._broker, self._clock = config, broker, clock
        self._params = EstimatorParams(delay_s=config.delay_s)
        self._estimate = EstimatorState()
        self._source: QualisysSource | None = None
        self._out: MocapOut | None = None
        self._frames = self._dropped = 0
        self._trouble = "connecting to QTM"

    async def run(self) -> None:
        """Forward frames until cancelled.

        Raises MocapError when another bridge forwards this vehicle, ConfigError for an unusable password file.
        """
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
        """Return the present counters and state."""
        out, frame = self._out, self._source.latest() if self._source is not None else None
        age_s = self._clock.now_s() - frame.received_s if frame is not None else float("inf")
        return Glance(
            frames=self._frames,
            sent=out.sent if out is not None else 0,
            age_s=age_s,
            dropped=self._dropped + (_dropped_by(self._source) if self._source is not None else 0),
            passed_over=out.passed_over if out is not None else 0,
            tracked=frame is not None and frame.tracked,
            trouble="; ".join(filter(None, (self._trouble, out.why if out is not None else ""))),
        )

    async def _read(self, out: MocapOut) -> None:
        """Connect to QTM repeatedly; log each failure once and publish it on the broker."""
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
    """Return a frame as published on the bus.

    `estimate` is the one after this frame; its velocity is used only if the estimator accepted the frame.
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
