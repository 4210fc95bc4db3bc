"""Memory of the checks."""

import math

from companion.supervisor.health.memory import NOT_HELD, Window, held_since


def test_since_keeps_the_first_time_and_forgets_it() -> None:
    assert held_since(NOT_HELD, True, 5.0) == 5.0
    assert held_since(5.0, True, 6.0) == 5.0
    assert held_since(5.0, False, 6.0) == NOT_HELD == math.inf


def test_a_clock_that_went_back_begins_anew() -> None:
    assert held_since(5.0, True, 4.0) == 4.0


def test_a_window_forgets_what_came_at_its_edge() -> None:
    window = Window().added(1.0, 10.0).added(2.0, 20.0).added(3.0, 30.0)
    assert window.total == 60.0
    assert window.kept(0.5) is window
    assert window.kept(1.0) == Window((2.0, 3.0), (20.0, 30.0))
    assert window.kept(2.5) == Window((3.0,), (30.0,))
    assert window.kept(3.0) == Window()
    assert Window().kept(9.0).total == 0.0
