"""Streams, the first seconds, requests (section j), parameters (section f), two ground stations (section i)."""

import struct
from functools import cache, partial
from itertools import pairwise

from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.px4.timing import Timing
from tests.mock_autopilot.bench import NO_GPS, Bench
from tests.mock_autopilot.fact import Fact, acks, near, same, state

RATES = {
    "HEARTBEAT": 1,
    "SYS_STATUS": 5,
    "EXTENDED_SYS_STATE": 5,
    "ATTITUDE": 100,
    "ATTITUDE_QUATERNION": 50,
    "LOCAL_POSITION_NED": 30,
    "ODOMETRY": 30,
    "GLOBAL_POSITION_INT": 50,
    "HIGHRES_IMU": 50,
    "GPS_RAW_INT": 8,
    "ATTITUDE_TARGET": 10,
    "SERVO_OUTPUT_RAW": 10,
    "VFR_HUD": 10,
    "ALTITUDE": 10,
    "TIMESYNC": 10,
    "ESTIMATOR_STATUS": 1,
    "PING": 1,
    "BATTERY_STATUS": 0.5,
    "HOME_POSITION": 0.5,
    "CURRENT_MODE": 0.5,
}


@cache
def _boot() -> Bench:
    bench = Bench(gcs=False)
    bench.run(24.0)
    return bench


def _rate(name: str) -> float:
    return len(_boot().all(name, 4.003)) / 20.0


def _rate_facts() -> list[Fact]:
    facts = []
    for name, hz in RATES.items():
        px4 = f"{hz:g} Hz"
        slack = max(0.03 * hz, 0.051)
        facts.append(
            near(
                f"streams-{name.lower()}",
                f"rate of {name}",
                px4,
                partial(_rate, name),
                (hz - slack, hz + slack),
                "Hz",
            )
        )
    return facts


def _first(name: str, field: str, wanted: int) -> float:
    return next(s.time_s for s in _boot().all(name) if getattr(s.message, field) & wanted == wanted)


def _late_prearm() -> float:
    bench = Bench(seed=9)
    bench.run(8.0)
    ready = (s for s in bench.all("SYS_STATUS") if s.message.onboard_control_sensors_health & 0x10000000)
    return next(ready).time_s - 1.0


def _late_boots() -> float:
    return float(sum(Timing(seed).checks_pass_s() > 5.0 for seed in range(1, 101)))


def _heartbeat_gap() -> float:
    times = [s.time_s for s in _boot().all("HEARTBEAT")]
    return max(b - a for a, b in pairwise(times))


def _first_heartbeat() -> str:
    m = _boot().all("HEARTBEAT")[0].message
    return state((m.base_mode, m.custom_mode, m.system_status))


def _text_without_gcs() -> str:
    bench = Bench(gcs=False)
    bench.run(5.0)
    bench.arm()
    return f"{len(bench.texts())} texts"


def _long_text() -> str:
    bench = Bench()
    bench.run(2.5)
    since_s = bench.now_s
    bench.arm()
    parts = [s.message for s in bench.all("STATUSTEXT", since_s)]
    return f"{len(parts)} chunks, the first of {len(parts[0].text)} characters"


def _request(id_: int, params: dict[str, float] | None = None) -> str:
    bench = Bench(params)
    bench.run(5.002)
    before = len(bench.sent)
    result = acks(bench.command(512, float(id_)))
    message = next((s for s in bench.sent[before:] if s.message.get_msgId() == id_), None)
    return f"{'message, ' if message else ''}{result}"


def _denied_share() -> float:
    bench = Bench()
    bench.run(5.0)
    results = []
    for _ in range(50):
        results += bench.command(512, 30.0)
        bench.run(0.052)
    return results.count(2) / len(results)


def _version() -> str:
    bench = Bench()
    bench.run(2.0)
    bench.command(512, 148.0)
    m = bench.all("AUTOPILOT_VERSION")[0].message
    return f"capabilities {m.capabilities}, flight_sw_version {m.flight_sw_version}"


def _interval(id_: int, interval_us: float) -> str:
    bench = Bench()
    bench.run(3.0)
    result = acks(bench.command(511, float(id_), interval_us))
    bench.command(510, float(id_))
    return f"{result}, then {bench.all('MESSAGE_INTERVAL')[-1].message.interval_us} us"


