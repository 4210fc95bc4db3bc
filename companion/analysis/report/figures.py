"""Selection of the figures of a flight."""

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from companion.analysis.report import control_figures, motion_figures
from companion.analysis.report.charts import Chart
from companion.analysis.report.recorded_flight import Flown
from companion.analysis.report.story import Story
from companion.analysis.report.timeline import height_in, timeline

Draw = Callable[[Figure, Flown], None]


def charts_of(flown: Flown, story: Story) -> list[Chart]:
    """All that it has something to show for; only the time line when nothing flew."""

    def chart(
        name: str, caption: str, draw: Draw, height: float, wide: bool = True, paper: float | None = None
    ) -> Chart:
        return Chart(name, caption, partial(_draw, draw, flown), height, wide, paper)

    line_in = height_in(story)
    charts = [
        Chart("timeline", _TIMELINE, lambda figure: timeline(figure, flown, story), line_in, True, line_in),
    ]
    if np.isfinite(flown.position_w_m[flown.airborne]).any():
        charts += [
            chart(
                "above",
                _ABOVE if flown.tracked.any() else "The path from above.",
                motion_figures.above,
                *_above_in(flown),
            ),
            chart("space", "The path in space.", motion_figures.space, 3.9, False, 3.0),
            chart("position", "Position and reference.", motion_figures.position, 4.4, True, 3.6),
            chart("errors", "Position less reference per axis, and its size.", motion_figures.errors, 3.6, True, 3.0),
        ]
        charts += _of_the_law(flown, chart)
    if np.isfinite(flown.column("horizon_off_roll_rad")[flown.airborne]).any():
        charts.append(chart("horizon", _HORIZON, control_figures.horizon, 3.0, True, 2.4))
    if flown.has("setpoint_thrust"):
        charts.append(chart("thrust", _THRUST, motion_figures.thrust, 3.0, True, 2.4))
    if flown.has("joint_position_rad") and flown.has("joint_goal_rad"):
        charts.append(
            chart("arms", "The arms' joints; wide and pale: their goals.", motion_figures.arms, 3.8, True, 3.2)
        )
    if found := flown.latencies_s():
        height = 0.5 + 1.05 * len(found)
        charts.append(
            chart("latencies", "How long it took, in every cycle in the air.", control_figures.latencies, height, False)
        )
    return charts


def _of_the_law(flown: Flown, chart: Callable[..., Chart]) -> list[Chart]:
    charts = []
    if flown.has("accel_w_mps2"):
        charts.append(chart("command", _COMMAND, motion_figures.command, 4.4, True, 3.4))
    if flown.event[flown.airborne].sum() > 1:
        charts.append(
            chart("events", "Trigger instants, as high as the time since the one before.", control_figures.events, 2.2)
        )
        charts.append(chart("gaps", _GAPS, control_figures.gaps, 2.9, False, 2.2))
    if flown.has("law_f_hat"):
        charts.append(chart("friction", _FRICTION, control_figures.friction, 4.4, True, 3.6))
    if flown.has("law_v0") or flown.has("law_v1"):
        charts.append(
            chart("weights", "The network's weights; black: the size of each layer.", control_figures.weights, 3.4)
        )
    if found := control_figures.signals_of(flown):
        charts.append(
            chart("signals", _SIGNALS, control_figures.signals, 0.8 + 1.05 * len(found), True, 0.7 + 0.95 * len(found))
        )
    return charts


def _above_in(flown: Flown) -> tuple[float, bool, float]:
    """Its height on a page, that it takes half of it, and its height in a paper."""
    return (
        motion_figures.above_height_in(flown, 4.7, 2.4, 4.4),
        False,
        motion_figures.above_height_in(flown, 3.5, 1.8, 3.6),
    )


def _draw(draw: Draw, flown: Flown, figure: Figure) -> None:
    draw(figure, flown)


_TIMELINE = (
    "What happened when. Below the curves: phases, laws where one followed another, each fault from its begin to its "
    "end with the reaction that the table gives it, what was done (red), and commands."
)
_ABOVE = "The path from above; pale: what was no trajectory."
_COMMAND = "Command u, held between the law's triggers."
_GAPS = "Times between triggers, within the trajectories where some were flown."
_FRICTION = "What the network says of the friction, as an acceleration, and what the observer sees of pushes."
_SIGNALS = "Tracking errors y, filtered command χ and compensation ι of the law. Blue x, orange y, green z."
_HORIZON = "The slow part of motion capture's roll and pitch less the autopilot's, and what of it was corrected."
_THRUST = "Normalised thrust that was asked for, and the battery's voltage."
