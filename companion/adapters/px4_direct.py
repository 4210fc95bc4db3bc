"""Until its importers name companion.adapters.px4."""

from companion.adapters.px4 import flight_mode

__all__ = ["flight_mode"]
