"""Facts from whole flights (section m): motion capture, a joystick as the pilot, a companion in OFFBOARD."""

import math
from collections.abc import Callable
from functools import cache

from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.config import GcsLinkConfig
from mock_autopilot.px4.land_detector import LandDetector
from mock_autopilot.px4.params import ParamTable
from mock_autopilot.px4.timing import Timing
from tests.mock_autopilot.bench import NO_GPS, SIH_PLANT, Bench, OfflineLink
from tests.mock_autopilot.fact import Fact, acks, near, same, state
from tests.mock_autopilot.facts.arming import DENIED_TEXT

FLIGHT = NO_GPS | {
    "COM_OBL_RC_ACT": 4, "COM_OF_LOSS_T": 0.5, "COM_RC_IN_MODE": 2, "COM_RC_OVERRIDE": 3, "NAV_RCL_ACT": 3,
    "COM_LOW_BAT_ACT": 2, "MPC_LAND_SPEED": 0.6, "SDLOG_MODE": -1,
}  # fmt: skip
"""Parameters of the recorded vehicle; RC means a joystick at rest on the ground station's link."""
HOVER = 0.4905
STICK_PERIOD_S = 0.05
OWN_LANDINGS = 400
"""So many draws repeat a recorded share to 0.05 (two standard deviations)."""
PASS_S, FIRST_QUESTION_S = 0.014, 0.27
"""The commander's mean period, and when the companion first asks to disarm after idle thrust."""
PREARM, XY_CONTROL, RC, BATTERY = 0x10000000, 0x4000, 0x10000, 0x2000000


class FlightBench(Bench):
    """A bench with a joystick."""

    pitch = 0.0
    joystick = True

    def _stream(self) -> None:
        super()._stream()
        if self.joystick and self._every(STICK_PERIOD_S):
            self.hear(mavlink.MAVLink_manual_control_message(1, round(self.pitch * 1000), 0, 500, 0, 0), 255)


def _booted(seed: int = 1, **params: float) -> FlightBench:
    bench = FlightBench(FLIGHT | params, SIH_PLANT, seed=seed)
    bench.run(5.0)
    bench.vision = True
    bench.run(3.0)
    bench.command(511, 436.0, 50000.0)
    return bench


@cache
def _flying() -> FlightBench:
    bench = _booted()
    bench.fly_offboard(0.35, HOVER)
    bench.run(0.5)
    return bench


def _hovering() -> FlightBench:
    bench = _flying().again()
    bench.__class__ = FlightBench
    return bench  # type: ignore[return-value]  # a copy of what it was given


def _until(bench: Bench, done: Callable[[], bool], most_s: float = 20.0, step_s: float = 0.004) -> float:
    """Advance time until the condition holds; return the time taken, s."""
    start_s = bench.now_s
    while not done() and bench.now_s < start_s + most_s:
        bench.run(step_s)
    return bench.now_s - start_s


def _modes(bench: Bench, since_s: float) -> list[tuple[float, int, int]]:
    """CURRENT_MODE: time, mode and wanted mode."""
    return [
        (s.time_s, s.message.custom_mode, s.message.intended_custom_mode) for s in bench.all("CURRENT_MODE", since_s)
    ]


def _health(bench: Bench) -> int:
    return int(bench.all("SYS_STATUS")[-1].message.onboard_control_sensors_health)


@cache
def _boot() -> dict[str, str]:
    bench = FlightBench(FLIGHT, SIH_PLANT)
    bench.run(5.0)
    before = state(bench.heartbeat())
    bench.vision = True
    bench.run(3.0)
    return {"before": before, "after": state(bench.heartbeat()), "health": f"{_health(bench):#x}"}


@cache
def _mode_change() -> dict[str, float]:
    bench = _booted()
    bench.target(HOVER)
    bench.run(0.2)
    start_s = bench.now_s
    bench.command(176, 1.0, 6.0, 0.0)
    bench.run(0.1)
    ack_s = bench.all("COMMAND_ACK", start_s)[-1].time_s
    shown = _modes(bench, ack_s)
    return {
        "old": float(shown[0][1] >> 16 & 0xFF),
        "new_ms": 1e3 * (next(at for at, mode, _ in shown if mode >> 16 & 0xFF == 6) - ack_s),
    }


