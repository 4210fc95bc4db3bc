"""The description that a service publishes of its vehicle."""

import json

import pytest

from companion.config.arms_config import ArmsConfig
from companion.config.companion_config import load_config
from companion.config.controller_config import controller_path
from companion.config.locations import default_config_path
from companion.protocol.about import About
from companion.service.about import about_of

SESSION = "0123456789abcdef"
DEMO = load_config(default_config_path("demo.toml"))


def test_it_says_what_a_page_draws_and_offers() -> None:
    about = about_of(DEMO, SESSION)
    assert (about.session, about.body, about.curves) == (SESSION, DEMO.mocap.body, ("ellipse", "figure8"))
    assert (about.fence.x_m, about.room.z_m) == (DEMO.fence.x_m, DEMO.room.z_m)
    assert "swing" in about.motions
    assert all(controller_path(name).is_file() for name in about.controllers)
    assert about.footprint_m == pytest.approx(0.5)
    assert About.model_validate_json(about.model_dump_json()) == about, "it can be sent"


def test_its_arms_are_the_configured_ones_again() -> None:
    arms = About.model_validate_json(about_of(DEMO, SESSION).model_dump_json()).arms
    assert DEMO.arms is not None
    assert ArmsConfig.model_validate_json(json.dumps(arms)) == DEMO.arms


def test_without_arms_it_offers_no_motions() -> None:
    about = about_of(DEMO.model_copy(update={"arms": None}), SESSION)
    assert (about.arms, about.motions) == (None, ())


def test_it_fits_into_one_packet() -> None:
    assert len(about_of(DEMO, SESSION).model_dump_json()) < 16_000


def test_it_tells_in_which_order_the_vehicles_of_the_room_yield() -> None:
    separation = DEMO.separation.model_copy(update={"order": ("two", "dauam")})
    assert about_of(DEMO.model_copy(update={"separation": separation}), SESSION).separation_order == ("two", "dauam")
    assert about_of(DEMO, SESSION).separation_order == ()
