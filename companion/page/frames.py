"""Messages from the server to the page, as JSON text."""

import json
import math
from typing import Any

from companion.protocol.telemetry import Happened, Presence, Reply, State


def hello(vehicles: tuple[str, ...], can_command: bool, password: bool, version: str, time_s: float) -> str:
    """Return the first message; `password`: whether logging in is possible."""
    head = {"type": "hello", "vehicles": vehicles, "can_command": can_command, "password": password}
    return json.dumps(head | {"version": version, "time_s": time_s})


def beat(time_s: float) -> str:
    """Return the sign of life."""
    return json.dumps({"type": "beat", "time_s": time_s})


def broker(linked: bool, why: str) -> str:
    """Return whether the broker is connected, and why not."""
    return json.dumps({"type": "broker", "linked": linked, "why": why})


def about(vehicle: str, json_text: str) -> str:
    """Return a vehicle's description from its JSON; `null` for none."""
    return f'{{"type":"about","vehicle":{json.dumps(vehicle)},"about":{json_text}}}'


def presence(vehicle: str, said: Presence) -> str:
    """Return a presence of the service."""
    return f'{{"type":"presence","vehicle":{json.dumps(vehicle)},"presence":{said.model_dump_json()}}}'


def state(vehicle: str, said: State, age_s: float, arms_b_m: dict[str, Any] | None) -> str:
    """Return a state; `age_s` is its age now, `arms_b_m` the arms' points in body FLU, m."""
    age = f"{age_s:.3f}" if math.isfinite(age_s) else "null"
    head = f'{{"type":"state","vehicle":{json.dumps(vehicle)},"age_s":{age},"arms_b_m":{json.dumps(arms_b_m)}'
    return f'{head},"state":{said.model_dump_json()}}}'


def event(vehicle: str, said: Happened, old: bool = False) -> str:
    """Return an event; `old`: it happened before the page was opened."""
    again = ',"old":true' if old else ""
    return f'{{"type":"event","vehicle":{json.dumps(vehicle)}{again},"event":{said.model_dump_json()}}}'


def reply(vehicle: str, ref: int, verb: str, said: Reply) -> str:
    """Return a reply to one of the page's own commands."""
    head = {"type": "reply", "vehicle": vehicle, "ref": ref, "verb": verb}
    return json.dumps(head | {"answer": said.answer, "text": said.text, "data": said.data})


def error(ref: int | None, text: str) -> str:
    """Return why a message of the page is not accepted."""
    return json.dumps({"type": "error", "ref": ref, "text": text})


def confirm(vehicle: str, ref: int, nonce: str, after_s: float, until_s: float) -> str:
    """Return the question that a kill is answered with first."""
    head = {"type": "confirm", "ref": ref, "vehicle": vehicle, "nonce": nonce}
    return json.dumps(head | {"after_s": after_s, "until_s": until_s})
