"""One bus cycle: goals to all servos at once, then the state of all, so that a missing one costs the others little.

XMs are read together by Fast Sync Read. Any servo that is missing spoils that for all, so one that does not answer
leaves the group and is asked by itself: every cycle until it counts as silent, then now and then.
"""

import logging
from collections.abc import Callable, Iterable
from enum import Enum

from companion.adapters.dynamixel.faults import FaultLog
from companion.adapters.dynamixel.joint import Joint
from companion.adapters.dynamixel.registers import ALERT, Answer, Block, Xm
from companion.adapters.dynamixel.wire import Wire
from companion.config.arms_config import ArmsConfig
from companion.core.interfaces import Clock
from companion.core.types import ArmFaultKind

LOG = logging.getLogger(__name__)

ATTEMPTS = 5
"""Attempts for a read or write outside the cycles before its servo counts as not answering."""
RETRY_S = 0.5
_ASKED = 4
"""Single reads that must fail, over all of `silent_s`, before a servo counts as silent: a delay of this computer
is no reason to stop the arms."""
_QUESTION_S = 0.0045
_DOUBTS = 10
"""Group reads that failed although every servo answered alone, until the next simpler way is taken."""
_LONGEST_STEP_S = 0.05
"""A worker that was held up does not make up for it in one step."""


class Way(Enum):
    """Method of reading the XMs together; not every firmware supports Fast Sync Read."""

    FAST = "Fast Sync Read"
    SYNC = "Sync Read"
    SINGLE = "single reads"


