"""The recorder keeps every tick, and NaN where there was nothing."""

from pathlib import Path

import numpy as np

from companion.core.types import AutopilotStatus, FlightMode, VehicleState
from companion.flight.tick import Tick
from companion.records.recorder import Recorder
from companion.supervisor.faults import Event, Fault
from companion.supervisor.flight_state import FlightState, Phase

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
WRONG = (Event(Fault.BATTERY_LOW, "20 % left"), Event(Fault.DISK_FULL, "1 MB free"))
STATUS = AutopilotStatus(
    connected=True,
    heartbeat_s=0.0,
    armed=False,
    mode=FlightMode.HOLD,
    in_air=False,
    battery_fraction=1.0,
    battery_v=16.0,
    q_w_flu_wxyz=LEVEL,
    last_text="",
)


def tick(number: int, seen: bool) -> Tick:
    where = np.array([float(number), 0.0, 1.0])
    vehicle = VehicleState(number * 0.01, where, 0.0 * where, LEVEL, 0.0 * where) if seen else None
    late = {"f_hat": where} if number >= 1500 else {}
    return Tick(
        time_s=number * 0.01,
        late_s=0.0,
        frame_received_s=np.nan,
        sent_s=np.nan,
        vehicle=vehicle,
        age_s=0.01,
        status=STATUS,
        flight=FlightState(phase=Phase.STANDBY),
        reference=None,
        pipeline=None,
        limited=None,
        late_signals=late,
        arms=None,
        events=WRONG,
    )


def test_every_tick_is_kept_in_order_beyond_the_first_buffers(tmp_path: Path) -> None:
    recorder = Recorder()
    for number in range(3000):
        recorder(tick(number, seen=number >= 10))
    recorder.write(tmp_path / "deep" / "flight.npz")
    with np.load(tmp_path / "deep" / "flight.npz") as kept:
        assert kept["time_s"].shape == (3000,)
        assert np.isnan(kept["position_w_m"][:10]).all()
        assert (kept["position_w_m"][10:, 0] == np.arange(10, 3000)).all()
        assert np.isnan(kept["law_f_hat"][:1500]).all()
        assert (kept["law_f_hat"][1500:, 0] == np.arange(1500, 3000)).all()
        assert set(kept["phase"]) == {"standby"}
        assert set(kept["faults"]) == {"battery low, disk full"}
    assert not recorder.flew


def test_a_signal_that_ended_early_is_nan_to_the_end() -> None:
    recorder = Recorder()
    recorder(tick(1500, seen=True))
    for number in range(1200):
        recorder(tick(number, seen=True))
    column = recorder.arrays()["law_f_hat"]
    assert column.shape == (1201, 3)
    assert np.isfinite(column[0]).all()
    assert np.isnan(column[1:]).all()
