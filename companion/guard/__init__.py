"""Last stage before the autopilot: limits, geofence, rate limits; independent of law and supervisor. Pure."""