def _ack_latencies_ms() -> list[float]:
    """Return the latencies of thirty arm commands while armed, at all phases of the commander's period."""
    bench = _hovering()
    found = []
    for turn in range(30):
        bench.run(0.1 + 0.004 * (turn % 7))
        start_s = bench.now_s
        bench.command(400, 1.0)
        found.append(1e3 * (bench.all("COMMAND_ACK", start_s)[0].time_s - start_s))
    return sorted(found)


@cache
def _arming_texts() -> list[tuple[float, str]]:
    bench = _booted()
    bench.target(0.0)
    bench.run(0.2)
    bench.mode(6)
    start_s = bench.now_s
    bench.arm()
    bench.run(0.2)
    texts = [(s.time_s, str(s.message.text)) for s in bench.all("STATUSTEXT", start_s)]
    return [(at_s - texts[0][0], text) for at_s, text in texts]


@cache
def _own_landings() -> list[float]:
    """Return the times from the first question to the grant; the companion asks every half second."""
    params, timing, found = ParamTable(FLIGHT), Timing(1), []
    for _ in range(OWN_LANDINGS):
        detector, now_s = LandDetector(params, timing), 0.0
        detector.landed = False
        while not detector.landed:
            detector.step(now_s, armed=True, climb_controlled=False, signal=0.0, down_mps=0.0)
            now_s += PASS_S
        found.append(max(0.0, math.ceil((now_s - PASS_S - FIRST_QUESTION_S) / 0.5) * 0.5))
    return found


@cache
def _landed_by_disarming() -> dict[str, str]:
    bench = _hovering()
    denied = f"{acks(bench.command(400, 0.0))}: {bench.texts()[-1][1]}"
    bench.target(0.45)
    _until(bench, lambda: bool(bench.world.truth.on_ground))
    bench.target(0.0)
    bench.run(2.5)
    bench.command(400, 0.0)
    bench.run(0.1)
    return {"denied": denied, "after": state(bench.heartbeat()), "text": bench.texts()[-1][1]}


@cache
def _nav_land(seed: int = 1) -> dict[str, float | str]:
    bench = _hovering() if seed == 1 else _booted(seed)
    if seed != 1:
        bench.fly_offboard(0.35, HOVER)
        bench.run(0.5)
    start_s = bench.now_s
    bench.setpoint = None
    bench.command(21)
    bench.run(0.3)
    flying = f"{state(bench.heartbeat())}; landed_state {int(bench.world.vehicle.landed_state)}"
    _until(bench, lambda: not bench.world.vehicle.armed)
    disarmed_s = bench.now_s
    bench.run(0.1)
    shown = next((at for at, mode, _ in _modes(bench, disarmed_s - 0.02) if mode >> 16 & 0xFF == 6), math.inf)
    prearm = {s.message.onboard_control_sensors_health & PREARM for s in bench.all("SYS_STATUS", start_s + 0.3)[:-1]}
    return {
        "flying": flying,
        "landed": bench.text_after("Landing detected", start_s),
        "disarmed": disarmed_s - start_s - bench.text_after("Landing detected", start_s),
        "shown_ms": 1e3 * (shown - disarmed_s),
        "after": state(bench.heartbeat()),
        "prearm": f"{prearm == {PREARM}}",
    }


@cache
def _offboard_loss() -> dict[str, float | str]:
    bench = _hovering()
    start_s = bench.now_s - 0.02
    bench.setpoint = None
    bench.run(1.0)
    text_s = bench.text_after("Failsafe activated", start_s)
    mode_s = next(at for at, mode, _ in _modes(bench, start_s) if mode >> 24 == 6) - start_s
    return {"text": text_s, "mode": mode_s - text_s, "state": state(bench.heartbeat())}


