"""Topics on the broker: `<prefix>/v1/<vehicle>/...`, so that several vehicles can share one broker."""

from dataclasses import dataclass

VERSION = "v1"
"""Version of topics and messages together: raised by every change that an older reader would misread."""
ALL = "all"
"""Word by which operators address every vehicle that is online; no vehicle may have it as its name."""


@dataclass(frozen=True)
class Topics:
    """Topics on the broker that belong to one vehicle."""

    prefix: str
    vehicle: str

    @property
    def root(self) -> str:
        """Common beginning of all topics, without a slash at its end."""
        return f"{self.prefix}/{VERSION}/{self.vehicle}"

    @property
    def command(self) -> str:
        """Topic from operators to the service: commands.Command."""
        return f"{self.root}/command"

    @property
    def state(self) -> str:
        """Topic from the service to everyone, 10 Hz: telemetry.State."""
        return f"{self.root}/state"

    @property
    def event(self) -> str:
        """Topic from the service to everyone, at once: telemetry.Happened."""
        return f"{self.root}/event"

    @property
    def status(self) -> str:
        """Topic from the service to everyone, retained, and its last will: telemetry.Presence."""
        return f"{self.root}/status"

    @property
    def about(self) -> str:
        """Topic from the service to everyone, retained: about.About."""
        return f"{self.root}/about"

    @property
    def intent(self) -> str:
        """Topic from the service to other vehicles' services, retained: intent.Intent, empty when it has none."""
        return f"{self.root}/intent"

    @property
    def mocap(self) -> str:
        """Topic from the room's workstation to the service: mocap.MocapPose."""
        return f"{self.root}/mocap"

    @property
    def mocap_bridge(self) -> str:
        """Topic from the workstation to everyone, retained, and its last will: mocap.BridgePresence."""
        return f"{self.mocap}/bridge"

    def reply(self, client: str) -> str:
        """Return the topic from the service to one operator's client: telemetry.Reply."""
        return f"{self.root}/reply/{client}"

    def is_reply(self, topic: str) -> bool:
        """Return True if replies may be sent to `topic`: it belongs to this vehicle and to one client."""
        client = topic.removeprefix(f"{self.root}/reply/")
        return client != topic and is_client(client)


def is_client(name: str) -> bool:
    """Return True for 1 to 64 letters, digits, - or _: one topic level without wildcards."""
    return name.isascii() and name.replace("-", "").replace("_", "").isalnum() and len(name) <= 64


def is_vehicle(name: str) -> bool:
    """Return True for a name that a vehicle may have: as `is_client`, 32 characters at most, not `all`."""
    return is_client(name) and len(name) <= 32 and name != ALL
