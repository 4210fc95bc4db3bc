"""Motion capture from any source: newest frame, choice of the source."""
