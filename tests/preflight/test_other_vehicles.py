"""Preflight checks of the other vehicles of the room, as motion capture sees them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.config.companion_config import CompanionConfig
from companion.config.preflight_config import PreflightConfig
from companion.config.separation_config import SeparationConfig
from companion.core.types import Array, OtherBody, OtherVehicle, Vec3
from companion.guard.separation import Separation
from companion.preflight.checks.all_checks import check_all
from companion.preflight.checks.check import Check
from companion.preflight.checks.other_vehicles import (
    OtherVehicleFacts,
    check_other_vehicles,
    check_seen_as_parked,
)
from tests.preflight.facts import RECOMMENDED, ready

HERE = np.array([0.0, 0.0, 0.1])
CLEAR = Separation(radius_m=1.5)
NAMES = ("dauam-2", "dauam-3")
NOWHERE: Vec3 = (math.nan, math.nan, math.nan)


def vehicle(body: str, place: Vec3, unseen_s: float = 0.0) -> OtherVehicle:
    return OtherVehicle(body=body, position_w_m=place, velocity_w_mps=(0.0, 0.0, 0.0), unseen_s=unseen_s)


def facts(*vehicles: OtherVehicle, why: str = "") -> OtherVehicleFacts:
    bodies = tuple(OtherBody(one.body, one.position_w_m, why if one.body == "dauam-3" else "") for one in vehicles)
    return OtherVehicleFacts(bodies, vehicles)


def checked(seen: OtherVehicleFacts, place: Array | None = HERE) -> dict[str, Check]:
    return {check.name: check for check in check_other_vehicles(seen, NAMES, place, CLEAR)}


@pytest.mark.parametrize(("y_m", "passed"), [(1.49, False), (1.51, True), (-1.49, False), (-1.51, True)])
def test_two_vehicles_do_not_stand_inside_each_others_margin(y_m: float, passed: bool) -> None:
    checks = checked(facts(vehicle("dauam-2", (0.0, y_m, 0.1)), vehicle("dauam-3", (3.0, 0.0, 2.0))))
    assert [check.passed for check in checks.values()] == [True, passed]
    distance = checks["distance to other vehicles"]
    assert distance.says == f"{abs(y_m):.2f} m to 'dauam-2', at least 1.50 m wanted"
    assert distance.refuses is not passed


def test_a_body_that_qtm_does_not_have_prevents_arming() -> None:
    why = "QTM at here:1 does not know the body 'dauam-3'; it has: dauam-1, dauam-2"
    checks = checked(facts(vehicle("dauam-2", (0.0, 2.0, 0.1)), vehicle("dauam-3", NOWHERE, math.inf), why=why))
    assert [(check.name, check.says, check.refuses) for check in checks.values()] == [
        ("other bodies defined", why, True)
    ]
    assert checked(OtherVehicleFacts())["other bodies defined"].says == "no frame has come"


@pytest.mark.parametrize("unseen_s", [0.6, 100.0, math.inf])
def test_a_body_that_is_not_seen_is_a_warning_as_it_may_be_elsewhere(unseen_s: float) -> None:
    checks = checked(facts(vehicle("dauam-2", (0.0, 0.5, 0.1), unseen_s), vehicle("dauam-3", (3.0, 0.0, 0.1))))
    seen = checks["other bodies seen"]
    assert (seen.passed, seen.refuses, seen.says) == (False, False, "not seen: dauam-2")
    assert checks["distance to other vehicles"].says.startswith("3.00 m to 'dauam-3'")


def test_without_any_in_sight_or_a_pose_of_its_own() -> None:
    away = facts(vehicle("dauam-2", NOWHERE, math.inf), vehicle("dauam-3", NOWHERE, math.inf))
    assert checked(away)["distance to other vehicles"].passed
    assert checked(away, None)["distance to other vehicles"].refuses


def test_the_whole_list_has_them_only_where_there_are_others() -> None:
    beside = facts(vehicle("two", (0.3, 0.7, 0.1)))
    wanted = PreflightConfig()

    def names(order: tuple[str, ...]) -> list[str]:
        config = CompanionConfig(separation=SeparationConfig(order=order))
        checks = check_all(replace(ready(), vehicles=beside), config, wanted, RECOMMENDED)
        return [check.name for check in checks if not check.passed]

    assert names(()) == []
    assert names(("two", "dauam")) == ["distance to other vehicles"]


@pytest.mark.parametrize(("height_m", "passed"), [(0.34, True), (0.36, False), (math.nan, False)])
def test_one_that_stands_must_look_parked_to_the_others(height_m: float, passed: bool) -> None:
    check = check_seen_as_parked(np.array([0.0, 0.0, height_m]), 0.35)
    assert check.refuses is not passed
    assert check.says.endswith("below 0.35 m wanted")
    assert check_seen_as_parked(None, 0.35).refuses
