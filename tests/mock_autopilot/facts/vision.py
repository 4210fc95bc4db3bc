"""Vision without GPS (section h)."""

import math
from functools import cache

from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.physics import quaternion as quat
from tests.mock_autopilot.bench import NO_GPS, Bench
from tests.mock_autopilot.fact import acks, near, same, state

NAN = math.nan
FLAG_PREDICTED, FLAG_SPEED, FLAG_POSITION = 256, 2, 8


def _bench(vision: bool = True) -> Bench:
    return _booted(vision).again()


@cache
def _booted(vision: bool) -> Bench:
    bench = Bench(NO_GPS)
    bench.vision = vision
    bench.run(4.2)
    return bench


def _set_origin(bench: Bench) -> None:
    bench.hear(mavlink.MAVLink_set_gps_global_origin_message(1, 473977420, 85455940, 488000))
    bench.run(0.1)


def _flags(bench: Bench) -> int:
    return bench.world.vehicle.estimator.flags


def _error_m(bench: Bench) -> float:
    return math.dist(bench.world.vehicle.estimate.position_m, bench.world.truth.position_ned_m.tolist())


def _streams_on() -> float:
    bench = _bench(vision=False)
    return len(bench.all("LOCAL_POSITION_NED", 2.2)) / (bench.now_s - 2.2)


def _blind_offboard() -> str:
    bench = _bench(vision=False)
    hold = acks(bench.arm())
    bench.target(0.0)
    bench.run(0.3)
    bench.mode(6)
    return f"Hold: {hold}, OFFBOARD: {acks(bench.arm())}"


def _air_flags() -> float:
    bench = _bench()
    bench.fly_offboard()
    return float(_flags(bench))


def _hold_refused() -> str:
    bench = _bench()
    bench.fly_offboard()
    results = acks(bench.mode(4, 3))
    return f"{results}: {bench.texts()[-1][1]}; {state(bench.heartbeat())}"


def _stop_without_origin() -> str:
    bench = _bench()
    bench.fly_offboard()
    bench.setpoint = None
    bench.run(1.2)
    return state(bench.heartbeat())


@cache
def _lost_and_found() -> dict[str, float]:
    """Vision stops in attitude OFFBOARD for 8 s and comes back."""
    bench = _bench()
    bench.fly_offboard()
    bench.run(1.0)
    start, bench.vision = bench.now_s, False
    gone: dict[int, float] = {}
    for _ in range(80):
        bench.run(0.1)
        for flag in (FLAG_PREDICTED, FLAG_SPEED, FLAG_POSITION):
            if not _flags(bench) & flag:
                gone.setdefault(flag, bench.now_s - start)
    drift = _error_m(bench)
    quiet = bench.heartbeat() == (145, 0x60000, 4) and not bench.texts(start)
    bench.vision = True
    bench.run(0.5)
    soon = _error_m(bench)
    bench.run(1.0)
    return {
        "predicted": gone[FLAG_PREDICTED],
        "position": gone[FLAG_POSITION],
        "drift": drift,
        "quiet": float(quiet),
        "soon": soon / drift,
        "later": _error_m(bench),
        "flags": float(_flags(bench)),
    }


def _jump() -> float:
    """Seconds a 1 m jump of the vision is ignored."""
    bench = _bench()
    bench.fly_offboard()
    bench.run(1.0)
    bench.vision_offset_m = (1.0, 0.0, 0.0)
    start = bench.now_s
    while _error_m(bench) < 0.7 and bench.now_s - start < 5.0:
        bench.run(0.02)
    return bench.now_s - start


@cache
def _blind_loss() -> dict[str, str | float]:
    """Vision stops, 6 s later the setpoints; down to the end."""
    bench = _bench()
    bench.fly_offboard(2.0)
    bench.vision = False
    bench.run(6.0)
    bench.setpoint = None
    bench.run(2.5)
    shown, sink = state(bench.heartbeat()), float(bench.world.truth.velocity_ned_mps[2])
    while not bench.world.truth.on_ground:
        bench.run(0.02)
    down = bench.now_s
    bench.run(0.3)
    creep = abs(bench.world.vehicle.estimate.velocity_mps[2])
    bench.run(9.0)
    return {
        "state": shown,
        "sink": sink,
        "creep": creep,
        "landed": bench.text_after("Landing detected", down),
        "disarmed": bench.text_after("Disarmed by landing", down) - bench.text_after("Landing detected", down),
    }


