"""The [fleet] table: several vehicles in one room, and the rule for their ports, names and places."""

from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict, Field

from mock_autopilot.qtm.config import QualisysConfig

if TYPE_CHECKING:
    from mock_autopilot.config import MockConfig

MOST_VEHICLES = 9


class FleetConfig(BaseModel):
    """Several vehicles in one room; all other tables are of each of them, ports, names and places by rule."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    vehicles: int = Field(1, ge=1, le=MOST_VEHICLES, description="How many; with one, the keys below mean nothing.")
    spacing_m: float = Field(
        1.6, gt=0.0, le=20.0, description="Between their start places, on a row along the room's y."
    )
    downwash: bool = Field(True, description="One vehicle's jet pushes those below it.")
    collisions: bool = Field(True, description="Bodies that overlap stop both vehicles' motors for good.")
    body_radius_m: float = Field(
        0.5, gt=0.0, le=5.0, description="Of a body, an upright cylinder: its propellers' tips."
    )
    body_height_m: float = Field(0.5, gt=0.0, le=5.0, description="Of a body, hanging arms included.")


def vehicle_config(config: "MockConfig", number: int) -> "MockConfig":
    """Return the settings of vehicle `number` of a fleet (1 is the first); those of a single vehicle are not changed.

    Ports as PX4's own rule for several simulated vehicles has them: the first one's plus number - 1.
    """
    count = config.fleet.vehicles
    if count == 1:
        return config
    north_m, east_m, down_m = config.vehicle.start_position_ned_m
    left_m = (number - 0.5 * (count + 1)) * config.fleet.spacing_m
    place = config.vehicle.model_copy(update={"start_position_ned_m": (north_m, east_m - left_m, down_m)})
    params = config.px4.model_copy(update={"params": {**config.px4.params, "MAV_SYS_ID": number}})
    link = config.arms.bus.link
    bus = config.arms.bus.model_copy(update={"link": f"{link}-{number}" if link else None})
    return config.model_copy(
        update={
            "vehicle": place,
            "px4": params,
            "mavlink": config.mavlink.model_copy(update=_ports(config.mavlink, number, "local_port", "remote_port")),
            "gcs": config.gcs.model_copy(update=_ports(config.gcs, number, "local_port")),
            "arms": config.arms.model_copy(update={"bus": bus}),
            "faults": tuple(fault for fault in config.faults if (fault.vehicle or 1) == number),
        }
    )


def _ports(link: Any, number: int, *keys: str) -> dict[str, int]:
    """Return a link's ports for a vehicle; 0 stays, any free one."""
    given = {key: int(getattr(link, key)) for key in keys}
    return {key: port + number - 1 if port else 0 for key, port in given.items()}


def body_names(config: "MockConfig") -> tuple[str, ...]:
    """Return the names of the vehicles' rigid bodies in QTM, in their order."""
    body, count = config.qualisys.body, config.fleet.vehicles
    return (body,) if count == 1 else tuple(f"{body}-{number}" for number in range(1, count + 1))


def fleet_cameras(config: "MockConfig") -> QualisysConfig:
    """Return the settings of a QTM with all vehicles' bodies, those that stand still behind them."""
    first, *others = body_names(config)
    bodies = {"body": first, "extra_bodies": (*others, *config.qualisys.extra_bodies)}
    return config.qualisys.model_copy(update=bodies)
