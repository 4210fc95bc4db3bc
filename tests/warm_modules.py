"""Imported once by the process that others are forked from (warm.py): all that a program of the project may want."""

import gc
import importlib
import pkgutil

import amqtt.broker  # type: ignore[import-untyped]  # noqa: F401

import companion
import mock_autopilot

for package in (companion, mock_autopilot):
    for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        if not found.name.endswith("__main__"):
            importlib.import_module(found.name)

gc.collect()
gc.freeze()  # else every child looks through all of it again and again, which is a stall of a tenth of a second each
