"""Time line of a flight: height and error, and below them phases, faults, failsafe actions and commands."""

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from companion.analysis.report.charts import (
    COLOURS,
    GREY,
    PHASE_SHADES,
    RED,
    free_only,
    phase_patches,
    rows_over_time,
    shades_of,
    thinned,
)
from companion.analysis.report.motion_figures import GOAL
from companion.analysis.report.recorded_flight import Flown
from companion.analysis.report.story import FaultSeen, Story

_LANE_IN = 0.2
_CURVES_IN = 2.5
_MOST_FAULTS = 24
_SAME_S = 0.05
"""Least duration with which a fault is drawn."""
_NOT_DONE = (" refused", " failed")


@dataclass(frozen=True)
class _Lane:
    """Occurrences of one fault."""

    name: str
    times: list[FaultSeen]


def height_in(story: Story) -> float:
    """Return the height that `timeline` needs, inches."""
    return _CURVES_IN + 0.55 + _LANE_IN * _rows(story)


def _rows(story: Story) -> int:
    """Return the rows of the lowest part: phases, laws if several, faults, failsafe actions, commands."""
    return 1 + _switched(story) + len(_lanes(story)) + bool(story.reactions) + 3 * bool(_commands_of(story))


def _switched(story: Story) -> bool:
    return len(story.laws) > 1


def timeline(figure: Figure, flown: Flown, story: Story) -> None:
    """Draw height, error and the events of a flight over time."""
    lanes = _lanes(story)
    commands = _commands_of(story)
    below = _rows(story)
    height, error, line = rows_over_time(figure, ["height (m)", "error (cm)", ""], flown)
    grid = height.get_gridspec()
    assert grid is not None
    grid.set_height_ratios([_CURVES_IN / 2, _CURVES_IN / 2, _LANE_IN * below])
    _curves(height, error, flown)
    line.grid(visible=False)
    line.set(ylim=(below, 0), yticks=[])
    named = _phases(line, flown)
    unnamed = {name: colour for name, colour in shades_of(flown).items() if name not in named}
    if unnamed:
        figure.legend(handles=phase_patches(unnamed), loc="outside upper right", ncols=len(unnamed))
    at = 1
    if _switched(story):
        _laws(line, story, at + 0.5)
        at += 1
    for lane in lanes:
        _fault(line, lane, at + 0.5, flown)
        at += 1
    if story.reactions:
        _reactions((height, error, line), story, at + 0.5)
        at += 1
    if commands:
        _commands(line, commands, at)


def _lanes(story: Story) -> list[_Lane]:
    lanes: dict[str, _Lane] = {}
    for seen in story.faults:
        lanes.setdefault(seen.fault, _Lane(seen.fault, [])).times.append(seen)
    return list(lanes.values())[:_MOST_FAULTS]


def _commands_of(story: Story) -> list[tuple[float, str]]:
    """Return times and texts of commands, and of replies to commands that were not carried out."""
    bad = [said for said in story.said if said.kind == "reply" and said.text.partition(":")[0].endswith(_NOT_DONE)]
    return sorted((said.at_s, said.text) for said in [*(s for s in story.said if s.kind == "command"), *bad])


def _curves(height: Axes, error: Axes, flown: Flown) -> None:
    time, where, reference = thinned(flown.time_s, flown.position_w_m[:, 2], flown.reference_w_m[:, 2])
    height.plot(time, reference, **GOAL)
    height.plot(time, where, color=COLOURS[2])
    time, size = thinned(flown.time_s, 100.0 * free_only(flown, flown.distance_m))
    error.plot(time, size, color="0.25")
    error.set_ylim(0.0, None)


def _letter_s(axes: Axes) -> float:
    """Return the time that one letter spans on the axis, s: more in a paper's column than on a page."""
    low, high = axes.get_xlim()
    wide_in = axes.get_window_extent().width / axes.figure.dpi
    return 0.65 * (high - low) * float(rcParams["font.size"]) / (72.0 * float(wide_in))