@cache
def _vision_gone() -> dict[str, float | str]:
    """The companion lands it when poses end; four and a half seconds later PX4 has no position."""
    bench = _hovering()
    bench.run(0.02)
    start_s = bench.now_s - 0.02
    bench.vision = False
    bench.run(0.3)
    bench.setpoint = None
    bench.command(21)
    bench.world.vehicle.params.change("MPC_LAND_CRWL", 0.05)
    bench.run(4.9)
    told_s = bench.text_after("Failsafe activated", start_s)
    bench.run(0.2)
    found: dict[str, float | str] = {
        "text": told_s,
        "state": f"{state(bench.heartbeat())}; landed_state {int(bench.world.vehicle.landed_state)}",
        "health": f"prearm {bool(_health(bench) & PREARM)}, position {bool(_health(bench) & XY_CONTROL)}",
    }
    _until(bench, lambda: not bench.world.vehicle.armed, 40.0)
    bench.run(0.1)
    return found | {"after": state(bench.heartbeat())}


def _vision_back() -> float:
    """Poses that contradict the estimate of a vehicle that stands: the text after the first of them."""
    bench = _booted()
    bench.vision = False
    bench.run(6.0)
    bench.vision_offset_m = (2.0, 0.0, 0.0)
    bench.vision = True
    start_s = bench.now_s
    bench.run(1.0)
    return bench.text_after("Preflight Fail: horizontal position unstable", start_s)


def _arming_refused(bench: FlightBench) -> str:
    """Return the reason that is told when the setpoints begin, and the answer to arming in OFFBOARD."""
    start_s = bench.now_s
    bench.target(0.0)
    bench.run(0.2)
    bench.mode(6)
    answer = acks(bench.arm())
    return f"{bench.texts(start_s)[0][1]}; {answer}: {bench.texts(start_s)[-1][1]}"


def _height_contradicted() -> str:
    bench = _booted()
    bench.vision_offset_m = (0.0, 0.0, -0.8)
    bench.run(0.5)
    return _arming_refused(bench)


def _armed_empty() -> str:
    bench = _booted()
    bench.world.vehicle.battery.drop_to(0.06)
    bench.run(0.5)
    return _arming_refused(bench)


@cache
def _rc_lost() -> dict[str, float | str]:
    bench = _hovering()
    _until(bench, lambda: bench._every(STICK_PERIOD_S))
    start_s = bench.now_s
    bench.joystick = False
    bench.run(1.2)
    bench.setpoint = None
    text_s = bench.text_after("Failsafe activated", start_s)
    found: dict[str, float | str] = {
        "text": text_s,
        "state": state(bench.heartbeat()),
        "health": f"receiver {bool(_health(bench) & RC)}",
    }
    _until(bench, lambda: not bench.world.vehicle.armed)
    bench.run(0.1)
    return found | {"landed": bench.text_after("Landing detected", start_s) - text_s, "after": state(bench.heartbeat())}


def _rc_text() -> str:
    bench = _hovering()
    bench.joystick = False
    bench.run(1.0)
    return bench.texts()[-1][1]


def _pilots_position() -> str:
    """Another ground station takes it to Position, the companion takes it back."""
    bench = _hovering()
    bench.hear(mavlink.MAVLink_command_long_message(1, 1, 176, 0, 129.0, 3.0, 0.0, math.nan, 0, 0, 0), 255)
    bench.run(0.1)
    theirs = state(bench.heartbeat())
    bench.run(1.0)
    taken = acks(bench.mode(6))
    bench.run(0.1)
    return f"{theirs}; {taken}; {state(bench.heartbeat())}"


def _pilots_hold() -> str:
    bench = _hovering()
    bench.hear(mavlink.MAVLink_command_long_message(1, 1, 176, 0, 129.0, 4.0, 3.0, math.nan, 0, 0, 0), 255)
    bench.run(0.1)
    return f"{bench.texts()[-1][1]}; {state(bench.heartbeat())}"


