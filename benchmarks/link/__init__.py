"""The law's link measured before it is chosen: transports over an impaired IP link, `python -m benchmarks.link`."""
