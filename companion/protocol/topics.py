"""Where on the broker what is said: `<prefix>/v1/<vehicle>/...`, so that several vehicles share a broker."""

from dataclasses import dataclass

VERSION = "v1"
"""Of topics and messages together: what an older reader would take wrongly gets a new one."""


@dataclass(frozen=True)
class Topics:
    """One vehicle's."""

    prefix: str
    vehicle: str

    @property
    def root(self) -> str:
        """Without a slash at its end."""
        return f"{self.prefix}/{VERSION}/{self.vehicle}"

    @property
    def command(self) -> str:
        """Operators to the service: commands.Command."""
        return f"{self.root}/command"

    @property
    def state(self) -> str:
        """Service to everyone, 10 Hz: telemetry.State."""
        return f"{self.root}/state"

    @property
    def event(self) -> str:
        """Service to everyone, at once: telemetry.Happened."""
        return f"{self.root}/event"

    @property
    def status(self) -> str:
        """Service to everyone, retained, and its last will: telemetry.Presence."""
        return f"{self.root}/status"

    @property
    def mocap(self) -> str:
        """The room's workstation to the service: telemetry-free, see bus.mocap."""
        return f"{self.root}/mocap"

    @property
    def mocap_bridge(self) -> str:
        """The workstation to everyone, retained, and its last will: mocap.BridgePresence."""
        return f"{self.mocap}/bridge"

    def reply(self, client: str) -> str:
        """Service to one operator's client: telemetry.Reply."""
        return f"{self.root}/reply/{client}"

    def is_reply(self, topic: str) -> bool:
        """Whether a response topic is one that replies may go to: of this vehicle, and one client's."""
        client = topic.removeprefix(f"{self.root}/reply/")
        return client != topic and is_client(client)


def is_client(name: str) -> bool:
    """1 to 64 letters, digits, - or _: a level of a topic, and nothing that a broker reads as a pattern."""
    return name.isascii() and name.replace("-", "").replace("_", "").isalnum() and len(name) <= 64