def _sticks() -> str:
    bench = _hovering()
    bench.pitch = 0.6
    bench.run(0.2)
    return f"{bench.texts()[-1][1]}; {state(bench.heartbeat())}"


def _kill() -> str:
    bench = _hovering()
    results = acks(bench.command(400, 0.0, 21196.0))
    bench.run(0.5)
    return f"{results}: {bench.texts()[-1][1]}; {state(bench.heartbeat())[:7]}"


@cache
def _battery() -> dict[str, float | str]:
    """Return the reports of a battery that drains from 16 % to critical, at 100 % in 60 s."""
    bench = _hovering()
    bench.world.vehicle.params.change("SIM_BAT_MIN_PCT", 0.0)
    bench.world.vehicle.battery.charge = bench.world.vehicle.battery._reported = 0.16
    start_s = bench.now_s
    _until(bench, lambda: bench.text_after("Low battery", start_s) < 1e6, step_s=0.1)
    low_percent = float(bench.world.vehicle.battery.percent)
    bench.run(0.4)
    low = f"health {bool(_health(bench) & BATTERY)}; {state(bench.heartbeat())}"
    _until(bench, lambda: bench.text_after("Failsafe activated", start_s) < 1e6, step_s=0.1)
    bench.run(0.1)
    critical = f"{bench.texts(start_s)[-2][1]}; {state(bench.heartbeat())}"
    bench.command(400, 0.0, 21196.0)
    before = bench.world.vehicle.battery.percent
    bench.run(0.9)
    refilled = (bench.world.vehicle.battery.percent - before) / (100.0 - before)
    return {"low": low, "percent": low_percent, "critical": critical, "refilled": refilled}