class BusCycle:
    """Read and write cycle of all servos on one bus; for one thread."""

    def __init__(
        self, joints: tuple[Joint, ...], wire: Wire, faults: FaultLog, config: ArmsConfig, clock: Clock
    ) -> None:
        self.joints, self.wire, self.faults = joints, wire, faults
        self._config, self._clock = config, clock
        self._xm = [joint for joint in joints if joint.protocol == 2]
        self._ax = [joint for joint in joints if joint.protocol == 1]
        self._way, self._doubts = Way.FAST, 0
        self._turns: dict[str, int] = {}
        self._alerted: list[Joint] = []
        self._goals_s = clock.now_s()

    def cycle(self, begun_s: float) -> None:
        """Send goals and read states; then, in the time that is left, retry the servos that did not answer."""
        self.send_goals(begun_s)
        self._read_group()
        self._read_one_ax()
        self._read_one_health()
        self._try_missing(begun_s + 1.0 / self._config.rate_hz)

    def send_goals(self, now_s: float) -> None:
        """Send one sync write per protocol to every joint that is driven and has no fault."""
        dt_s, self._goals_s = min(now_s - self._goals_s, _LONGEST_STEP_S), now_s
        for protocol, joints in ((2, self._xm), (1, self._ax)):
            driven = [joint for joint in joints if joint.driven and not joint.faults]
            counts = {joint.servo_id: joint.scale.counts(joint.advance(dt_s)) for joint in driven}
            if counts:
                self.wire.sync_write(protocol, joints[0].table.GOAL_POSITION, counts)

    def ask(self, joint: Joint, block: Block, times: int = 1) -> Answer | None:
        """Read a block of one servo, again up to `times` times; None when it does not answer."""
        answers = (self.wire.read(joint.protocol, joint.servo_id, block) for _ in range(times))
        return next((answer for answer in answers if answer is not None), None)

    def read_joint(self, joint: Joint) -> bool:
        """Read one servo's state; True when it answered."""
        answer = self.ask(joint, joint.table.STATE)
        if answer is None:
            return False
        self._take(joint, answer)
        return True

    def read_health(self, joint: Joint) -> bool:
        """Read and judge one servo's torque and errors; True when it answered."""
        if joint.protocol == 1:
            return self.read_joint(joint)
        answer = self.ask(joint, Xm.HEALTH)
        if answer is None:
            return False
        self.faults.judge(joint, joint.health_of(answer))
        return True

    def insist(self, question: Callable[[], bool]) -> bool:
        """Repeat a read until it is answered, a few times; `wire` counts the failures."""
        return any(question() for _ in range(ATTEMPTS))

    def first_look(self, joint: Joint) -> bool:
        """Read state and health of a servo that has not answered lately; True when it answered both."""
        return self.insist(lambda: self.read_joint(joint)) and self.insist(lambda: self.read_health(joint))

    def _take(self, joint: Joint, answer: Answer) -> None:
        joint.hear(answer, self._clock.now_s())
        if joint.protocol == 1:
            self.faults.judge(joint, joint.health_of(answer))
        elif answer.error & ALERT and joint not in self._alerted:
            self._alerted.append(joint)

    def _read_group(self) -> None:
        """Read all answering XMs together, and those that fail one by one."""
        group = [joint for joint in self._xm if joint.in_group and not joint.paused]
        answers = self._ask_group([joint.servo_id for joint in group]) if group else {}
        for joint in group:
            if joint.servo_id in answers:
                self._take(joint, answers[joint.servo_id])
        left = [joint for joint in group if joint.servo_id not in answers]
        sound = sum([self._ask_alone(joint) for joint in left])
        self._doubt(failed=bool(left), all_sound=sound == len(left))

    def _ask_group(self, servo_ids: list[int]) -> dict[int, Answer]:
        if self._way is Way.FAST:
            return self.wire.fast_sync_read(servo_ids, Xm.STATE)
        return self.wire.sync_read(servo_ids, Xm.STATE) if self._way is Way.SYNC else {}

    def _doubt(self, failed: bool, all_sound: bool) -> None:
        """Count a group read that failed though every servo answered alone: the firmware may not support it."""
        if not failed:
            self._doubts = 0
        if not failed or not all_sound or self._way is Way.SINGLE:
            return
        self._doubts += 1
        if self._doubts >= _DOUBTS:
            self._way, self._doubts = (Way.SYNC if self._way is Way.FAST else Way.SINGLE), 0
            LOG.warning("arms: the servos do not answer together; from now on %s", self._way.value)

    def _ask_alone(self, joint: Joint) -> bool:
        if self.read_joint(joint):
            return True
        now_s = self._clock.now_s()
        joint.in_group, joint.missed, joint.missed_s = False, joint.missed + 1, min(joint.missed_s, now_s)
        if joint.missed >= _ASKED and now_s - joint.missed_s > self._config.silent_s:
            self.faults.silent(joint, now_s - joint.heard_s)
        if ArmFaultKind.SILENT in joint.faults:
            joint.next_try_s = now_s + RETRY_S
        return False

    def _read_one_ax(self) -> None:
        joint = self._next("ax", (j for j in self._ax if j.in_group and not j.paused))
        if joint is not None:
            self._ask_alone(joint)

    def _read_one_health(self) -> None:
        """Read the health of one XM in turn, those with the alert bit first."""
        sound = [joint for joint in self._xm if joint.in_group and not joint.paused]
        urgent = [joint for joint in self._alerted if joint in sound and not joint.faults]
        joint = urgent[0] if urgent else self._next("health", sound)
        if joint is not None and self.read_health(joint):
            self._alerted = [other for other in self._alerted if other is not joint]

    def _try_missing(self, end_s: float) -> None:
        """Retry silent servos one by one: at least one, more while the cycle has time."""
        due = [j for j in self.joints if not j.in_group and not j.paused and self._clock.now_s() >= j.next_try_s]
        for _ in due:
            joint = self._next("missing", due)
            if joint is not None:
                self._ask_alone(joint)
            if self._clock.now_s() + _QUESTION_S > end_s:
                return

    def _next(self, turn: str, joints: Iterable[Joint]) -> Joint | None:
        """Return the next joint in round-robin order of index: the first after the last one served."""
        waiting = sorted(joints, key=lambda joint: joint.index)
        if not waiting:
            return None
        last = self._turns.get(turn, -1)
        chosen = next((joint for joint in waiting if joint.index > last), waiting[0])
        self._turns[turn] = chosen.index
        return chosen
