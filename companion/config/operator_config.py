"""The [operator] table: the MQTT broker over which commands come, the service's own without it. And [page]."""

import ipaddress
import stat
from pathlib import Path
from typing import ClassVar

from pydantic import Field, ValidationInfo, field_validator, model_validator

from companion.config.text_files import decode
from companion.config.toml_files import Section
from companion.core.errors import ConfigError
from companion.protocol.topics import ALL, Topics

_MOST_PASSWORD_BYTES = 1024


class OperatorConfig(Section):
    """Address of the broker, the service's login there, and the vehicle's name on it."""

    table: ClassVar[str] = "operator"
    """Name of its table in the file."""
    host: str = Field("127.0.0.1", min_length=1, description="address of the computer that runs the MQTT broker")
    port: int = Field(1883, gt=0, le=65535, description="TCP port of the broker")
    prefix: str = Field("dauam", description="first part of every topic")
    vehicle: str = Field("vehicle", description="the vehicle's part of every topic; different for every vehicle")
    embedded: bool = Field(False, description="the service starts its own broker, for this computer alone")
    user: str | None = Field(
        None, min_length=1, max_length=64, description="user by which the broker knows the service"
    )
    password_file: str | None = Field(None, min_length=1, description="file with the user's password; chmod 600")
    tls: bool = Field(False, description="encrypt, and check the broker's certificate; the usual port is then 8883")
    ca_file: str | None = Field(
        None, min_length=1, description="PEM file of who signed the broker's certificate; the system's if left out"
    )

    @field_validator("prefix", "vehicle")
    @classmethod
    def _plain(cls, value: str, info: ValidationInfo) -> str:
        if info.field_name == "vehicle" and value == ALL:
            raise ValueError("means every vehicle that is online, and is no vehicle's name")
        if not (value.isascii() and value.replace("-", "").replace("_", "").isalnum() and len(value) <= 32):
            raise ValueError("must be 1 to 32 letters, digits, - or _, as a part of MQTT topics")
        return value

    @field_validator("password_file", "ca_file")
    @classmethod
    def _usable(cls, value: str | None, info: ValidationInfo) -> str | None:
        if value is not None and info.field_name == "password_file":
            usable_secret(value)
        elif value is not None:
            _mode_of(value)
        return value

    @model_validator(mode="after")
    def _together(self) -> "OperatorConfig":
        if self.password_file is not None and self.user is None:
            raise ValueError("password_file is the password of a user: give user as well")
        if self.ca_file is not None and not self.tls:
            raise ValueError("ca_file says whose certificates count: give tls = true as well")
        if self.embedded and (self.user is not None or self.tls):
            raise ValueError("embedded is a broker for this computer alone: it takes neither user nor tls")
        if self.embedded and not _is_loopback(self.host):
            raise ValueError(f"embedded is a broker for this computer alone: host must be 127.0.0.1, not {self.host!r}")
        return self

    @property
    def topics(self) -> Topics:
        """Return this vehicle's topics."""
        return Topics(self.prefix, self.vehicle)

    def password(self) -> str | None:
        """Return the line in `password_file`, None without one; ConfigError if it is unreadable or not one line."""
        if self.password_file is None:
            return None
        where = f"{self.table}.password_file = {self.password_file!r}"
        return secret_in(self.password_file, where, _MOST_PASSWORD_BYTES, "the password")


class PageConfig(Section):
    """The live page, for `companion page` and `companion serve --page`; its files are read by its own process."""

    host: str = Field("127.0.0.1", min_length=1, description='address to serve on; "0.0.0.0": for the whole network')
    port: int = Field(8080, ge=0, le=65535, description="TCP port; 0: a free one")
    password_file: str | None = Field(
        None, min_length=1, description="file that `companion page-password` wrote; without one the page only looks"
    )
    tls_cert: str | None = Field(None, min_length=1, description="PEM file of the certificate, to serve encrypted")
    tls_key: str | None = Field(None, min_length=1, description="PEM file of the certificate's key")

    @model_validator(mode="after")
    def _together(self) -> "PageConfig":
        if (self.tls_cert is None) != (self.tls_key is None):
            raise ValueError("tls_cert and tls_key belong together: give both")
        return self


def usable_secret(name: str) -> None:
    """Raise ValueError unless this is a file that not every user of this computer may read or write."""
    if _mode_of(name) & stat.S_IRWXO:
        raise ValueError(f"every user of this computer may read or write it: chmod 600 {name}")


def secret_in(name: str, where: str, most_bytes: int, what: str) -> str:
    """Return the one line of a file with a secret; ConfigError that begins with `where` if it is not one line."""
    try:
        with Path(name).open("rb") as file:
            said = decode(file.read(most_bytes + 1)).rstrip("\r\n")
    except OSError as error:
        raise ConfigError(f"{where}: cannot be read: {error}") from error
    except ValueError:
        raise ConfigError(f"{where}: must be text in UTF-8") from None  # whose bytes are nobody's to read
    if not said or len(said) > most_bytes or "\n" in said:
        raise ConfigError(f"{where}: must hold one line, {what}")
    return said


def _mode_of(name: str) -> int:
    try:
        mode = Path(name).stat().st_mode
    except (OSError, ValueError) as error:
        raise ValueError("there is no such file that could be read") from error
    if not stat.S_ISREG(mode):
        raise ValueError("is no file")
    return mode


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
