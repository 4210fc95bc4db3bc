"""Experiments of some seconds, for tests that need flights but not the paper's."""

from pathlib import Path

_TABLES = """
settle_s = 0.5

[trajectory]
curve = "ellipse"
semi_axes_m = [0.2, 0.1]
period_s = 4.0
laps = 1
ramp_s = 1.0

[companion.vehicle]
attitude_bandwidth_radps = 10.0
setpoint_delay_s = 0.02
thrust_delay_s = 0.02

[companion.mocap]
delay_s = 0.02

[companion.arms]

[mock.plant]
attitude_bandwidth_radps = [10.0, 10.0, 3.0]
attitude_damping = [0.8, 0.8, 0.8]
torque_lag_s = [0.0, 0.0, 0.0]

[mock.vehicle]
attitude_delay_s = 0.02
thrust_delay_s = 0.02

[mock.qualisys]
delay_s = 0.02
noise_m = 0.0003
noise_rad = 0.002

[mock.arms]
enabled = true

[mock.disturbance]
constant_ned_n = [0.5, -0.25, 0.1]
"""


def short_experiment(path: Path, *, arms: str = "off", title: str = "a short ellipse", noise_n: float = 0.2) -> Path:
    """An experiment file of 5.5 s: half a second of hover, one small lap."""
    head = f'title = "{title}"\narms = "{arms}"\n'
    path.write_text(f"{head}{_TABLES}noise_n = [{noise_n}, {noise_n}, {noise_n}]\n", encoding="utf-8")
    return path
