"""The [preflight] table, and the recommended parameters of the autopilot."""

import math
from typing import Self

from pydantic import Field, model_validator

from companion.config.locations import default_config_path, named_file
from companion.config.toml_files import Section, read_toml, validate
from companion.core.interfaces import ConfigError


class PreflightConfig(Section):
    """Requirements for arming; the defaults are for a real room."""

    realtime: bool = Field(True, description="arming needs a real-time priority; false: its lack is a warning")
    by_hand_within_h: float = Field(
        24.0, ge=0.0, le=10_000.0, description="longest time since it was carried by hand; 0: not asked for"
    )
    mocap_hz: float = Field(90.0, ge=10.0, le=500.0, description="least number of frames a second")
    residual_m: float = Field(0.003, gt=0.0, le=0.1, description="largest median of the marker residual, m")
    tilt_apart_rad: float = Field(
        0.05, gt=0.0, le=0.5, description="largest difference of roll and pitch between mocap and autopilot, rad"
    )
    heading_apart_rad: float = Field(
        0.1, gt=0.0, le=0.5, description="largest difference of heading between mocap and autopilot, rad"
    )
    position_apart_m: float = Field(
        0.1, gt=0.0, le=1.0, description="largest distance of position between mocap and autopilot, m"
    )
    delay_apart_s: float = Field(
        0.02, gt=0.0, le=0.2, description="largest difference of EKF2_EV_DELAY and mocap's measured delay, s"
    )
    battery: float = Field(0.5, ge=0.0, le=1.0, description="least share of the charge with which a flight may begin")
    parameters: str = Field(
        "recommended", min_length=1, description="PX4's parameters to check: a name in config/px4/, or a TOML file"
    )
    state_folder: str = Field(
        "~/.local/state/dauam",
        min_length=1,
        description="folder of the file that says when the vehicle was last carried by hand",
    )


class Recommended(Section):
    """Recommended value of one parameter, and its conditions, at least one."""

    set_to: float = Field(description="value to set when the condition is not met")
    why: str = Field(min_length=1, description="reason, for the operator")
    must: bool = Field(True, description="arming needs it; false: a warning")
    one_of: tuple[float, ...] = Field((), description="condition: one of these values")
    bits: int = Field(0, ge=0, description="condition: all these bits are set")
    at_least: float | None = Field(None, description="condition: this value or more")
    at_most: float | None = Field(None, description="condition: this value or less")
    reboot: bool = Field(False, description="PX4 takes it only after a restart")
    optional: bool = Field(False, description="a PX4 that does not have the parameter is right as it is")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not self.wanted:
            raise ValueError("needs a condition: one_of, bits, at_least or at_most")
        if not self.accepts(self.set_to):
            raise ValueError(f"set_to = {self.set_to:g} does not meet its own condition: {self.wanted}")
        return self

    def accepts(self, value: float) -> bool:
        """Return True if the value, which PX4 has as a 32 bit float, meets every condition."""
        slack = 1e-6 * max(1.0, abs(value))
        return (
            (not self.one_of or any(math.isclose(value, listed, abs_tol=1e-6) for listed in self.one_of))
            and int(value) & self.bits == self.bits
            and (self.at_least is None or value >= self.at_least - slack)
            and (self.at_most is None or value <= self.at_most + slack)
        )

    @property
    def wanted(self) -> str:
        """The conditions as text."""
        bits = ", ".join(str(bit) for bit in range(32) if self.bits >> bit & 1)
        conditions = (
            " or ".join(f"{value:g}" for value in self.one_of),
            f"bits {bits} set" if bits else "",
            f"at least {self.at_least:g}" if self.at_least is not None else "",
            f"at most {self.at_most:g}" if self.at_most is not None else "",
        )
        return " and ".join(filter(None, conditions))


def load_recommended(name: str) -> dict[str, Recommended]:
    """Return parameters by name, from a list in config/px4/ or a TOML file; ConfigError for mistakes."""
    path = named_file("px4", name)
    if path is None:
        raise ConfigError(f"preflight.parameters = {name!r}: is no file, and no name in {default_config_path('px4')}")
    return {parameter: validate(Recommended, table, path, parameter) for parameter, table in read_toml(path).items()}