def _inside(axes: Axes, at_s: float) -> float:
    low, high = axes.get_xlim()
    return min(max(at_s, low), high)


def _phases(axes: Axes, flown: Flown) -> set[str]:
    """Write the phases' names where they fit; return those written."""
    named = set()
    for stretch in flown.phases:
        begin, end = _inside(axes, stretch.begin_s), _inside(axes, stretch.end_s)
        if stretch.name in PHASE_SHADES and end - begin > _letter_s(axes) * len(stretch.name):
            axes.text(0.5 * (begin + end), 0.5, stretch.name, ha="center", va="center", color="0.3")
            named.add(stretch.name)
    return named


def _laws(axes: Axes, story: Story, at: float) -> None:
    low, high = axes.get_xlim()
    for number, law in enumerate(story.laws):
        axes.plot(
            [law.begin_s, law.end_s], [at, at], color=COLOURS[number % 2], lw=5.0, alpha=0.25, solid_capstyle="butt"
        )
        if law.end_s - law.begin_s > 0.012 * (high - low) * len(law.name):
            axes.text(0.5 * (law.begin_s + law.end_s), at, law.name, ha="center", va="center", color="0.2")


def _fault(axes: Axes, lane: _Lane, at: float, flown: Flown) -> None:
    low, high = axes.get_xlim()
    least = max(0.003 * (high - low), _SAME_S)
    last_s = float(flown.time_s[-1])
    bars = [
        (seen.begin_s, max((last_s if seen.end_s is None else seen.end_s) - seen.begin_s, least)) for seen in lane.times
    ]
    axes.broken_barh(bars, (at - 0.3, 0.6), color=COLOURS[1], lw=0)
    reactions = ", ".join(dict.fromkeys(seen.reaction for seen in lane.times))
    text = f"{lane.name} → {reactions}"
    begin, end = _inside(axes, bars[0][0]), _inside(axes, bars[-1][0] + bars[-1][1])
    room, length_s = 0.008 * (high - low), _letter_s(axes) * len(text)
    if high - end > room + length_s:
        axes.text(end + room, at, text, ha="left", va="center", clip_on=True)
    elif begin - low > room + length_s:
        axes.text(begin - room, at, text, ha="right", va="center", clip_on=True)
    else:  # no space beside its bar: draw over it rather than outside of the axes
        axes.text(low + room, at, text, ha="left", va="center", clip_on=True)


def _reactions(rows: Sequence[Axes], story: Story, at: float) -> None:
    line = rows[-1]
    low, high = line.get_xlim()
    for reacted in story.reactions:
        at_s = _inside(line, reacted.at_s)
        for axes in rows:
            axes.axvline(at_s, color=RED, lw=0.9, ls=":")
        left = at_s > low + 0.6 * (high - low)
        line.text(
            at_s + (-0.006 if left else 0.006) * (high - low), at, reacted.reaction, ha="right" if left else "left",
            va="center", color=RED, fontweight="bold",
        )  # fmt: skip


def _commands(axes: Axes, commands: Sequence[tuple[float, str]], at: int) -> None:
    """Write commands in three rows, so that neighbours do not overlap; without space only the verb, or a mark."""
    low, high = axes.get_xlim()
    gap = 0.006 * (high - low)
    free = [low] * 3
    for at_s, text in commands:
        x = _inside(axes, at_s)
        axes.plot([x], [at + 0.12], marker="v", color=GREY, ms=3.5, clip_on=False)
        for short in (text if len(text) <= 40 else text[:39] + "…", text.split()[0]):
            length = _letter_s(axes) * len(short) + gap
            left = x + length > high
            begin = x - length if left else x
            row = next((number for number in range(3) if free[number] <= begin), None)
            if row is None:
                continue
            place, side = (x - gap, "right") if left else (x + gap, "left")
            axes.text(place, at + 0.5 + row, short, ha=side, va="center", color="0.25", fontsize="small")
            free[row] = begin + length
            break
