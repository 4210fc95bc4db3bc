"""Commands on the vehicle's computer: serve, preflight, dry-run, mocap."""