def _granted(id_: int) -> str:
    """Return the result of SET_MESSAGE_INTERVAL at 10 Hz and the messages of one second."""
    bench = Bench()
    bench.run(3.0)
    result = acks(bench.command(511, float(id_), 100_000.0))
    since_s = bench.now_s
    bench.run(1.0)
    return f"{result}, {sum(s.message.get_msgId() == id_ and s.time_s > since_s for s in bench.sent)} of them"


def _param(read: str, index: int = -1) -> str:
    bench = Bench()
    bench.run(2.0)
    bench.hear(mavlink.MAVLink_param_request_read_message(1, 1, read.encode(), index))
    bench.run(0.5)
    answers = [s.message for s in bench.all("PARAM_VALUE")]
    return f"{answers[0].param_id} = {answers[0].param_value:.4g}" if answers else "no answer"


def _param_set(name: str, wire: bytes, kind: int) -> str:
    bench = Bench()
    bench.run(2.0)
    (value,) = struct.unpack("<f", wire)
    bench.hear(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind))
    bench.run(0.5)
    after = bench.world.vehicle.params.find(name)
    return f"{len(bench.all('PARAM_VALUE'))} PARAM_VALUE, {'unknown' if after is None else f'{after.value:g}'}"


@cache
def _param_list() -> tuple[int, float]:
    bench = Bench()
    bench.run(2.0)
    bench.hear(mavlink.MAVLink_param_request_list_message(1, 1))
    bench.run(3.0)
    values = bench.all("PARAM_VALUE")
    return len({s.message.param_index for s in values}), values[-1].time_s - values[0].time_s


def _hold_by_another() -> str:
    bench = Bench()
    bench.run(4.2)
    bench.fly_offboard()
    bench.hear(mavlink.MAVLink_command_long_message(1, 1, 176, 0, 129, 4, 3, 0, 0, 0, 0), system=255)
    bench.run(3.0)  # the first client's setpoints go on
    held = state(bench.heartbeat())
    acked = bench.all("COMMAND_ACK")[-1].message
    bench.mode(6)
    return f"{held} (ACK to {acked.target_system}); after an explicit command {state(bench.heartbeat())}"


