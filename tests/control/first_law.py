"""A user's own law for the tests to write, load and break."""

from pathlib import Path

import numpy as np

from companion.config.controller_config import LoadedController, load_controller
from companion.control.controller import ControlInput, VehicleModel
from companion.core.types import Reference

VEHICLE = VehicleModel()

PD = """\
from dataclasses import dataclass
import numpy as np
from companion.control.controller import ControlOutput
from companion.control.gains import Gains

class PdGains(Gains):
    kp: float = 1.0

@dataclass(frozen=True)
class Pd:
    gains: PdGains
    vehicle: object
    period_s: float
    preview_s = 0.0

    def initial(self, first):
        return {"integral": np.zeros_like(first.position_w_m)}

    def step(self, memory, now):
        error = now.position_w_m - now.reference.position_w_m
        integral = memory["integral"] + error * now.dt_s
        accel = -self.gains.kp * error - 2.0 * now.velocity_w_mps - 0.1 * integral
        event = np.ones((*error.shape[:-1], 1))
        return {"integral": integral}, ControlOutput(accel, event, {"error": error})
"""


def loaded(folder: Path, code: str, toml: str = 'law = "pd.py:Pd"') -> LoadedController:
    (folder / "pd.py").write_text(code, encoding="utf-8")
    (folder / "mine.toml").write_text(toml, encoding="utf-8")
    return load_controller(str(folder / "mine.toml"), VEHICLE, 0.01)


def still_at(offset_w_m: list[float]) -> ControlInput:
    reference = Reference(np.zeros(3), np.zeros(3), np.zeros(3), 0.0)
    level, nothing = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    return ControlInput(
        position_w_m=np.array(offset_w_m),
        velocity_w_mps=nothing,
        q_w_flu_wxyz=level,
        rate_flu_radps=nothing,
        age_s=0.01,
        reference=reference,
        sent_accel_w_mps2=nothing,
        dt_s=0.01,
    )


FAILING_LINE = PD.splitlines().index('        integral = memory["integral"] + error * now.dt_s') + 2


def failing_law(folder: Path) -> Path:
    """A controller file in the folder, whose law passes the check and raises in the tenth cycle of a flight."""
    line = '        integral = memory["integral"] + error * now.dt_s\n'
    code = PD.replace(
        line, f'        age = memory.get("age", 0)\n        memory["none" if age > 9 else "integral"]\n{line}'
    )
    code = code.replace('return {"integral": integral}, C', 'return {"integral": integral, "age": age + 1}, C')
    (folder / "pd.py").write_text(code, encoding="utf-8")
    path = folder / "failing.toml"
    path.write_text('law = "pd.py:Pd"\n', encoding="utf-8")
    return path
