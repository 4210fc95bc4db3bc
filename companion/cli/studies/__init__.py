"""Commands in virtual time: simulate, experiments, sweep, tune."""
