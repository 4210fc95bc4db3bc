"""The [records] table: where flights are kept, for how long, and where they can be watched."""

from pydantic import Field

from companion.config.toml_files import Section


class RecordsConfig(Section):
    """One MCAP file a flight; the oldest go when there are too many."""

    folder: str = Field("flights", min_length=1, description="where records go; made when it is not there")
    keep_mb: float = Field(
        20_000.0, gt=0.0, le=1e8, description="largest size of all records together; the oldest flights go first, MB"
    )
    keep_days: float = Field(
        365.0, gt=0.0, le=1e5, description="age at which records are deleted, but never the ten newest, days"
    )
    min_free_mb: float = Field(
        200.0, ge=0.0, le=1e7, description="least free space on the disk; with less nothing is written, MB"
    )
    live_port: int = Field(8765, ge=0, le=65535, description="TCP port of Foxglove's WebSocket; 0: off")
    live_host: str = Field(
        "127.0.0.1",
        min_length=1,
        description="address that Foxglove's WebSocket listens on; 0.0.0.0 lets the net watch",
    )