FACTS = (
    *_rate_facts(),
    near(
        "streams-first-heartbeat",
        "first HEARTBEAT after the first stream",
        "1.0 s",
        lambda: _boot().all("HEARTBEAT")[0].time_s,
        (0.95, 1.05),
    ),
    near("streams-heartbeat-gap", "HEARTBEAT is strictly periodic: longest gap", "1.0 s", _heartbeat_gap, (0.99, 1.01)),
    same("streams-boot-state", "first HEARTBEAT: base_mode, mode, status", "29, 4/3, 0", _first_heartbeat),
    near(
        "streams-flags-gps",
        "ESTIMATOR_STATUS.flags complete (1023)",
        "3.0 s after the first stream",
        lambda: _first("ESTIMATOR_STATUS", "flags", 1023),
        (2.9, 4.1),
    ),
    near(
        "streams-prearm",
        "SYS_STATUS gets the prearm bit after the first HEARTBEAT, in nine of twelve boots",
        "3.0 to 3.3 s",
        lambda: _first("SYS_STATUS", "onboard_control_sensors_health", 0x10000000) - 1.0,
        (2.95, 3.55),
    ),
    near("streams-prearm-late", "and in the other three", "5.0 to 5.2 s", _late_prearm, (4.95, 5.55)),
    near("streams-prearm-share", "boots of 100 in which it takes the longer", "25 of 100", _late_boots, (15, 35), ""),
    same("texts-need-gcs", "texts after arming without any ground station's HEARTBEAT", "0 texts", _text_without_gcs),
    same("texts-chunks", "a text of more than 50 characters", "2 chunks, the first of 50 characters", _long_text),
    same("f-known", "read COM_OF_LOSS_T", "COM_OF_LOSS_T = 1", lambda: _param("COM_OF_LOSS_T")),
    same(
        "f-int-bytes",
        "INT32 lies byte by byte in the float: COM_RC_IN_MODE = 1 reads as",
        "COM_RC_IN_MODE = 1.401e-45",
        lambda: _param("COM_RC_IN_MODE"),
    ),
    same("f-unknown", "read an unknown parameter", "no answer", lambda: _param("XXX_UNKNOWN")),
    same("f-index", "read by index 0", "ASPD_SCALE_1 = 1", lambda: _param("", 0)),
    same("f-index-out", "read by index out of range", "no answer", lambda: _param("", 32000)),
    same(
        "f-set",
        "set COM_OF_LOSS_T to 0.7: PARAM_VALUE twice",
        "2 PARAM_VALUE, 0.7",
        lambda: _param_set("COM_OF_LOSS_T", struct.pack("<f", 0.7), 9),
    ),
    same(
        "f-no-range",
        "set COM_OF_LOSS_T to 1000: no range check",
        "2 PARAM_VALUE, 1000",
        lambda: _param_set("COM_OF_LOSS_T", struct.pack("<f", 1000.0), 9),
    ),
    same(
        "f-wrong-type",
        "set COM_OBL_RC_ACT = 4 as a float: ignored",
        "0 PARAM_VALUE, 0",
        lambda: _param_set("COM_OBL_RC_ACT", struct.pack("<f", 4.0), 9),
    ),
    same(
        "f-set-unknown",
        "set an unknown parameter",
        "0 PARAM_VALUE, unknown",
        lambda: _param_set("XXX_UNKNOWN", struct.pack("<f", 1.0), 9),
    ),
    near("f-list-count", "PARAM_REQUEST_LIST: how many", "879", lambda: float(_param_list()[0]), (879, 879), ""),
    near("f-list-time", "PARAM_REQUEST_LIST: how long", "0.84 s", lambda: _param_list()[1], (0.6, 1.1)),
    same(
        "i-second-gcs",
        "another ground station commands Hold during the stream",
        "157, 4/3, 4 (ACK to 255); after an explicit command 145, 6/0, 4",
        _hold_by_another,
    ),
    same("j-version", "REQUEST_MESSAGE 148", "message, ACCEPTED", lambda: _request(148)),
    same("j-version-content", "AUTOPILOT_VERSION", "capabilities 59647, flight_sw_version 17891583", _version),
    same("j-protocol", "REQUEST_MESSAGE 300", "message, ACCEPTED", lambda: _request(300)),
    same("j-metadata", "REQUEST_MESSAGE 397", "message, ACCEPTED", lambda: _request(397)),
    same("j-modes", "REQUEST_MESSAGE 435", "message, ACCEPTED", lambda: _request(435)),
    same("j-home", "REQUEST_MESSAGE 242", "message, ACCEPTED", lambda: _request(242)),
    same("j-home-no-gps", "REQUEST_MESSAGE 242 without GPS and origin", "DENIED", lambda: _request(242, NO_GPS)),
    same("j-unknown", "REQUEST_MESSAGE 9999", "DENIED", lambda: _request(9999)),
    same("j-nothing", "REQUEST_MESSAGE 65 without a remote control", "DENIED", lambda: _request(65)),
    near("j-fast", "REQUEST_MESSAGE 30 refused for want of a new sample", "3 of 10", _denied_share, (0.15, 0.55), ""),
    same(
        "j-interval", "SET_MESSAGE_INTERVAL 32 at 10000 us", "ACCEPTED, then 10000 us", lambda: _interval(32, 10000.0)
    ),
    same("j-interval-stop", "SET_MESSAGE_INTERVAL 31 with -1", "ACCEPTED, then -1 us", lambda: _interval(31, -1.0)),
    same("j-interval-default", "SET_MESSAGE_INTERVAL 31 with 0", "ACCEPTED, then 20000 us", lambda: _interval(31, 0.0)),
    same("j-interval-unknown", "SET_MESSAGE_INTERVAL 9999", "FAILED, then -1 us", lambda: _interval(9999, 100000.0)),
    same(
        "j-interval-84",
        "SET_MESSAGE_INTERVAL 84, which PX4 cannot stream",
        "FAILED, then -1 us",
        lambda: _interval(84, 100000.0),
    ),
    same(
        "j-interval-65", "SET_MESSAGE_INTERVAL 65 without a remote control", "ACCEPTED, 0 of them", lambda: _granted(65)
    ),
    same("j-interval-115", "SET_MESSAGE_INTERVAL 115 at 10 Hz", "ACCEPTED, 10 of them", lambda: _granted(115)),
    same("j-command-unknown", "an unknown command", "UNSUPPORTED", lambda: acks(_boot().again().command(31010, 1.0))),
)
