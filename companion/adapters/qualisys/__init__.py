"""Qualisys Track Manager as a MocapSource, over its real-time protocol (qtm-rt)."""

from companion.adapters.qualisys.connect import open_qualisys
from companion.adapters.qualisys.source import QualisysSource

__all__ = ["QualisysSource", "open_qualisys"]
