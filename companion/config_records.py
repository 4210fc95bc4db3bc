"""The [records] table: where flights are kept, for how long, and where they can be watched."""

from pydantic import Field

from companion.config_files import Section


class RecordsConfig(Section):
    """One MCAP file a flight; the oldest go when there are too many."""

    folder: str = Field("flights", min_length=1, description="where records go; made when it is not there")
    keep_mb: float = Field(20_000.0, gt=0.0, le=1e8, description="all records together; oldest flights go first, MB")
    keep_days: float = Field(365.0, gt=0.0, le=1e5, description="older flights go, days")
    min_free_mb: float = Field(200.0, ge=0.0, le=1e7, description="less free space on the disk: nothing is written, MB")
    live_port: int = Field(8765, ge=0, le=65535, description="Foxglove's WebSocket; 0 = off")
    live_host: str = Field("127.0.0.1", min_length=1, description="address it listens on; 0.0.0.0 lets the net watch")
