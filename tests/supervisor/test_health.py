"""The health checks as a whole: silent on a healthy flight, in the table's order, never raising."""

import re
from dataclasses import fields, replace

from companion.supervisor.faults import TABLE, Fault
from companion.supervisor.safety import SafetyRules
from tests.supervisor.observing import faults, healthy, on_ground, watched, with_seen, with_status


def test_every_number_of_the_table_is_a_limit() -> None:
    named = {name for row in TABLE for name in re.findall(r"{(\w+)}", row.sign)}
    assert len(named) > 20
    assert named <= {field.name for field in fields(SafetyRules)}


def test_a_healthy_flight_has_no_events() -> None:
    flight = [on_ground(healthy(k)) for k in range(200)] + [healthy(k) for k in range(200, 600)]
    assert not any(watched(flight))


def test_events_come_in_the_order_of_the_table_and_once_each() -> None:
    now = with_status(with_seen(healthy(0), age_s=0.07), armed=False, battery_fraction=0.2)
    now = replace(now, law_fault="no", arm_fault="the elbow", disk_free_mb=1.0, operator_age_s=9.0)
    later = replace(now, time_s=now.time_s + 0.5625)
    assert faults(watched([now, later])[-1]) == [
        Fault.MOCAP_LATE,
        Fault.LAW_FAILED,
        Fault.AUTOPILOT_SILENT,
        Fault.AUTOPILOT_DISARMED,
        Fault.BATTERY_LOW,
        Fault.ARMS,
        Fault.OPERATOR_GONE,
        Fault.DISK_FULL,
    ]