@cache
def _ratios() -> dict[str, float]:
    bench = _hovering()
    start_s = bench.now_s
    for _ in range(60):
        bench.run(0.5)
        bench.world.vehicle.battery.charge = 1.0
    sent = [s.message for s in bench.all("ESTIMATOR_STATUS", start_s)]
    ratios = sorted(message.pos_horiz_ratio for message in sent)
    return {
        "median": ratios[len(ratios) // 2],
        "most": max(max(message.pos_horiz_ratio, message.hagl_ratio) for message in sent),
        "nan": float(all(math.isnan(message.vel_ratio) and math.isnan(message.tas_ratio) for message in sent)),
    }


def _doubts() -> float:
    """Return the share of forty take-offs after which bit 64 is cleared for a time."""
    bench = _flying()
    timing = bench.world.timing
    return sum(timing.range_doubt_s(taking_off=True)[1] > 0.0 for _ in range(40)) / 40.0


def _flags_without_range() -> str:
    bench = _booted(EKF2_RNG_CTRL=0)
    return str(bench.world.vehicle.estimator.flags)


@cache
def _rates(gcs: bool = False) -> dict[int, float]:
    """Return the rates (Hz) of all messages of a link between 6 and 26 s after boot."""
    bench = FlightBench(FLIGHT, SIH_PLANT)
    if gcs:
        bench.link = OfflineLink(bench.world, GcsLinkConfig.model_validate({}))
    bench.run(26.0)
    times: dict[int, list[float]] = {}
    for sent in bench.sent:
        if sent.time_s >= 6.0:
            times.setdefault(sent.message.get_msgId(), []).append(sent.time_s)
    return {id_: (len(seen) - 1) / (seen[-1] - seen[0]) for id_, seen in times.items() if len(seen) > 1}


def _event() -> str:
    bench = _booted()
    bench.heartbeats = False
    bench.run(3.0)
    bench.target(0.0)
    bench.run(0.2)
    bench.mode(6)
    before = len(bench.sent)
    bench.arm()
    bench.run(0.2)
    sent = [s.message for s in bench.sent[before:]]
    ids = [f"{int.from_bytes(m._bytes[:4], 'little'):#x}" for m in sent if m.get_msgId() == 410]
    texts = sum(m.get_type() == "STATUSTEXT" for m in sent)
    return f"events {', '.join(ids)}; {texts} texts"


def _streamed(id_: int, name: str, rate_hz: float, gcs: bool = False) -> Fact:
    return near(
        f"m-gcs-{id_}" if gcs else f"m-rate-{id_}",
        f"rate of {name}{' on the ground station link' if gcs else ''}",
        f"{rate_hz:g} Hz",
        lambda: _rates(gcs).get(id_, 0.0),
        (0.96 * rate_hz, 1.04 * rate_hz),
        "Hz",
        source="px4-rc_lost, px4-mocap_gone" if gcs else "nominal-px4-b",
    )


ON_GCS = (
    (1, "SYS_STATUS", 1.0), (24, "GPS_RAW_INT", 5.0), (30, "ATTITUDE", 50.0), (32, "LOCAL_POSITION_NED", 50.0),
    (36, "SERVO_OUTPUT_RAW", 50.0), (74, "VFR_HUD", 4.0), (105, "HIGHRES_IMU", 0.0), (132, "DISTANCE_SENSOR", 0.5),
    (141, "ALTITUDE", 1.0), (230, "ESTIMATOR_STATUS", 0.5), (245, "EXTENDED_SYS_STATE", 1.0), (331, "ODOMETRY", 0.0),
)  # fmt: skip


ALL_OWN = "nominal-px4-b, short-px4-tight, px4-battery, px4-mocap02, px4-pilot_*, px4-px4_killed"
FACTS = (
    same("m-boot", "a joystick, no mode asked for, no position", "81, 3/0, 0", lambda: _boot()["before"],
         source="px4-rc_lost"),
    same("m-vision", "then motion capture", "81, 3/0, 3", lambda: _boot()["after"], source="px4-rc_lost"),
    same("m-health", "SYS_STATUS health then", "0x1321c83f", lambda: _boot()["health"], source="px4-rc_lost"),
    near("m-mode-old", "CURRENT_MODE with the ACK of OFFBOARD still says the old main mode", "3",
         lambda: _mode_change()["old"], (3, 3), "", source="px4-killcmd"),
    near("m-mode-new", "and the new one after it", "52 ms (44 to 60)", lambda: _mode_change()["new_ms"], (44, 60),
         "ms", source="15 mode changes of all flights"),
    near("m-ack", "ACK of the commander: median of 30", "9.5 ms of 42", lambda: _ack_latencies_ms()[15], (4, 12),
         "ms", source="all flights"),
    near("m-ack-last", "and the longest", "15.7 ms", lambda: _ack_latencies_ms()[-1], (10, 16.01), "ms",
         source="all flights"),
    same("m-logger", "the text after \"Armed by external command\"", "[logger]", lambda: _arming_texts()[1][1][:8],
         source="px4-killcmd"),
    near("m-text-gap", "which comes after", "52 ms", lambda: 1e3 * _arming_texts()[1][0], (50, 56), "ms",
         source="px4-killcmd"),
    same("m-denied", "disarming in OFFBOARD in the air", "TEMPORARILY_REJECTED: Disarming denied: not landed",
         lambda: _landed_by_disarming()["denied"], source="px4-pilot_position"),
    near("m-own-early", "own landing: share of disarmings granted 0.45 to 0.6 s after the first was asked", "5 of 9",
         lambda: sum(0.45 < s < 0.6 for s in _own_landings()) / OWN_LANDINGS, (0.505, 0.605), "", source=ALL_OWN),
    near("m-own-late", "own landing: share granted after more than 1.4 s", "2 of 9",
         lambda: sum(s > 1.4 for s in _own_landings()) / OWN_LANDINGS, (0.18, 0.265), "", source=ALL_OWN),
    near("m-own-first", "own landing: share granted at once", "0 of 9",
         lambda: sum(s < 0.2 for s in _own_landings()) / OWN_LANDINGS, (0.0, 0.0), "", source=ALL_OWN),
    same("m-own-after", "after it", "17, 6/0, 3", lambda: _landed_by_disarming()["after"], source="nominal-px4-b"),
    same("m-own-text", "and its text", "Disarmed by external command", lambda: _landed_by_disarming()["text"],
         source="nominal-px4-b"),
    same("m-land", "NAV_LAND with motion capture", "157, 4/6, 4; landed_state 4", lambda: str(_nav_land()["flying"]),
         source="px4-mocap1"),
    near("m-landed", "NAV_LAND from 1 m to \"Landing detected\"", "5.4 to 5.9 s",
         lambda: float(_nav_land()["landed"]), (5.0, 6.4), source="px4-mocap1, px4-mocap_gone"),
    near("m-disarmed", "from there to the disarming", "2.0 s", lambda: float(_nav_land()["disarmed"]), (1.9, 2.1),
         source="px4-mocap1, px4-mocap_gone, px4-rc_lost"),
    near("m-mode-after", "CURRENT_MODE says OFFBOARD again after", "3 to 27 ms",
         lambda: float(_nav_land()["shown_ms"]), (0, 52), "ms", source="px4-rc_lost, px4-mocap1, px4-mocap_gone"),
    same("m-after", "mode after PX4's own landing: the last that allows arming", "17, 6/0, 0",
         lambda: str(_nav_land()["after"]), source="px4-mocap_gone"),
    same("m-prearm", "the prearm bit stays until it is disarmed", "True", lambda: str(_nav_land()["prearm"]),
         source="px4-mocap1"),
    near("m-loss", "setpoints end: \"Failsafe activated\" after COM_OF_LOSS_T 0.5", "0.593 to 0.605 s",
         lambda: float(_offboard_loss()["text"]), (0.54, 0.625), source="px4-kill9, px4-sigstop"),
    near("m-loss-mode", "and CURRENT_MODE says so after the text", "0.016 to 0.039 s",
         lambda: float(_offboard_loss()["mode"]), (0.0, 0.052), source="px4-kill9, px4-sigstop"),
    same("m-loss-state", "in Land by failsafe", "157, 4/6, 5", lambda: str(_offboard_loss()["state"]),
         source="px4-kill9"),
    near("m-blind", "poses end, NAV_LAND: failsafe after the last pose", "4.59 to 4.60 s",
         lambda: float(_vision_gone()["text"]), (4.5, 4.7), source="px4-mocap1, px4-mocap_gone"),
    same("m-blind-state", "which descends, and says Land", "157, 4/6, 5; landed_state 2",
         lambda: str(_vision_gone()["state"]), source="px4-mocap_gone"),
    same("m-blind-health", "SYS_STATUS health meanwhile", "prearm True, position False",
         lambda: str(_vision_gone()["health"]), source="px4-mocap_gone"),
    same("m-blind-after", "disarmed after it", "17, 6/0, 0", lambda: str(_vision_gone()["after"]),
         source="px4-mocap_gone"),
    near("m-unstable", "poses come back far off, on the ground: \"Preflight Fail: horizontal position unstable\" after",
         "0.24 s", _vision_back, (0.15, 0.35), source="px4-mocap_gone"),
    near("m-rc", "sticks end: \"Failsafe activated\" after COM_RC_LOSS_T 0.5", "0.643 s",
         lambda: float(_rc_lost()["text"]), (0.59, 0.71), source="px4-rc_lost"),
    same("m-rc-text", "with the text", "Failsafe activated", _rc_text, source="px4-rc_lost"),
    same("m-rc-state", "NAV_RCL_ACT 3: Land", "157, 4/6, 5", lambda: str(_rc_lost()["state"]), source="px4-rc_lost"),
    same("m-rc-health", "SYS_STATUS health then", "receiver False", lambda: str(_rc_lost()["health"]),
         source="px4-rc_lost"),
    near("m-rc-landed", "from the failsafe at 1 m to \"Landing detected\"", "5.28 s",
         lambda: float(_rc_lost()["landed"]), (4.7, 6.3), source="px4-rc_lost"),
    same("m-rc-after", "disarmed after it", "17, 6/0, 0", lambda: str(_rc_lost()["after"]), source="px4-rc_lost"),
    same("m-position", "Position by another ground station, then OFFBOARD by the companion",
         "209, 3/0, 4; ACCEPTED, ACCEPTED; 145, 6/0, 4", _pilots_position, source="px4-pilot_position"),
    same("m-hold", "Hold by another ground station, no global origin",
         "Switching to Hold is currently not available; 145, 6/0, 4", _pilots_hold, source="px4-pilot_hold"),
    same("m-kill", "kill in the air", "ACCEPTED: Disarmed by external command; 17, 6/0", _kill, source="px4-killcmd"),
    near("m-battery-low", "\"Low battery\" at", "15 %", lambda: float(_battery()["percent"]), (14, 15), "%",
         source="px4-battery"),
    same("m-battery-state", "which is a warning only", "health False; 145, 6/0, 4", lambda: str(_battery()["low"]),
         source="px4-battery"),
    near("m-battery-full", "1 s after the disarming the reported charge has recovered by this share", "0.63",
         lambda: float(_battery()["refilled"]), (0.55, 0.7), "", source="px4-battery, px4-killcmd"),
    near("m-ratio", "ESTIMATOR_STATUS.pos_horiz_ratio in flight, median", "0.03 to 0.11",
         lambda: _ratios()["median"], (0.03, 0.15), "", source="all flights"),
    near("m-ratio-most", "the largest of its ratios", "0.77", lambda: _ratios()["most"], (0.1, 0.78), "",
         source="px4-mocap_gone, nominal-px4-b"),
    near("m-ratio-nan", "vel_ratio and tas_ratio are NaN", "1", lambda: _ratios()["nan"], (1, 1), "",
         source="all flights"),
    near("m-range", "share of take-offs after which its bit 64 goes for a while", "9 of 12", _doubts, (0.5, 0.95), "",
         source="all flights"),
    same("m-range-off", "its flags on the ground without a range finder in use", "431", _flags_without_range,
         source="short-px4-tight"),
    _streamed(2, "SYSTEM_TIME", 1.0),
    _streamed(8, "LINK_NODE_STATUS", 1.0),
    _streamed(29, "SCALED_PRESSURE", 1.0),
    _streamed(132, "DISTANCE_SENSOR", 10.0),
    _streamed(380, "TIME_ESTIMATE_TO_TARGET", 0.5),
    _streamed(411, "CURRENT_EVENT_SEQUENCE", 1 / 3),
    _streamed(12901, "OPEN_DRONE_ID_LOCATION", 1.0),
    *(_streamed(*one, gcs=True) for one in ON_GCS),
    same("m-event", "EVENT of arming, also without a ground station", "events 0x190caf3, 0x1125bef; 0 texts", _event,
         source="px4-killcmd"),
)  # fmt: skip
"""Recorded from PX4 v1.17.0, SIH quadrotor, 2026-11-29."""
BY_SOURCE = (
    same("n-sticks", "sticks moved in OFFBOARD (COM_RC_OVERRIDE 3, COM_RC_STICK_OV 30)",
         "Pilot took over using sticks; 209, 3/0, 4", _sticks, source="PX4's source, Commander::manualControlCheck"),
    same("n-battery-critical", "battery critical (COM_LOW_BAT_ACT 2)", "Critical battery; 157, 4/6, 5",
         lambda: str(_battery()["critical"]), source="PX4's source, Failsafe::fromBatteryWarningActParam"),
    same("n-height", "poses 0.8 m too high on the ground: told when the setpoints begin, and the answer to arming",
         "Preflight Fail: height estimate not stable; TEMPORARILY_REJECTED: " + DENIED_TEXT, _height_contradicted,
         source="PX4's source, EstimatorChecks::checkEstimatorStatus; OFFBOARD requires an attitude"),
    same("n-battery-arming", "the same with a critical battery (COM_ARM_BAT_MIN -1)",
         "Critical battery; TEMPORARILY_REJECTED: " + DENIED_TEXT, _armed_empty,
         source="PX4's source, BatteryChecks::checkAndReport"),
)  # fmt: skip
"""Not in any recording that is here: as PX4's source has it."""
