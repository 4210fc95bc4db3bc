"""One control cycle: read, estimate, supervise, control, send. Interfaces only, no device."""
