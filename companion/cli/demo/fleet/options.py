"""Options of a demo with several vehicles."""

from dataclasses import dataclass
from pathlib import Path

from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController


@dataclass(frozen=True, kw_only=True)
class FleetOptions:
    """Options of the demo that concern several vehicles."""

    vehicles: int
    settings: CompanionConfig
    law: LoadedController
    arms: str | None
    laps: int
    seed: int
    mock_config: Path
    faults: tuple[str, ...]
    free_ports: bool
    out: Path
    summary: Path | None
    page: bool
    stay_s: float
    """Time for which the vehicles stay on the page after their flight, s; infinite: until Ctrl-C."""
