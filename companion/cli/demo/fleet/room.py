"""Names, ports and configuration files of a demo's vehicles, by the mocks' rule (docs/several-vehicles.md)."""

import random
import socket
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from companion.cli.demo.fleet.toml_text import toml_of
from companion.cli.demo.mock_process import MockPorts, usual_tcp_port
from companion.config.companion_config import CompanionConfig
from companion.config.operator_config import OperatorConfig
from companion.config.separation_config import SeparationConfig
from companion.core.interfaces import ConfigError

_CLIENT, _AUTOPILOT, _QUALISYS, _BROKER = 14540, 14580, 22223, 1883
_TRIES = 50
LANE_M = 2.6
"""Distance between two vehicles' laps: the cylinder of [separation], and room for what both may still fly."""


@dataclass(frozen=True, kw_only=True)
class RoomPlan:
    """One vehicle's configuration for each, and where the mocks and the broker are."""

    configs: tuple[CompanionConfig, ...]
    ports: MockPorts
    broker: OperatorConfig

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the vehicles, by priority."""
        return tuple(config.mocap.body for config in self.configs)

    @property
    def separation(self) -> SeparationConfig:
        """Rules that all have."""
        return self.configs[0].separation

    def lane_y_m(self, index: int) -> float:
        """Return the y in W around which vehicle number `index`, from 0, flies its laps."""
        return (index - 0.5 * (len(self.configs) - 1)) * LANE_M

    def endpoints(self) -> tuple[OperatorConfig, ...]:
        """Return the broker with each vehicle's name."""
        return tuple(self.broker.model_copy(update={"vehicle": name}) for name in self.names)

    def write(self, folder: Path) -> tuple[Path, ...]:
        """Write each vehicle's file, and return their paths."""
        paths = []
        for name, config in zip(self.names, self.configs, strict=True):
            path = folder / f"{name}.toml"
            path.write_text(toml_of(config.model_dump(mode="json", exclude_none=True)), encoding="utf-8")
            paths.append(path)
        return tuple(paths)


def plan_room(settings: CompanionConfig, vehicles: int, records: Path, free: bool) -> RoomPlan:
    """Return the plan of a room whose vehicles are like the one of `settings`; ConfigError where ports are taken."""
    client, autopilot = _udp(vehicles, free)
    qualisys = usual_tcp_port(_QUALISYS, free)
    broker = OperatorConfig(port=usual_tcp_port(_BROKER, free), vehicle=f"{settings.mocap.body}-1")
    link = f"{settings.arms.port}{f'-{client}' if free else ''}" if settings.arms else None
    names = tuple(f"{settings.mocap.body}-{number}" for number in range(1, vehicles + 1))
    separation = settings.separation.model_copy(update={"order": names})
    configs = tuple(
        settings.model_copy(
            update={
                "px4": settings.px4.model_copy(
                    update={"url": f"udpin://127.0.0.1:{client + index}", "system_id": index + 1}
                ),
                "mocap": settings.mocap.model_copy(update={"port": qualisys, "body": name}),
                "arms": settings.arms.model_copy(update={"port": f"{link}-{index + 1}"}) if settings.arms else None,
                "operator": broker.model_copy(update={"vehicle": name}),
                "separation": separation,
                "records": settings.records.model_copy(update={"folder": str(records.resolve()), "live_port": 0}),
            }
        )
        for index, name in enumerate(names)
    )
    ports = MockPorts(client, autopilot, qualisys, link, vehicles=vehicles)
    return RoomPlan(configs=configs, ports=ports, broker=broker)


def _udp(vehicles: int, free: bool) -> tuple[int, int]:
    """Return the first of the clients' and of the autopilots' UDP ports, which lie in a row."""
    if not free:
        return _CLIENT, _AUTOPILOT
    choice = random.Random()
    for _ in range(_TRIES):
        first = choice.randrange(20_000, 32_000)
        if _all_free(range(first, first + 2 * vehicles)):
            return first, first + vehicles
    raise ConfigError(f"no {2 * vehicles} UDP ports in a row are free on this computer")


def _all_free(ports: range) -> bool:
    with ExitStack() as ends:
        try:
            for port in ports:
                ends.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)).bind(("127.0.0.1", port))
        except OSError:
            return False
    return True
