"""The recorded facts by section; each module has a tuple FACTS."""
