"""Arming (section a), OFFBOARD and modes (b), disarm and kill (e), take-off and landing (g)."""

from functools import cache

from pymavlink.dialects.v20 import development as mavlink

from tests.mock_autopilot.bench import SIH_PLANT, Bench
from tests.mock_autopilot.fact import acks, near, same, state

DENIED_TEXT = "Arming denied: Resolve system health failures first"


def _ready() -> Bench:
    return _booted().again()


@cache
def _booted() -> Bench:
    bench = Bench()
    bench.run(4.2)
    return bench


def _arm_at(seconds_after_heartbeat: float, seed: int = 1) -> str:
    bench = Bench(seed=seed)
    bench.run(1.0 + seconds_after_heartbeat)
    return acks(bench.arm())


def _denied_text() -> str:
    bench = Bench()
    bench.run(3.0)
    bench.arm()
    return bench.texts()[0][1]


def _armed_state() -> str:
    bench = _ready()
    bench.arm()
    return f"{state(bench.heartbeat())}: {bench.texts()[0][1]}"


def _again(arm: float) -> str:
    bench = _ready()
    if arm:
        bench.arm()
    before = len(bench.texts())
    return f"{acks(bench.command(400, arm))}, {len(bench.texts()) - before} texts"


def _odd() -> str:
    bench = _ready()
    return f"{acks(bench.command(400, 2.0))}: {bench.texts()[0][1]}"


def _addressed(target: tuple[int, int]) -> str:
    return acks(_ready().command(400, 1.0, target=target))


def _auto_disarm() -> float:
    bench = _ready()
    start = bench.now_s
    bench.arm()
    bench.run(13.0)
    return bench.text_after("Disarmed by auto preflight disarming", start)


def _mode(main: int, sub: int = 0, base: float = 1.0) -> str:
    bench = _ready()
    results = bench.command(176, base, float(main), float(sub))
    return f"{acks(results)}; {state(bench.heartbeat())}"


@cache
def _ack_gaps() -> list[float]:
    """Milliseconds between both ACKs of 30 mode commands, sorted."""
    bench = _ready()
    gaps = []
    for _ in range(30):
        since_s = bench.now_s
        bench.mode(4, 3)
        first, second = (sent.time_s for sent in bench.all("COMMAND_ACK", since_s))
        gaps.append(1e3 * (second - first))
    return sorted(gaps)


def _late_share() -> float:
    return sum(gap > 3.0 for gap in _ack_gaps()) / len(_ack_gaps())


def _legacy() -> str:
    bench = _ready()
    bench.hear(mavlink.MAVLink_set_mode_message(1, 1, 0x00060000))
    bench.run(0.1)
    return f"{acks([s.message.result for s in bench.all('COMMAND_ACK')])}; {state(bench.heartbeat())}"


def _offboard_without_stream() -> str:
    bench = _ready()
    bench.mode(6)
    return f"{state(bench.heartbeat())}; arming {acks(bench.arm())}"


def _offboard(stop: bool = False, mask: int = 7, arm: bool = True) -> str:
    bench = _ready()
    bench.target(0.0, mask=mask)
    bench.run(0.5)
    bench.mode(6)
    if arm:
        bench.arm()
    if stop:
        bench.setpoint = None
        bench.run(2.0)
    return state(bench.heartbeat())


def _hovering() -> Bench:
    """In the air in Hold, no setpoints."""
    return _hover().again()


@cache
def _hover() -> Bench:
    bench = _ready()
    bench.arm()
    bench.command(22)
    bench.run(12.0)
    return bench


def _offboard_in_air() -> str:
    bench = _hovering()
    results = acks(bench.mode(6))
    return f"{results}: {bench.texts()[-1][1]}; {state(bench.heartbeat())}"


def _disarm_in_air() -> str:
    bench = _hovering()
    results = acks(bench.command(400, 0.0))
    return f"{results}: {bench.texts()[-1][1]}"


def _kill() -> str:
    bench = _ready()
    bench.fly_offboard()
    start = bench.now_s
    results = acks(bench.command(400, 0.0, 21196.0))
    shown = bench.heartbeat()[0]
    bench.run(1.0)
    landed = next(s.time_s for s in bench.all("EXTENDED_SYS_STATE", start) if s.message.landed_state == 1) - start
    return f"{results}: {bench.texts(start)[0][1]}; base_mode {shown}; landed_state 1 within 0.8 s: {landed <= 0.8}"


