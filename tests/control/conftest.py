"""Property tests here are judged by their values, not by how long a shared machine takes over one of them."""

from hypothesis import settings

settings.register_profile("no deadline", deadline=None)
settings.load_profile("no deadline")
