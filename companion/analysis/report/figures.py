"""Selection of the figures of a flight."""

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

from companion.analysis.report import control_figures, link_figures, motion_figures, separation
from companion.analysis.report.charts import Chart
from companion.analysis.report.recorded_flight import Flown
from companion.analysis.report.story import Story
from companion.analysis.report.timeline import height_in, timeline

Draw = Callable[[Figure, Flown], None]
_WHEN = (
    "Events of the flight. Below the curves: phases, laws if several flew, each fault from begin to end with its "
    "failsafe action, the actions taken (red), and commands."
)
_CAPTIONS = {
    "above": "Path from above.",
    "space": "Path in space.",
    "position": "Position; wide and pale: reference.",
    "errors": "Position minus reference for each axis, and its norm.",
    "command": "Command u of the law, held between its triggers.",
    "events": "Time since the previous trigger, at each trigger.",
    "gaps": "Times between triggers, on trajectories only where any was flown.",
    "latencies": "Latencies of the cycles in the air; dashed: median. The last bar holds all larger values.",
    "friction": "Disturbance as an acceleration: network output and disturbance observer.",
    "weights": "Weights of the network; black: Frobenius norm of the layer.",
    "signals": "Tracking errors y, filtered command χ and compensation ι of the law. Blue x, orange y, green z.",
    "horizon": "Slow part of motion capture's roll and pitch minus the autopilot's, and its correction.",
    "link": (
        "Link to the law on the ground: messages up and their losses, payload, age of each message at its arrival, and "
        "silence: the time since the ground has confirmed the command in use. Dashed: what follows from silence."
    ),
    "message_ages": "Ages of messages from the ground; dashed: median, dotted: 99 %.",
    "message_gaps": "Times between arrivals of messages from the ground; dashed: median, dotted: 99 %.",
    "others": (
        "Paths of all vehicles from above. Dashed: the cylinder around each other vehicle when it was nearest; dot: "
        "this vehicle then."
    ),
    "separation": (
        "Distances to the other vehicles; dashed: the cylinder, of which one of the two must be kept. Pale: not seen."
    ),
    "thrust": "Normalised thrust setpoint, and battery voltage.",
    "arms": "Joint positions; wide and pale: their goals.",
}


def charts_of(flown: Flown, story: Story) -> list[Chart]:
    """Return the charts that the record has data for; only the time line when nothing flew."""
    line_in = height_in(story)
    charts = [Chart("timeline", _WHEN, lambda figure: timeline(figure, flown, story), line_in)]
    if np.isfinite(flown.position_w_m[flown.airborne]).any():
        page_in, paper_in = (motion_figures.above_height_in(flown, width_in) for width_in in (4.7, 3.5))
        charts += [
            _chart(flown, motion_figures.above, page_in, paper_in, wide=False),
            _chart(flown, motion_figures.space, page_in, 2.6, wide=False),
            _chart(flown, motion_figures.position, 4.4, 3.6),
            _chart(flown, motion_figures.errors, 3.6, 3.0),
            *_charts_of_the_law(flown),
        ]
    if separation.has_others(flown):
        charts.append(_chart(flown, separation.others, 4.6, 3.4, wide=False))
        charts.append(_chart(flown, separation.separation, 3.6, 3.0))
    if link_figures.has_link(flown):
        charts.append(_chart(flown, link_figures.link, 6.0, 4.8))
        charts.append(_chart(flown, link_figures.message_ages, 2.6, 2.2, wide=False))
        charts.append(_chart(flown, link_figures.message_gaps, 2.6, 2.2, wide=False))
    if flown.record.frames and np.isfinite(flown.column("horizon_off_roll_rad")[flown.airborne]).any():
        charts.append(_chart(flown, control_figures.horizon, 3.0, 2.4))
    if flown.has("setpoint_thrust"):
        charts.append(_chart(flown, motion_figures.thrust, 3.0, 2.4))
    if flown.has("joint_position_rad"):
        charts.append(_chart(flown, motion_figures.arms, 3.8, 3.2))
    return charts


def _charts_of_the_law(flown: Flown) -> list[Chart]:
    charts = []
    if flown.has("accel_w_mps2"):
        charts.append(_chart(flown, motion_figures.command, 4.4, 3.4))
    latencies_in = 0.5 + 0.85 * len(flown.latencies_s())
    if flown.event[flown.airborne].sum() > 1:
        charts.append(_chart(flown, control_figures.events, 2.2, 1.8))
        charts.append(_chart(flown, control_figures.gaps, latencies_in, 2.2, wide=False))
    if flown.latencies_s():
        charts.append(_chart(flown, control_figures.latencies, latencies_in, latencies_in, wide=False))
    if flown.has("law_f_hat"):
        charts.append(_chart(flown, control_figures.friction, 4.4, 3.6))
    if flown.has("law_v0") or flown.has("law_v1"):
        charts.append(_chart(flown, control_figures.weights, 3.4, 2.8))
    if found := control_figures.signals_of(flown):
        charts.append(_chart(flown, control_figures.signals, 0.8 + 1.05 * len(found), 0.7 + 0.9 * len(found)))
    return charts


def _chart(flown: Flown, draw: Draw, page_in: float, paper_in: float, *, wide: bool = True) -> Chart:
    """Return the chart with the function's name and its heights, inches, on a page and in a paper."""
    name = draw.__name__
    return Chart(name, _CAPTIONS[name], lambda figure: draw(figure, flown), page_in, wide, paper_in)
