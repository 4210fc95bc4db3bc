"""The [operator] table: the MQTT broker over which orders come. Without the table there is no such link."""

from pydantic import Field, field_validator

from companion.config_files import Section


class OperatorConfig(Section):
    """Where the broker is, and the vehicle's name on it."""

    host: str = Field("127.0.0.1", min_length=1, description="address of the computer that runs the MQTT broker")
    port: int = Field(1883, gt=0, le=65535, description="its TCP port")
    prefix: str = Field("dauam", description="first part of every topic")
    vehicle: str = Field("vehicle", description="second part of every topic; different for every vehicle")

    @field_validator("prefix", "vehicle")
    @classmethod
    def _plain(cls, value: str) -> str:
        if not (value.isascii() and value.replace("-", "").replace("_", "").isalnum() and len(value) <= 32):
            raise ValueError("must be 1 to 32 letters, digits, - or _, as a part of MQTT topics")
        return value

    def topic(self, last: str) -> str:
        """Of this vehicle."""
        return f"{self.prefix}/{self.vehicle}/{last}"
