"""Settings of the motion-capture source; strict, so that a misspelt key is an error."""

from typing import ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from companion.config.operator_config import OperatorConfig
from companion.config.toml_files import Section

_OTHER_PORTS = {
    22221: "telnet",
    22222: "version 1.0 of its protocol",
    22224: "big endian",
    22225: "OSC",
    22226: "being discovered",
}
"""QTM's, with its usual base port 22222 (QTM RT protocol, "IP port numbers")."""


class MocapBrokerConfig(OperatorConfig):
    """[mocap.broker]: like [operator], for a broker, or a user of it, that only motion capture has."""

    table: ClassVar[str] = "mocap.broker"

    @model_validator(mode="after")
    def _of_the_room(self) -> "MocapBrokerConfig":
        if self.embedded:
            raise ValueError("embedded is for [operator] alone: the bridge and the service both come to this broker")
        return self


class MocapConfig(Section):
    """Address of QTM, name of the vehicle's body, and transport of its frames.

    With source = "mqtt" it is the bridge that comes to QTM by host, port, body and transport.
    """

    source: Literal["qualisys", "mqtt"] = Field(
        default="qualisys",
        description="Where frames come from: QTM itself, or by mqtt what `companion mocap-bridge` forwards of it.",
    )
    broker: MocapBrokerConfig | None = Field(
        default=None, description="For source = mqtt; [operator]'s broker if left out."
    )
    host: str = Field(default="127.0.0.1", min_length=1, description="Address of the computer that runs QTM.")
    port: int = Field(default=22223, gt=0, le=65535, description="QTM's TCP port for little endian (base port + 1).")
    body: str = Field(default="dauam", min_length=1, description="Name of the vehicle's rigid body in QTM.")
    transport: Literal["tcp", "udp"] = Field(default="tcp", description="How frames travel; commands always use TCP.")
    udp_port: int = Field(default=0, ge=0, le=65535, description="Local UDP port for frames; 0 takes any free one.")
    connect_timeout_s: float = Field(
        default=3.0, gt=0.0, le=60.0, description="Longest time QTM may take to accept, and to answer each question."
    )
    first_frame_timeout_s: float = Field(
        default=3.0,
        gt=0.0,
        le=60.0,
        description="Longest time from asking for the stream to the first frame.",
    )
    delay_s: float = Field(
        default=0.010,
        ge=0.0,
        le=0.5,
        description="Known time from capture to arrival here; measure it once per room.",
    )

    @field_validator("port")
    @classmethod
    def _little_endian(cls, port: int) -> int:
        if port in _OTHER_PORTS:
            raise ValueError(
                f"{port} is QTM's port for {_OTHER_PORTS[port]}: give the one for little endian, 22223, or with "
                "another base port that plus 1"
            )
        return port

    @model_validator(mode="after")
    def _together(self) -> "MocapConfig":
        if self.broker is not None and self.source != "mqtt":
            raise ValueError('broker is for frames by way of MQTT: give source = "mqtt" as well, or no [mocap.broker]')
        return self


def mocap_and_operator(mocap: MocapConfig, operator: OperatorConfig | None) -> str:
    """Return why frames cannot come by way of MQTT; empty when they can, or come from QTM itself."""
    if mocap.source != "mqtt":
        return ""
    if mocap.broker is None and operator is None:
        return 'mocap.source = "mqtt": over which broker? Give [operator], or [mocap.broker] with host'
    if mocap.broker is None and operator is not None and operator.embedded:
        return (
            'mocap.source = "mqtt": the embedded broker of [operator] is for this computer alone, and the bridge comes '
            "from another: give [mocap.broker] with host"
        )
    if mocap.broker is not None and operator is not None and mocap.broker.topics != operator.topics:
        return (
            f"mocap.broker: its topics begin with {mocap.broker.topics.root}, those of [operator] with "
            f"{operator.topics.root}: give both the same prefix and vehicle"
        )
    return ""