@cache
def _origin_hold() -> dict[str, str | float]:
    bench = _bench()
    start = bench.now_s
    _set_origin(bench)
    said = bench.texts(start)[0][1]
    flags = float(_flags(bench))
    while bench.world.vehicle.system_status != 3:
        bench.run(0.1)
    ready = bench.now_s - start
    bench.fly_offboard(4.0)
    results = acks(bench.mode(4, 3))
    shown = state(bench.heartbeat())
    bench.setpoint = None
    bench.run(3.0)
    start, bench.vision = bench.now_s, False
    bench.run(5.8)
    falling = bench.again()
    bench.run(0.2)
    now = falling.world.vehicle.estimate
    roll, pitch, _ = quat.to_euler(falling.world.vehicle.attitude_estimate_wxyz)
    return {
        "sink": now.velocity_mps[2],
        "tilt": math.degrees(math.hypot(roll, pitch)),
        "text": said,
        "flags": flags,
        "ready": ready,
        "hold": f"{results}; {shown}",
        "failsafe": bench.text_after("Failsafe activated", start),
        "then": state(bench.heartbeat()),
    }


def _origin_answer() -> str:
    """Return the answer to SET_GPS_GLOBAL_ORIGIN with an origin that is not the simulator's."""
    bench = _bench()
    bench.hear(mavlink.MAVLink_set_gps_global_origin_message(1, -338567000, 1512150000, 20500))
    bench.run(0.1)
    m = bench.all("GPS_GLOBAL_ORIGIN")[-1].message
    home_s = bench.now_s
    bench.run(1.5)
    at = bench.all("GLOBAL_POSITION_INT", home_s)[-1].message
    return f"{m.latitude}, {m.longitude}, {m.altitude}; position near it: {abs(at.lat - m.latitude) < 100}"


def _see_odometry(bench: Bench, for_s: float, velocity_share: float) -> None:
    """Stream ODOMETRY at 50 Hz: true poses, and a share of the true velocity."""
    end_s = bench.now_s + for_s
    while bench.now_s < end_s - 1e-6:
        truth = bench.world.truth
        q = truth.q_ned_frd_wxyz
        body = velocity_share * quat.to_matrix(q).T @ truth.velocity_ned_mps
        bench.hear(
            mavlink.MAVLink_odometry_message(
                0, 1, 12, *truth.position_ned_m.tolist(), q.tolist(), *body.tolist(), 0, 0, 0, [NAN] * 21, [NAN] * 21
            )
        )
        bench.run(0.02)


@cache
def _moving(velocity_share: float) -> dict[str, str]:
    """Vision by ODOMETRY; fly 2 m/s for 4 s, ask for Hold, let the setpoints stop."""
    bench = _bench()
    _set_origin(bench)
    _see_odometry(bench, 5.0, velocity_share)
    bench.vision = False
    bench.target(0.6)
    bench.run(0.1)
    bench.mode(6)
    bench.arm()
    _see_odometry(bench, 1.0, velocity_share)
    bench.target(0.505, tuple(quat.from_euler(0.0, -0.2, 0.0).tolist()))
    start = bench.now_s
    _see_odometry(bench, 4.0, velocity_share)
    said = "; ".join(text for _, text in bench.texts(start)) or "no text"
    held = acks(bench.mode(4, 3))
    bench.setpoint = None
    _see_odometry(bench, 2.0, velocity_share)
    return {"text": said, "hold": held, "then": state(bench.heartbeat())}


