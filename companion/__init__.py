"""Companion computer of a dual-arm aerial manipulator: the paper's controller in the air, over real protocols."""

__version__ = "0.1.0"
