"""PX4's behaviour: commander, estimator, flight modes, land detector. Pure."""
