"""A campaign as one page that needs nothing but itself: HTML with its figures inside."""

import platform
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import matplotlib as mpl
import numpy as np

from companion import __version__
from companion.analysis.report.html import facts, picture, tables, whole
from companion.analysis.report.tables import Grid
from companion.studies.paper.campaign import Flown
from companion.studies.paper.campaign_plots import Drawn
from companion.studies.paper.campaign_table import ablation_grid, comparison, events
from companion.studies.paper.descriptions import Facts


@dataclass(frozen=True)
class Chapter:
    """One experiment."""

    title: str
    facts: Facts
    flights: Sequence[Flown]
    """Whole laws, the baseline first."""
    variants: Sequence[Flown]
    closer: Sequence[Grid]
    """Tables of the single flight of the first seed: the network, the proof."""
    drawn: Sequence[Drawn]


@dataclass(frozen=True)
class Source:
    """A file that the campaign was flown from, as it was."""

    path: Path
    text: str


def page(chapters: Sequence[Chapter], sources: Sequence[Source], command: str) -> str:
    """The whole report; everything that is not ours is escaped."""
    body = "\n".join(_chapter(chapter) for chapter in chapters)
    return whole(_TITLE, f"<p>{_INTRODUCTION}</p>\n{body}\n{_repeat(sources, command)}")


_TITLE = "Event-triggered neural control of a dual-arm multirotor: the paper's experiments in simulation"

_INTRODUCTION = (
    "Two experiments of Wang et al., <i>Neural Network-Based Adaptive Event-Triggered Control for Dual-Arm Unmanned "
    "Aerial Manipulator Systems</i>, flown in virtual time: the estimation, law, trigger, conversion and limits that "
    "fly, against a simulated vehicle. The paper gives its errors as numbers, but sizes, speeds, arm motion and "
    "disturbances only as pictures: those here are ours. What can be compared is how much the errors shrink against "
    "the paper's own baseline, a PID with the paper's gains. Errors are absolute, per axis of the world frame, of the "
    "true position, over the cycles that fly the trajectory; means and largest errors of a flight are averaged over "
    "the seeds."
)


def _chapter(chapter: Chapter) -> str:
    whole = {flown.item.controller: flown for flown in chapter.flights}
    parts = [
        ablation_grid(flown, own)
        for name, flown in whole.items()
        if (own := [variant for variant in chapter.variants if variant.item.controller == name])
    ]
    figures = "\n".join(picture(subject, caption, png.read_bytes()) for subject, caption, png in chapter.drawn)
    return (
        f"<section>\n<h2>{escape(chapter.title)}</h2>\n<h3>What was flown</h3>\n{facts(chapter.facts)}\n"
        f"<h3>Beside the paper</h3>\n{tables([comparison(chapter.flights), events(chapter.flights)])}\n"
        + (f"<h3>What each part is worth</h3>\n{tables(parts)}\n" if parts else "")
        + f"<h3>A closer look</h3>\n{figures}\n{tables(chapter.closer)}\n</section>"
    )


def _repeat(sources: Sequence[Source], command: str) -> str:
    """All that is needed to fly it again."""
    versions = (
        f"dauam-companion {__version__}, Python {platform.python_version()}, numpy {np.__version__}, "
        f"matplotlib {mpl.__version__}"
    )
    files = "\n".join(f"<h3>{escape(str(one.path))}</h3>\n<pre>{escape(one.text)}</pre>" for one in sources)
    return (
        f"<section>\n<h2>To fly it again</h2>\n<pre>{escape(command)}</pre>\n<p>{escape(versions)}. The same seeds "
        "give the same numbers to the last digit, on the same versions and kind of processor. Figures and the closer "
        f"look show the first seed's vehicle, flown alone. The files as they were:</p>\n{files}\n</section>"
    )
