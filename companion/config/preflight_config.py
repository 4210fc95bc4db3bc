"""The [preflight] table, and the recommended parameters of the autopilot."""

import math
from pathlib import Path
from typing import Self

from pydantic import Field, model_validator

from companion.config.locations import project_root
from companion.config.recommended_parameter import Recommended
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


class RecommendedConfig(Section):
    """One parameter of a list; at least one condition."""

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
        if not self.recommended("").wanted:
            raise ValueError("needs a condition: one_of, bits, at_least or at_most")
        if not self.recommended("").accepts(self.set_to):
            raise ValueError(f"set_to = {self.set_to:g} does not meet its own condition: {self.recommended('').wanted}")
        return self

    def recommended(self, name: str) -> Recommended:
        """For the check."""
        given = self.model_dump(exclude={"at_least", "at_most"})
        least = -math.inf if self.at_least is None else self.at_least
        most = math.inf if self.at_most is None else self.at_most
        return Recommended(name=name, at_least=least, at_most=most, **given)


def load_recommended(name: str) -> tuple[Recommended, ...]:
    """A list of parameters in config/px4/ by its name, or a TOML file; ConfigError with what is wrong."""
    path = project_root() / "config" / "px4" / f"{name}.toml"
    if not path.is_file():
        path = Path(name)
    if not path.is_file():
        raise ConfigError(f"preflight.parameters = {name!r}: is no file, and no name in {project_root()}/config/px4")
    tables = read_toml(path)
    return tuple(
        validate(RecommendedConfig, table, path, parameter).recommended(parameter)
        for parameter, table in tables.items()
    )
