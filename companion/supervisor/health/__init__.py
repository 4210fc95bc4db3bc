"""Health checks: each module checks one kind of input and reports faults. Pure."""
