"""Setpoint loss (section c), bad setpoints (d), what follows offboard.stop() (k)."""

import math
from functools import cache

from tests.mock_autopilot.bench import LEVEL, SIH_PLANT, Bench
from tests.mock_autopilot.fact import near, same, state

NAN = math.nan


def _flying(params: dict[str, float] | None = None, height_m: float = 3.0) -> Bench:
    return _flight(tuple((params or {}).items()), height_m).again()


@cache
def _flight(params: tuple[tuple[str, float], ...], height_m: float) -> Bench:
    bench = Bench(dict(params), plant=SIH_PLANT)
    bench.run(4.2)
    bench.fly_offboard(height_m, thrust=0.4905)
    bench.run(1.0)
    return bench


@cache
def _loss(action: int, timeout_s: float) -> tuple[float, str, str]:
    """Seconds to the text, the next HEARTBEAT's state, the first text after it."""
    bench = _flying({"COM_OBL_RC_ACT": action, "COM_OF_LOSS_T": timeout_s})
    bench.setpoint = None
    start = bench.now_s - 0.02
    bench.run(timeout_s + 1.2)
    return bench.text_after("Failsafe activated", start), state(bench.heartbeat()), bench.texts(start)[-1][1]


def _return_texts() -> float:
    """Seconds between both texts of Return next to home, the mean of eight."""
    gaps = []
    for drawn_before in range(8):
        bench = _flying()
        for _ in range(drawn_before):  # each flight from another state of the same chance
            bench.world.timing.return_text_s()
        bench.setpoint = None
        start = bench.now_s
        bench.run(1.6)
        gaps.append(bench.text_after("RTL: land at destination", start) - bench.text_after("RTL: start return", start))
    return sum(gaps) / len(gaps)


def _gap(gap_s: float) -> str:
    bench = _flying()
    target, bench.setpoint = bench.setpoint, None
    start = bench.now_s
    bench.run(gap_s)
    bench.setpoint = target
    bench.run(0.5)
    return "failsafe" if bench.text_after("Failsafe", start) < 10.0 else "no reaction"


def _slow_stream(hz: float) -> str:
    bench = _flying()
    bench.setpoint_period_s = 1.0 / hz
    bench.run(4.0)
    return state(bench.heartbeat())


def _resume() -> str:
    bench = _flying(height_m=6.0)
    target, bench.setpoint = bench.setpoint, None
    bench.run(3.0)
    during = state(bench.heartbeat())
    bench.setpoint = target
    bench.run(0.1)
    return f"{during}, then {state(bench.heartbeat())}"


def _other_system() -> str:
    bench = _flying()
    bench.target(0.49, system=2)
    bench.run(1.5)
    return state(bench.heartbeat())


def _no_heartbeats() -> str:
    bench = _flying(height_m=10.0)
    bench.heartbeats = False
    bench.run(8.0)
    return state(bench.heartbeat())


def _intended() -> str:
    bench = _flying()
    bench.setpoint = None
    bench.run(4.5)
    return hex(bench.all("CURRENT_MODE")[-1].message.intended_custom_mode)


def _echo(thrust: float, mask: int = 7) -> str:
    bench = _flying()
    bench.target(thrust, mask=mask)
    bench.run(0.3)
    return f"{bench.all('ATTITUDE_TARGET')[-1].message.thrust:.3g}"


def _acceleration(thrust: float, mask: int = 7) -> float:
    """Mean downward acceleration (m/s^2) between 0.15 and 0.4 s."""
    bench = _flying(height_m=12.0)
    bench.target(thrust, mask=mask)
    bench.run(0.152)
    before, at_s = bench.world.truth.velocity_ned_mps[2], bench.now_s
    bench.run(0.252)
    return float((bench.world.truth.velocity_ned_mps[2] - before) / (bench.now_s - at_s))


def _tilt_after(q: tuple[float, ...]) -> float:
    bench = _flying()
    bench.target(0.49, q)
    bench.run(0.4)
    x, y = bench.world.truth.q_ned_frd_wxyz[1:3]
    return math.degrees(2.0 * math.asin(math.hypot(x, y)))


def _garbage_keeps_offboard() -> str:
    bench = _flying(height_m=8.0)
    start = bench.now_s
    for thrust, q in ((NAN, LEVEL), (0.5, (NAN,) * 4), (0.5, (0.0,) * 4)):
        bench.target(thrust, q)
        bench.run(0.3)
    return f"{state(bench.heartbeat())}, {len(bench.texts(start))} texts"


def _mask(mask: int) -> float:
    """Roll (deg) 1 s after a 10 degree setpoint with this type mask."""
    bench = _flying(height_m=8.0)
    half = math.radians(5.0)
    bench.target(0.49, (math.cos(half), math.sin(half), 0.0, 0.0), mask)
    bench.run(1.0)
    w, x, _, _ = bench.world.truth.q_ned_frd_wxyz
    return math.degrees(2.0 * math.atan2(x, w))


def _ignore_all() -> float:
    bench = _flying()
    bench.target(0.1, mask=135)
    bench.run(0.6)
    return float(bench.world.truth.velocity_ned_mps[2])


def _stop() -> tuple[str, float]:
    bench = _flying()
    bench.mode(4, 3)
    bench.setpoint = None
    place = bench.world.truth.position_ned_m.copy()
    bench.run(6.0)
    moved = float(math.dist(place, bench.world.truth.position_ned_m))
    last = bench.all("EXTENDED_SYS_STATE")[-1].message.landed_state
    return f"{state(bench.heartbeat())}, landed_state {last}", moved


