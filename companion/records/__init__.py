"""Records of flights: a tick as a row, one MCAP file a flight, written by a process of its own, and read back."""
