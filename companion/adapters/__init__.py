"""One device per file: each imports ports, types and its own SDK, and raises our few exceptions."""
