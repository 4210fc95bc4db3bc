"""The law's own source as compiled code: what is written down by tracing it, and how it is called. Pure."""
