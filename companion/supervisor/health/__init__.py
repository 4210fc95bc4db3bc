"""Health checks: each looks at one kind of input and reports faults. Pure."""
