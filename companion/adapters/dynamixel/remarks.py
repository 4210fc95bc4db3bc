"""Warnings for unusual settings with which a servo still works. Pure.

Meanings and factory values: https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/ and
https://emanual.robotis.com/docs/en/dxl/ax/ax-12a/, "Control Table Description".
"""

from collections.abc import Iterator

from companion.adapters.dynamixel.faults import described
from companion.adapters.dynamixel.found import FACTORY_GAINS, Found
from companion.adapters.dynamixel.joint import Joint
from companion.adapters.dynamixel.registers import OVERHEATING, OVERLOAD, Xm
from companion.config.arms_config import ArmsConfig

MOST_HOMING_OFFSET = 1024
"""Position control ignores a larger one."""
_WATCHDOG_S = 0.02
_WIZARD = "with DYNAMIXEL Wizard 2.0"


def remarks(joint: Joint, found: Found, config: ArmsConfig) -> list[str]:
    """Return a warning for every setting that may surprise later; empty when there is none."""
    if found.model_number != joint.scale.model.number:
        return []
    lines = (*_angles(joint, found), *_protection(joint, found, config), *_strength(joint, found))
    return [f"{joint.label} {line}" for line in lines]


def _angles(joint: Joint, found: Found) -> Iterator[str]:
    offset = found.homing_offset
    zero = f"set it to 0 {_WIZARD} and measure arms.servos.{joint.name}.zero_rad"
    if abs(offset) > MOST_HOMING_OFFSET:
        yield f"has Homing Offset {offset}, which position control ignores: {zero}"
    elif offset:
        yield (
            f"has Homing Offset {offset} ({offset * Xm.HOMING_OFFSET.unit:+.2f} rad), which is in all its angles and "
            f"lost by a factory reset: {zero} anew"
        )


def _protection(joint: Joint, found: Found, config: ArmsConfig) -> Iterator[str]:
    ignored = (OVERLOAD | OVERHEATING) & ~found.shutdown
    if ignored:
        factory = 52 if joint.protocol == 2 else 36
        yield (
            f"keeps its torque on {described(ignored, joint.protocol)} (Shutdown {found.shutdown}) and can burn: "
            f"set it to {factory} {_WIZARD}"
        )
    if found.temperature_limit_c < config.max_temperature_c:
        yield (
            f"switches off above {found.temperature_limit_c:.0f} degrees C (Temperature Limit), and may fly at up to "
            f"{config.max_temperature_c:g}: raise it {_WIZARD}, or lower arms.max_temperature_c"
        )
    if found.starts_with_torque:
        yield (
            "switches its torque on by itself when it gets power (Startup Configuration), so that a restart goes "
            f"unnoticed: set it to 0 {_WIZARD}"
        )
    if found.bus_watchdog > 0:
        yield (
            f"stops when the bus is quiet for {found.bus_watchdog * _WATCHDOG_S:g} s (Bus Watchdog), left by another "
            "program: restart its power"
        )


def _strength(joint: Joint, found: Found) -> Iterator[str]:
    wanted_radps = joint.limit.max_velocity_radps
    if found.velocity_limit_radps is not None and found.velocity_limit_radps < wanted_radps:
        yield (
            f"has Velocity Limit {found.velocity_limit_radps:.2f} rad/s, less than its joint's {wanted_radps:g}: raise "
            f"it {_WIZARD}, or lower arms.limits"
        )
    if found.pwm_share < 1.0 - 1e-9:
        yield (
            f"may use {found.pwm_share:.0%} of its voltage (PWM Limit, Goal PWM) and be too weak for its arm: set PWM "
            f"Limit to 885 {_WIZARD}, and restart its power"
        )
    if found.gains != FACTORY_GAINS:
        said = ", ".join(map(str, found.gains))
        yield (
            f"has position gains P, I, D and feedforward {said} instead of {', '.join(map(str, FACTORY_GAINS))}, left "
            "by another program: restart its power"
        )
