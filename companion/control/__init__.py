"""Control laws, predictor and observer, and the pipeline from law to setpoint. Pure: no I/O, no clock."""
