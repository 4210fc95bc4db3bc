"""The operator's side of the protocol: find the service, follow it, command it."""
