"""Qualisys Track Manager as a MocapSource, over its real-time protocol (qtm-rt)."""

from companion.adapters.qualisys.connect import open_qualisys
from companion.adapters.qualisys.source import MocapCounts, QualisysSource

__all__ = ["MocapCounts", "QualisysSource", "open_qualisys"]
