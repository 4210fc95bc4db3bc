"""The sentences with which ground and vehicle do not connect."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config.arms_config import ArmsConfig
from companion.config.companion_config import CompanionConfig, agreed_of
from companion.config.flight_config import VehicleConfig
from companion.law_link.agreement import Introduction, Refusal, difference, introduction_of, refusal_of
from companion.law_link.messages import BadMessageError

ME = Introduction(
    version="0.6.0", law="etnn", host="here", agreed={"vehicle.mass_kg": 4.85, "control.rate_hz": 100.0, "arms": None}
)


def test_the_same_values_agree_whatever_the_law_and_the_computer() -> None:
    assert difference(ME, replace(ME, law="pid", host="there", agreed=dict(reversed(list(ME.agreed.items()))))) == ""


def test_another_version_names_both_and_what_to_do() -> None:
    assert difference(ME, replace(ME, version="0.5.9")) == (
        "the vehicle runs companion 0.6.0 (link protocol 1), the ground 0.5.9 (1): install the same version on both"
    )


def test_another_protocol_of_one_version_is_named() -> None:
    assert "(link protocol 1), the ground 0.6.0 (2)" in difference(ME, replace(ME, protocol=2))


@pytest.mark.parametrize(
    ("agreed", "sentence"),
    [
        (
            {**ME.agreed, "vehicle.mass_kg": 4.9},
            "vehicle.mass_kg is 4.85 on the vehicle and 4.9 on the ground: give both the same configuration",
        ),
        (
            {key: value for key, value in ME.agreed.items() if key != "control.rate_hz"},
            "control.rate_hz is 100.0 on the vehicle and not there on the ground: give both the same configuration",
        ),
        (
            {**ME.agreed, "limits.new": True},
            "limits.new is not there on the vehicle and true on the ground: give both the same configuration",
        ),
    ],
)
def test_a_value_that_differs_is_named_with_both_values(agreed: dict[str, float | None], sentence: str) -> None:
    assert difference(ME, replace(ME, agreed=agreed)) == sentence


def test_of_many_differences_three_are_named() -> None:
    many = {f"vehicle.k{index}": 1.0 for index in range(6)}
    said = difference(replace(ME, agreed=many), replace(ME, agreed=dict.fromkeys(many, 2.0)))
    assert said.count(" on the vehicle and ") == 3
    assert said.endswith(", and 3 more: give both the same configuration")


@given(
    st.dictionaries(
        st.text(min_size=1, max_size=20),
        st.none() | st.booleans() | st.integers(-100, 100) | st.floats(-1e6, 1e6) | st.text(max_size=20),
        max_size=20,
    )
)
def test_an_introduction_comes_back_as_it_was(agreed: dict[str, str | float | int | bool | None]) -> None:
    who = replace(ME, agreed=agreed)
    assert introduction_of(who.text()) == who
    assert difference(ME, replace(ME, agreed=dict(ME.agreed))) == ""


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"version": 1}', "null", '{"protocol": "x", "version": "1"}', "1e999"]
)
def test_what_is_no_introduction_or_refusal_is_refused(text: str) -> None:
    with pytest.raises(BadMessageError):
        introduction_of(text)
    with pytest.raises(BadMessageError):
        refusal_of(text)


@given(st.text(max_size=100), st.booleans())
def test_a_refusal_comes_back_as_it_was(reason: str, passes: bool) -> None:
    assert refusal_of(Refusal(reason, passes).text()) == Refusal(reason, passes)


@pytest.mark.parametrize(
    "changed",
    [
        {"vehicle": VehicleConfig(mass_kg=5.0)},
        {"vehicle": VehicleConfig(hover_thrust=0.45)},
        {"arms": ArmsConfig(stands_at_m=0.6)},
        {"arms": None},
    ],
)
def test_all_that_the_law_computes_with_must_agree(changed: dict[str, object]) -> None:
    config = CompanionConfig(arms=ArmsConfig())
    here, there = (replace(ME, agreed=agreed_of(one)) for one in (config, config.model_copy(update=changed)))
    assert difference(here, there).endswith("give both the same configuration")