FACTS = (
    near("h-streams", "no vision: LOCAL_POSITION_NED streams all the same", "30 Hz", _streams_on, (29, 31), "Hz"),
    near(
        "h-flags-none",
        "no vision: ESTIMATOR_STATUS.flags",
        "229",
        lambda: float(_flags(_bench(vision=False))),
        (229, 229),
        "",
    ),
    same("h-blind-offboard", "no vision: arming", "Hold: TEMPORARILY_REJECTED, OFFBOARD: ACCEPTED", _blind_offboard),
    near("h-flags", "vision on the ground: flags", "495", lambda: float(_flags(_bench())), (495, 495), ""),
    near("h-flags-air", "vision in the air: flags", "367", _air_flags, (367, 367), ""),
    same("h-hold-ground", "vision: arming in Hold", "TEMPORARILY_REJECTED", lambda: acks(_bench().arm())),
    same(
        "h-hold-air",
        "Hold without a global origin",
        "ACCEPTED, TEMPORARILY_REJECTED: Switching to Hold is currently not available; 145, 6/0, 4",
        _hold_refused,
    ),
    same("h-stop", "and the stream stops: failsafe", "157, 4/6, 5", _stop_without_origin),
    same(
        "h-origin-text",
        "SET_GPS_GLOBAL_ORIGIN: text",
        "Preflight Fail: horizontal position unstable",
        lambda: str(_origin_hold()["text"]),
    ),
    same(
        "h-origin-answer",
        "and GPS_GLOBAL_ORIGIN, with the place that was given",
        "-338567000, 1512150000, 20500; position near it: True",
        _origin_answer,
    ),
    same(
        "h-odometry",
        "ODOMETRY with true velocities: Hold, from OFFBOARD at 2 m/s",
        "ACCEPTED, ACCEPTED; 157, 4/3, 4",
        lambda: f"{_moving(1.0)['hold']}; {_moving(1.0)['then']}",
    ),
    same(
        "h-odometry-wrong",
        "ODOMETRY with velocities of 0 while moving: Hold, then no setpoints",
        "ACCEPTED, TEMPORARILY_REJECTED; 209, 2/0, 5",
        lambda: f"{_moving(0.0)['hold']}; {_moving(0.0)['then']}",
    ),
    near("h-origin-flags", "flags with an origin", "511", lambda: float(_origin_hold()["flags"]), (511, 511), ""),
    near("h-origin-ready", "armable in Hold after it", "4 to 5 s", lambda: float(_origin_hold()["ready"]), (3.5, 5.5)),
    same(
        "h-origin-hold",
        "Hold in the air with an origin",
        "ACCEPTED, ACCEPTED; 157, 4/3, 4",
        lambda: str(_origin_hold()["hold"]),
    ),
    near(
        "h-lost-hold",
        "vision stops in Hold: failsafe after",
        "4.6 s",
        lambda: float(_origin_hold()["failsafe"]),
        (4.3, 4.9),
    ),
    same("h-lost-hold-state", "and lands", "157, 4/6, 5", lambda: str(_origin_hold()["then"])),
    near(
        "h-quiet",
        "vision stops in OFFBOARD: no text, no mode change",
        "1",
        lambda: _lost_and_found()["quiet"],
        (1, 1),
        "",
    ),
    near("h-flag-256", "flags lose 256 after", "within 1 s", lambda: _lost_and_found()["predicted"], (0.3, 1.1)),
    near("h-flag-8", "flags lose 2 and 8 after", "4.5 to 5 s", lambda: _lost_and_found()["position"], (4.5, 5.0)),
    near(
        "h-drift",
        "the reported position drifts within 8 s by",
        "11 m",
        lambda: _lost_and_found()["drift"],
        (6.0, 14.0),
        "m",
    ),
    near(
        "h-back",
        "vision back: error left after 0.5 s",
        "most of the way back",
        lambda: _lost_and_found()["soon"],
        (0.0, 0.3),
        "of the drift",
    ),
    near("h-back-later", "error left after 1.5 s", "0.1 m", lambda: _lost_and_found()["later"], (0.0, 0.15), "m"),
    near("h-back-flags", "flags then", "367", lambda: _lost_and_found()["flags"], (367, 367), ""),
    near("h-jump", "a 1 m jump of the vision is ignored for", "1 to 1.5 s", _jump, (0.9, 1.6)),
    near(
        "h-lost-land-sink",
        "Land without a position sinks, also below MPC_LAND_ALT3",
        "0.61 to 0.73 m/s",
        lambda: float(_origin_hold()["sink"]),
        (0.5, 0.85),
        "m/s",
    ),
    near(
        "h-lost-land-level",
        "and level: no tilt against the drift",
        "under 0.5 deg",
        lambda: float(_origin_hold()["tilt"]),
        (0.0, 0.5),
        "deg",
    ),
    same(
        "h-blind-loss",
        "no vision, then no setpoints: Altitude mode",
        "209, 2/0, 5",
        lambda: str(_blind_loss()["state"]),
    ),
    near("h-blind-sink", "and sinks", "0.7 to 0.8 m/s", lambda: float(_blind_loss()["sink"]), (0.45, 0.85), "m/s"),
    near(
        "h-blind-impact",
        "touched down blind: the estimate notices, vertical speed after 0.3 s",
        "0.13 to 0.27 m/s",
        lambda: float(_blind_loss()["creep"]),
        (0.0, 0.3),
        "m/s",
    ),
    near(
        "h-blind-landed",
        "landing detected after the touchdown (with vision 3.2 s)",
        "1.5 s",
        lambda: float(_blind_loss()["landed"]),
        (1.2, 3.6),
    ),
    near(
        "h-blind-disarmed",
        "disarmed after the landing",
        "2.0 s (vision was back)",
        lambda: float(_blind_loss()["disarmed"]),
        (1.9, 2.3),
    ),
)
