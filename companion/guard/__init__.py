"""Last gate before the autopilot: limits, geofence, rate limits. Knows no law and no supervisor. Pure."""
