"""Commands on recorded flights: records, report, replay, calibrate."""