def _takeoff_detected(thrust: float) -> float:
    bench = _ready()
    bench.target(thrust)
    bench.run(0.5)
    bench.mode(6)
    start = bench.now_s
    bench.arm()
    bench.run(0.1)
    return bench.text_after("Takeoff detected", start)


@cache
def _takeoff() -> dict[str, float]:
    bench = _ready()
    bench.arm()
    start = bench.now_s
    bench.command(22)
    bench.run(15.0)
    hold = next(s.time_s for s in bench.all("HEARTBEAT", start + 1.0) if s.message.custom_mode == 0x03040000)
    states = [s.message.landed_state for s in bench.all("EXTENDED_SYS_STATE", start)]
    height = -next(s.message.z for s in bench.all("LOCAL_POSITION_NED", hold))
    down = bench.now_s
    land = acks(bench.command(21))
    bench.run(25.0)
    landed = bench.text_after("Landing detected", down)
    return {
        "detected": bench.text_after("Takeoff detected", start),
        "hold": hold - start,
        "height": height,
        "taking off": float(3 in states and states[-1] == 2),
        "one ack": float(land == "ACCEPTED"),
        "landed": landed,
        "disarmed": bench.text_after("Disarmed by landing", down) - landed,
        "mode after": float(bench.heartbeat() == (29, 0x03040000, 3)),
    }


def _landing_from_3_m() -> float:
    """The recorded landings began 3.0 and 3.2 m above the ground, and were detected after 9.9 and 10.8 s."""
    bench = _ready()
    bench.arm()
    bench.command(22)
    bench.run(4.0)
    while bench.world.truth.position_ned_m[2] > -3.0 and bench.now_s < 60.0:
        bench.target(0.55)
        bench.mode(6)
        bench.run(0.1)
    bench.setpoint = None
    start = bench.now_s
    bench.command(21)
    bench.run(25.0)
    return bench.text_after("Landing detected", start)


@cache
def _takeoff_in_air() -> dict[str, float | str]:
    """NAV_TAKEOFF while it holds its place 3 m above the ground, MIS_TAKEOFF_ALT 3 m, as in the record."""
    bench = Bench({"MIS_TAKEOFF_ALT": 3.0})
    bench.run(4.2)
    bench.fly_offboard(3.0)
    bench.mode(4, 3)
    bench.setpoint = None
    bench.run(4.0)
    start, before_m = bench.now_s, -bench.world.truth.position_ned_m[2]
    result = acks(bench.command(22))
    lowest_m = before_m
    while bench.now_s < start + 2.85:
        bench.run(0.05)
        lowest_m = min(lowest_m, -bench.world.truth.position_ned_m[2])
    states = {s.message.landed_state for s in bench.all("EXTENDED_SYS_STATE", start)}
    return {
        "said": f"{result}: {bench.texts(start)[0][1]}; {state(bench.heartbeat())}; landed_state {max(states)}",
        "climbed": -bench.world.truth.position_ned_m[2] - before_m,
        "sunk": before_m - lowest_m,
    }


@cache
def _landing_from_25_m() -> dict[str, float]:
    bench = Bench(plant=SIH_PLANT)
    bench.run(4.2)
    bench.fly_offboard(24.0, thrust=0.4905)
    bench.target(0.45)
    while -bench.world.truth.position_ned_m[2] > 24.9 and bench.now_s < 60.0:
        bench.run(0.05)
    bench.setpoint = None
    start = bench.now_s
    bench.command(21)
    speeds: dict[float, float] = {}
    while bench.world.vehicle.armed and bench.now_s < start + 60.0:
        bench.run(0.1)
        for height_m in (15.0, 7.6, 3.0):
            if -bench.world.vehicle.estimate.position_m[2] < height_m:
                speeds.setdefault(height_m, bench.world.vehicle.estimate.velocity_mps[2])
    return {"landed": bench.text_after("Landing detected", start), **{f"{h:g}": v for h, v in speeds.items()}}


def _prearm_while_landing() -> str:
    bench = _hovering()
    bench.command(21)
    since_s = bench.now_s + 0.5
    bench.run(4.0)
    return f"{all(s.message.onboard_control_sensors_health & 0x10000000 for s in bench.all('SYS_STATUS', since_s))}"


