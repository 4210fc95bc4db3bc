"""Limits of the health checks; the configuration's [safety] table sets them."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class SafetyRules:
    """Limits of the health checks; faults.TABLE gives the reason for each."""

    coast_s: float = 0.05
    degraded_s: float = 0.10
    silent_s: float = 0.25
    """With frame time, cycle and command, PX4 lands 0.3 s after the last pose."""
    frozen_s: float = 0.15
    slow_hz: float = 50.0
    delayed_s: float = 0.06
    out_of_order_share: float = 0.2
    clock_jump_s: float = 0.1
    tilt_apart_rad: float = 0.25
    heading_apart_rad: float = 0.35
    apart_s: float = 0.3
    not_followed_rad: float = 0.3
    not_followed_s: float = 0.4
    follow_radps: float = 7.0
    """Bandwidth of a healthy attitude loop, delays included: healthy vehicles have 6.3 to 12 rad/s."""
    follow_damping: float = 0.8
    tracking_m: float = 0.5
    tracking_s: float = 0.3
    lost_m: float = 1.0
    growing_s: float = 0.6
    beyond_m: float = 0.5
    saturated_s: float = 0.7
    not_finite_cycles: int = 20
    loop_late_s: float = 0.02
    dead_man_s: float = 0.2
    autopilot_silent_s: float = 0.5
    land_refused_s: float = 3.0
    battery_low: float = 0.25
    battery_critical: float = 0.12
    horizon_capped_s: float = 2.0
    """PX4's recorded errors exceeded the cap for less than a second."""
    landing_s: float = 15.0
    landing_above_s: float = 60.0
    """PX4's landing would lead onto the other one, unguarded; the critical battery still ends the wait before."""
    hold_s: float = 30.0
    operator_gone_s: float = 2.0
    disk_free_mb: float = 200.0
    traffic_margin_m: float = 0.1
    """Beyond the cylinder of [separation]: the least that hold and guard leave between two vehicles that obey."""
    yield_margin_m: float = 0.3
    """Beyond the cylinder, for the vehicle that yields: it stops 0.2 m before the first one would have to."""
    yield_ahead_s: float = 2.5
    """Vehicles at 1 m/s that would meet at right angles are 5 m apart by then: time to stop clear of the other."""
    yield_s: float = 3.0
    """With 6 s for a landing from 1.5 m, nobody waits for more than 10 s."""
    other_unseen_s: float = 0.5
    """Bodies are lost for some frames again and again; at 1 m/s a vehicle has flown 0.5 m by then."""
    command_late_s: float = 0.1
    """A beat comes every 0.03 s: three in a row are missing."""
    command_coast_s: float = 0.12
    command_level_s: float = 0.2
    command_silent_s: float = 0.25
    """With beat, cycle and command, PX4 lands 0.3 s after the last command."""
    command_delayed_s: float = 0.06
    """With so much more delay than it is made for, the law still lands."""
    commands_lost_share: float = 0.6
    commands_late_share: float = 0.4
