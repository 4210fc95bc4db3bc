"""Speed of the things whose speed matters; run as `python -m benchmarks`."""
