"""Settings of the page's process."""

from pydantic import BaseModel, ConfigDict

from companion.config.operator_config import OperatorConfig

PORT = 8080
"""Default TCP port of the page."""


class PageSettings(BaseModel):
    """Broker, address and secrets of one page; its process gets them as JSON from the service or the demo."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    broker: OperatorConfig
    """Broker and prefix; its `vehicle` is not used."""
    vehicles: tuple[str, ...] = ()
    """Vehicles to show; empty: all that the broker knows."""
    host: str = "127.0.0.1"
    port: int = PORT
    password_file: str = ""
    """File written by `companion page-password`; empty: nobody logs in with a password."""
    tls_cert: str = ""
    tls_key: str = ""
    token: str = ""
    """One-time login for a browser on this computer; empty: none."""
