"""The mocks in the test's own process, and a configuration file that finds them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from companion.cli.demo.mock_process import MockPorts, free_ports
from mock_autopilot.config import MockConfig
from mock_autopilot.simulator import Simulator

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Room:
    """Simulated room, with the companion's configuration file for it."""

    mock: Simulator
    config: Path


def room(
    folder: Path,
    ports: MockPorts | None = None,
    url: str | None = None,
    params: Mapping[str, float] | None = None,
    arms: bool = False,
) -> Room:
    """Run the demo's vehicle with other parameters; `url` when the companion listens elsewhere than on `ports`."""
    ports, cameras = ports or free_ports(), free_ports().qualisys
    link = str(folder / "servo-bus")
    data = MockConfig.load(ROOT / "config" / "mock.toml").model_dump()
    data["mavlink"] |= {"local_port": ports.autopilot, "remote_port": ports.client}
    data["qualisys"]["port"] = cameras
    data["px4"]["params"] |= params or {}
    data["arms"]["enabled"] = arms
    data["arms"]["bus"]["link"] = link
    path = folder / "companion.toml"
    path.write_text(
        f"[mocap]\nport = {cameras}\nconnect_timeout_s = 30.0\nfirst_frame_timeout_s = 30.0\n"
        f'[px4]\nurl = "{url or f"udpin://127.0.0.1:{ports.client}"}"\nconnect_timeout_s = 30.0\n'
        f'[preflight]\nrealtime = false\nby_hand_within_h = 1.0\nstate_folder = "{folder / "state"}"\n'
        + (f'[arms]\nport = "{link}"\nsilent_s = 2.0\n' if arms else "")
    )
    return Room(Simulator(MockConfig.from_dict(data), 1), path)
