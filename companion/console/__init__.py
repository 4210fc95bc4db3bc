"""The operator's end of the bus, on any machine: finds the service, follows it, commands it."""