def _takeoff_text() -> str:
    bench = _ready()
    bench.arm()
    results = acks(bench.command(22))
    return f"{results}: {bench.texts()[-1][1]}"


def _land_text() -> str:
    bench = _ready()
    results = acks(bench.command(21))
    return f"{results}: {bench.texts()[-1][1]}; {state(bench.heartbeat())}"


ACC2 = "ACCEPTED, ACCEPTED"
FACTS = (
    same("a-0s", "arm with the first HEARTBEAT", "TEMPORARILY_REJECTED", lambda: _arm_at(0.0)),
    same("a-2s", "arm 2 s after it", "TEMPORARILY_REJECTED", lambda: _arm_at(2.0)),
    same("a-3s", "arm 3.1 s after it, in a boot as most", "ACCEPTED", lambda: _arm_at(3.1)),
    same("a-late", "arm 4.9 s after it, in a boot as one of four", "TEMPORARILY_REJECTED", lambda: _arm_at(4.9, 9)),
    same("a-5s", "arm 5.4 s after it, in such a boot", "ACCEPTED", lambda: _arm_at(5.4, 9)),
    same("a-text", "the text of a refusal", DENIED_TEXT, _denied_text),
    same("a-armed", "armed in Hold", "157, 4/3, 4: Armed by external command", _armed_state),
    same("a-arm-twice", "arm while armed", "ACCEPTED, 0 texts", lambda: _again(1.0)),
    same("a-disarm-twice", "disarm while disarmed", "ACCEPTED, 0 texts", lambda: _again(0.0)),
    same("a-odd", "arm with param1 = 2", "no ACK: Unsupported ARM_DISARM param: 2.000", _odd),
    same("a-component-0", "arm addressed to 1/0", "ACCEPTED", lambda: _addressed((1, 0))),
    same("a-all-systems", "arm addressed to 0/0", "no ACK", lambda: _addressed((0, 0))),
    same("a-other-component", "arm addressed to 1/190", "no ACK", lambda: _addressed((1, 190))),
    near(
        "a-auto-disarm",
        "armed and left alone: disarmed after",
        "11.0 s (11.3 s of wall time)",
        _auto_disarm,
        (10.5, 11.5),
    ),
    same(
        "b-no-stream",
        "OFFBOARD without ever a stream, disarmed",
        "1, 6/0, 0; arming TEMPORARILY_REJECTED",
        _offboard_without_stream,
    ),
    same("b-two-acks", "DO_SET_MODE OFFBOARD, disarmed: ACKs and state", f"{ACC2}; 1, 6/0, 0", lambda: _mode(6)),
    near(
        "b-ack-first", "the second ACK after the first, shortest of 30", "0.1 ms", lambda: _ack_gaps()[0], (0, 1), "ms"
    ),
    near("b-ack-last", "and longest", "12.3 ms", lambda: _ack_gaps()[-1], (11, 13.5), "ms"),
    near("b-ack-next", "share of them that come after 3 ms", "0.7", _late_share, (0.5, 0.9), ""),
    same("b-ready", "OFFBOARD with attitude stream, disarmed", "17, 6/0, 3", lambda: _offboard(arm=False)),
    same("b-armed", "OFFBOARD with attitude stream, armed", "145, 6/0, 4", _offboard),
    same("b-rates", "OFFBOARD armed, type_mask 128 (rates only)", "129, 6/0, 4", lambda: _offboard(mask=128)),
    same("b-stopped", "OFFBOARD, stream stopped, disarmed", "17, 6/0, 0", lambda: _offboard(stop=True, arm=False)),
    same(
        "b-in-air",
        "OFFBOARD without stream in the air",
        "ACCEPTED, TEMPORARILY_REJECTED: Switching to Offboard is currently not available; 157, 4/3, 4",
        _offboard_in_air,
    ),
    same("b-legacy", "the SET_MODE message", "ACCEPTED; 1, 6/0, 0", _legacy),
    same("b-unknown-auto", "AUTO sub-mode 99", "ACCEPTED, TEMPORARILY_REJECTED; 29, 4/3, 3", lambda: _mode(4, 99)),
    same("b-unknown-main", "main mode 99", f"{ACC2}; 29, 4/3, 3", lambda: _mode(99)),
    same("b-no-flag", "base_mode without the custom flag", f"{ACC2}; 29, 4/3, 3", lambda: _mode(6, 0, 0.0)),
    same("b-position", "Position mode without a remote control, disarmed", f"{ACC2}; 81, 3/0, 0", lambda: _mode(3)),
    same("e-in-air", "disarm in the air", "TEMPORARILY_REJECTED: Disarming denied: not landed", _disarm_in_air),
    same(
        "e-kill",
        "kill in the air",
        "ACCEPTED: Disarmed by external command; base_mode 17; landed_state 1 within 0.8 s: True",
        _kill,
    ),
    near(
        "e-takeoff-detected",
        "OFFBOARD and thrust 0.1 on the ground: take-off detected after arming",
        "0.02 to 0.06 s",
        lambda: _takeoff_detected(0.1),
        (0.0, 0.08),
    ),
    same(
        "e-idle",
        "OFFBOARD and thrust 0: take-off detected",
        "never",
        lambda: "never" if _takeoff_detected(0.0) > 1e6 else "yes",
    ),
    same("e-terminate", "DO_FLIGHTTERMINATION 0", "DENIED", lambda: acks(_hovering().command(185, 0.0))),
    same("e-reboot", "REBOOT", "DENIED", lambda: acks(_hovering().command(246, 1.0))),
    same(
        "g-disarmed",
        "NAV_TAKEOFF while disarmed: no arming",
        "ACCEPTED; 29, 4/2, 3",
        lambda: f"{acks((b := _ready()).command(22))}; {state(b.heartbeat())}",
    ),
    same("g-text", "NAV_TAKEOFF while armed", "ACCEPTED: Using default takeoff altitude: 2.5 m", _takeoff_text),
    near("g-detected", "take-off detected after the command", "1.6 s", lambda: _takeoff()["detected"], (1.3, 2.1)),
    near("g-hold", "Hold in HEARTBEAT after the command", "6.5 to 6.7 s", lambda: _takeoff()["hold"], (5.5, 7.7)),
    near("g-height", "estimated height then", "2.0 to 2.3 m", lambda: _takeoff()["height"], (1.7, 2.5), "m"),
    near("g-states", "landed_state 3 on the way, 2 afterwards", "1", lambda: _takeoff()["taking off"], (1, 1), ""),
    same("g-land-text", "NAV_LAND while disarmed", "ACCEPTED: Landing at current position; 29, 4/6, 0", _land_text),
    near(
        "g-landed",
        "from 3 m: landing detected after NAV_LAND",
        "10 to 13 s",
        _landing_from_3_m,
        (9.0, 13.5),
    ),
    near(
        "g-landed-25",
        "from 25 m: landing detected after NAV_LAND",
        "27.3 s",
        lambda: _landing_from_25_m()["landed"],
        (24.0, 30.0),
    ),
    near("g-sink-15", "sinking at 15 m", "1.5 m/s", lambda: _landing_from_25_m()["15"], (1.35, 1.65), "m/s"),
    near("g-sink-8", "at 7.6 m", "1.03 m/s", lambda: _landing_from_25_m()["7.6"], (0.9, 1.25), "m/s"),
    near("g-sink-3", "at 3 m", "0.67 m/s", lambda: _landing_from_25_m()["3"], (0.6, 0.85), "m/s"),
    same("g-prearm", "SYS_STATUS keeps the prearm bit while it lands", "True", _prearm_while_landing),
    same(
        "g-air",
        "NAV_TAKEOFF while flying",
        "ACCEPTED: Using default takeoff altitude: 3.0 m; 157, 4/2, 4; landed_state 2",
        lambda: str(_takeoff_in_air()["said"]),
    ),
    near(
        "g-air-climb", "climbs on: 2.85 s later", "1.95 m", lambda: float(_takeoff_in_air()["climbed"]), (1.4, 2.6), "m"
    ),
    near("g-air-sink", "and sinks before by", "under 0.05 m", lambda: float(_takeoff_in_air()["sunk"]), (0, 0.05), "m"),
    near("g-disarmed-after", "disarmed after the landing", "2.0 to 2.2 s", lambda: _takeoff()["disarmed"], (1.9, 2.3)),
    near("g-mode-after", "then Hold, ready", "1", lambda: _takeoff()["mode after"], (1, 1), ""),
)
