"""Checks of a session whose law is on the ground: what preflight, switches of the law and params say of it."""

import json

from tests.flights.served import Seen, Site


async def flies(seen: Seen, law: str) -> None:
    """Check that the vehicle hovers, and by which law on the ground."""
    state = await seen.newer()
    assert (state.phase, state.controller) == ("hold", f"{law} on the ground")
    assert state.law_link is not None
    assert state.law_link.connected


async def preflight_has_lines_for_the_link(site: Site) -> None:
    ran = await site.command("preflight", "--json")
    assert ran.code == 0, ran.said
    replies = [json.loads(line) for line in ran.out.splitlines()]
    [checks] = [reply["data"]["checks"] for reply in replies if reply["type"] == "reply" and reply["answer"] == "done"]
    of_link = {check["name"]: check["passed"] for check in checks}
    assert of_link["ground law"], checks
    assert of_link["commands' age"], checks


async def params_name_the_place_of_the_law(site: Site) -> None:
    ran = await site.command("params", "--json")
    assert ran.code == 0, ran.said
    replies = [json.loads(line) for line in ran.out.splitlines()]
    [data] = [reply["data"] for reply in replies if reply["type"] == "reply" and reply["answer"] == "done"]
    assert data["controller"]["name"] == "etnn on the ground"
    assert data["config"]["law"]["runs_on"] == "ground"
