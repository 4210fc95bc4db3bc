"""Thread that owns the serial port: connects, runs the cycles, and executes commands between them."""

import asyncio
import logging
import math
import threading

import numpy as np

from companion.adapters.dynamixel.bus_cycle import BusCycle
from companion.adapters.dynamixel.conversion import Reading
from companion.adapters.dynamixel.faults import FaultLog
from companion.adapters.dynamixel.inspection import Inspected, inspect
from companion.adapters.dynamixel.joint import joints_of
from companion.adapters.dynamixel.orders import Commands, Goals, deliver
from companion.adapters.dynamixel.port import BusPort, PortGoneError, latency_warning, name_warning
from companion.adapters.dynamixel.torque import Steps, clear_faults, torque_off, torque_on
from companion.adapters.dynamixel.wire import Wire
from companion.config.arms_config import ArmsConfig
from companion.core.interfaces import ArmError, Clock
from companion.core.types import ArmStatus, Array

LOG = logging.getLogger(__name__)

THREAD_NAME = "arms-bus"
CONNECT_PATIENCE_MS = 20.0
COMMAND_PATIENCE_MS = 5.0
"""Less: the healthy joints wait meanwhile."""


class BusThread:
    """Bus thread; `goals`, `status`, `commands.submit`, `start` and `close` are for the event loop."""

    def __init__(self, config: ArmsConfig, clock: Clock, strict: bool = True) -> None:
        self._config, self._clock, self._strict = config, clock, strict
        self._loop = asyncio.get_running_loop()
        self.connected: asyncio.Future[None] = self._loop.create_future()
        self._ended: asyncio.Future[None] = self._loop.create_future()
        self.warnings: tuple[str, ...] = ()
        self.inspected = Inspected()
        self.commands = Commands(self._loop)
        self.goals: Goals | None = None
        self._obeyed: Goals | None = None
        self._switching_on = False
        self._stop = threading.Event()
        self._faults = FaultLog()
        self._port = BusPort(config.port, config.baud)
        self._wire = Wire(self._port)
        self._bus_cycle = BusCycle(joints_of(config), self._wire, self._faults, config, clock)
        self._cycles, self._cycle_s = 0, 0.0
        self.status = self._status()
        self._thread = threading.Thread(target=self._run, name=THREAD_NAME)

    def start(self) -> None:
        """Start connecting; `connected` resolves when it is done, or fails with the ArmError."""
        self._thread.start()

    async def close(self) -> None:
        """Stop after the current cycle and close the port; torque stays as it is."""
        self._stop.set()
        await asyncio.shield(self._ended)
        self._thread.join()

    def _run(self) -> None:
        try:
            if self._connect():
                self._cycle_on()
        finally:
            self.commands.drop_all()
            self._port.closePort()
            deliver(self._loop, self._ended)

    def _connect(self) -> bool:
        try:
            self._port.open()
            self._port.patience_ms = CONNECT_PATIENCE_MS
            self.inspected = inspect(self._bus_cycle, self._config, self._stop.is_set, self._strict)
            of_the_port = (latency_warning(self._config.port), name_warning(self._config.port))
            self.warnings = (*filter(None, of_the_port), *self.inspected.remarks)
            self.status = self._status()
        except ArmError as error:
            deliver(self._loop, self.connected, error)
        except PortGoneError as error:
            deliver(self._loop, self.connected, ArmError(f"{self._config.port} failed while connecting: {error}"))
        except Exception as error:
            LOG.exception("connecting to the arms failed")
            deliver(self._loop, self.connected, ArmError(f"connecting to the arms failed unexpectedly: {error!r}"))
        else:
            deliver(self._loop, self.connected)
            return True
        return False

    def _cycle_on(self) -> None:
        period_s = 1.0 / self._config.rate_hz
        due_s = self._clock.now_s()
        while not self._stop.is_set():
            self._guarded_cycle()
            due_s += period_s
            now_s = self._clock.now_s()
            if now_s - due_s > period_s:
                due_s = now_s  # what was missed is missed: no bursts
            self._stop.wait(max(0.0, due_s - now_s))

    def _guarded_cycle(self) -> None:
        """Run one cycle; an exception does not end the thread but becomes a fault of the bus."""
        begun_s = self._clock.now_s()
        try:
            self._port.patience_ms = COMMAND_PATIENCE_MS
            self.commands.step()
            self._port.patience_ms = 0.0
            if not self._faults.bus_is_down:
                self._obey()
                self._bus_cycle.cycle(begun_s)
                self._cycles, self._cycle_s = self._cycles + 1, self._clock.now_s() - begun_s
        except PortGoneError as error:
            self._faults.latch_bus(
                f"the arms' port {self._config.port} is gone ({error}): plug its cable in again, then clear the faults"
            )
        except Exception as error:
            LOG.exception("a cycle of the arms' bus failed")
            self._faults.latch_bus(f"the arms' bus driver failed ({error!r}): see the log, then clear the faults")
        self.status = self._status()

    def _obey(self) -> None:
        """Pass new goals to the joints; goals are ignored while torque is being switched on."""
        goals = self.goals
        if goals is None or goals is self._obeyed or self._switching_on:
            return
        self._obeyed = goals
        for joint in self._bus_cycle.joints:
            if not joint.driven:
                continue
            if goals.position_rad is None:
                joint.stop()
            elif math.isfinite(goals.position_rad[joint.index]):
                joint.order(goals.position_rad[joint.index])

    def switch_on(self) -> Steps:
        """Switch torque on; goals given before are discarded."""
        self._refuse_when_down()
        self._switching_on = True
        try:
            yield from torque_on(self._bus_cycle)
        finally:
            self._switching_on, self._obeyed = False, self.goals

    def switch_off(self) -> Steps:
        """Switch torque off on every joint; ArmError while the bus is down."""
        self._refuse_when_down()
        yield from torque_off(self._bus_cycle)

    def clear(self) -> Steps:
        """Clear the faults; reopens the port when it was lost."""
        if self._faults.bus_is_down:
            self._reopen()
            yield
        yield from clear_faults(self._bus_cycle, self._clock)

    def _refuse_when_down(self) -> None:
        if self._faults.bus_is_down:
            raise ArmError("\n  ".join(fault.text for fault in self._faults.faults))

    def _reopen(self) -> None:
        """Reopen the port; the servos' state is unknown, so no joint is driven until torque is switched on again."""
        self._port.closePort()
        self._port.open()
        self._faults.forget_bus()
        for joint in self._bus_cycle.joints:
            joint.driven = False
            if not self._bus_cycle.first_look(joint):
                self._faults.silent(joint, self._clock.now_s() - joint.heard_s)

    def _status(self) -> ArmStatus:
        joints = self._bus_cycle.joints
        columns: Array = np.array([_numbers(joint.reading) for joint in joints]).T
        return ArmStatus(
            read_s=np.array([joint.heard_s for joint in joints]),
            position_rad=columns[0],
            velocity_radps=columns[1],
            effort=columns[2],
            temperature_c=columns[3],
            voltage_v=columns[4],
            torque_on=np.array([joint.torque_on for joint in joints]),
            held_rad=np.array([joint.held_rad for joint in joints]),
            faults=self._faults.faults,
            cycles=self._cycles,
            cycle_s=self._cycle_s,
            bad_packets=self._wire.bad_packets,
        )


def _numbers(reading: Reading | None) -> tuple[float, ...]:
    if reading is None:
        return (math.nan,) * 5
    r = reading
    return r.position_rad, r.velocity_radps, r.effort, r.temperature_c, r.voltage_v
