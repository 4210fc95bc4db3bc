"""Until its importers name companion.adapters.px4."""

from companion.adapters.px4 import LocalEstimate

__all__ = ["LocalEstimate"]