FACTS = (
    same(
        "c-default-timeout",
        "COM_OF_LOSS_T and COM_OBL_RC_ACT",
        "1.0, 0",
        lambda: f"{(p := Bench().world.vehicle.params)['COM_OF_LOSS_T']}, {p['COM_OBL_RC_ACT']}",
    ),
    near(
        "c-default",
        "defaults: last setpoint to the failsafe's text",
        "1.04 to 1.06 s",
        lambda: _loss(0, 1.0)[0],
        (0.98, 1.10),
    ),
    same("c-default-state", "defaults: state", "157, 4/5, 5", lambda: _loss(0, 1.0)[1]),
    near("c-obl3", "OBL 3, T 1.0: text", "1.04 s", lambda: _loss(3, 1.0)[0], (0.98, 1.10)),
    same("c-obl3-state", "OBL 3: Return", "157, 4/5, 5", lambda: _loss(3, 1.0)[1]),
    near("c-obl4", "OBL 4, T 0.5: text", "0.57 s", lambda: _loss(4, 0.5)[0], (0.48, 0.62)),
    same("c-obl4-state", "OBL 4: Land", "157, 4/6, 5", lambda: _loss(4, 0.5)[1]),
    near("c-obl5", "OBL 5, T 0.5: text", "0.58 s", lambda: _loss(5, 0.5)[0], (0.48, 0.62)),
    same("c-obl5-state", "OBL 5: Hold", "157, 4/3, 5", lambda: _loss(5, 0.5)[1]),
    near("c-obl7", "OBL 7, T 0.5: text", "0.52 s", lambda: _loss(7, 0.5)[0], (0.48, 0.62)),
    same("c-obl7-state", "OBL 7: motors off in the air", "17, 6/0, 0", lambda: _loss(7, 0.5)[1]),
    near(
        "c-rtl-texts",
        "Return next to home: its second text after the first",
        "0.05 to 0.15 s",
        _return_texts,
        (0.04, 0.2),
    ),
    same("c-obl7-text", "OBL 7: and says so", "Disarmed by failsafe", lambda: _loss(7, 0.5)[2]),
    same("c-gap-0.8", "a gap of 0.8 s with T 1.0", "no reaction", lambda: _gap(0.8)),
    same("c-gap-1.3", "a gap of 1.3 s with T 1.0", "failsafe", lambda: _gap(1.3)),
    same("c-2hz", "a stream of 2 Hz holds OFFBOARD", "145, 6/0, 4", lambda: _slow_stream(2.0)),
    same("c-resume", "the stream resumes during Return: OFFBOARD by itself", "157, 4/5, 5, then 145, 6/0, 4", _resume),
    same("c-other-system", "setpoints addressed to another system count as missing", "157, 4/5, 5", _other_system),
    same("c-heartbeats", "no HEARTBEAT from the client for 8 s while it streams", "145, 6/0, 4", _no_heartbeats),
    same("c-intended", "CURRENT_MODE.intended_custom_mode during the failsafe", "0x60000", _intended),
    same("d-1.5-echo", "thrust 1.5: ATTITUDE_TARGET.thrust", "1.5", lambda: _echo(1.5)),
    near(
        "d-1.5",
        "thrust 1.5: vertical acceleration (down)",
        "about -8 m/s2",
        lambda: _acceleration(1.5),
        (-10.5, -6.0),
        "m/s2",
    ),
    same("d-neg-echo", "thrust -0.5: ATTITUDE_TARGET.thrust (sign lost)", "0.5", lambda: _echo(-0.5)),
    near(
        "d-neg",
        "thrust -0.5: vertical acceleration, motors at idle",
        "about 7 m/s2",
        lambda: _acceleration(-0.5),
        (6.0, 9.5),
        "m/s2",
    ),
    same("d-nan-echo", "thrust NaN: ATTITUDE_TARGET.thrust", "nan", lambda: _echo(NAN)),
    near("d-nan", "thrust NaN: free fall", "about 8 m/s2", lambda: _acceleration(NAN), (6.5, 9.5), "m/s2"),
    near("d-q-zero", "q = 0 for 0.4 s: tilt", "under 0.5 deg", lambda: _tilt_after((0.0,) * 4), (0.0, 0.5), "deg"),
    near("d-q-nan", "q = NaN for 0.4 s: tilt", "under 0.5 deg", lambda: _tilt_after((NAN,) * 4), (0.0, 0.5), "deg"),
    near(
        "d-q-2",
        "q = (2,0,0,0) for 0.4 s: tilt",
        "under 0.5 deg",
        lambda: _tilt_after((2.0, 0.0, 0.0, 0.0)),
        (0.0, 0.5),
        "deg",
    ),
    same("d-garbage", "none of it is refused", "145, 6/0, 4, 0 texts", _garbage_keeps_offboard),
    near(
        "d-mask-0",
        "type_mask 0 with rates 0: attitude control as with 7",
        "10 deg",
        lambda: _mask(0),
        (9.0, 11.0),
        "deg",
    ),
    near("d-mask-3", "type_mask 3", "10 deg", lambda: _mask(3), (9.0, 11.0), "deg"),
    same("d-throttle-echo", "type_mask 64+7: ATTITUDE_TARGET.thrust", "0", lambda: _echo(0.6, 71)),
    near("d-throttle", "type_mask 64+7: falls", "about 8 m/s2", lambda: _acceleration(0.6, 71), (6.0, 9.5), "m/s2"),
    near(
        "d-ignore-all",
        "type_mask 135: flies on with the last values, vertical speed after 0.6 s",
        "0 m/s",
        _ignore_all,
        (-0.4, 0.4),
        "m/s",
    ),
    same("k-hold", "after offboard.stop()", "157, 4/3, 4, landed_state 2", lambda: _stop()[0]),
    near("k-place", "moved within 6 s of it", "brakes and holds", lambda: _stop()[1], (0.0, 1.0), "m"),
)
