"""Settings of the page's process."""

from pydantic import BaseModel, ConfigDict

from companion.config.operator_config import OperatorConfig, PageConfig


class PageSettings(BaseModel):
    """Broker, address and secrets of one page; its process gets them as JSON from the service or the demo."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    broker: OperatorConfig
    """Broker and prefix; its `vehicle` is not used."""
    page: PageConfig = PageConfig()
    vehicles: tuple[str, ...] = ()
    """Vehicles to show; empty: all that the broker knows."""
    token: str = ""
    """One-time login for a browser on this computer; empty: none."""
    quiet: bool = False
    """Only errors are logged."""
