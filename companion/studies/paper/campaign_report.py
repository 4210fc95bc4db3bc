"""Report of a campaign as one self-contained HTML page."""

import platform
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import matplotlib as mpl
import numpy as np

from companion import __version__
from companion.analysis.report.html import contents, facts, lead, picture, tables, whole
from companion.analysis.report.tables import BAD, GOOD, Cell, Grid
from companion.studies.paper.campaign import Flown, label_of
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
    """Tables on the network and the proof, from the flight of the first seed."""
    drawn: Sequence[Drawn]


@dataclass(frozen=True)
class Source:
    """Input file of the campaign, with its text at the time."""

    path: Path
    text: str


def page(chapters: Sequence[Chapter], sources: Sequence[Source], command: str) -> str:
    """Return the whole report."""
    titles = [*((f"c{number}", chapter.title) for number, chapter in enumerate(chapters)), ("repeat", "Repeat it")]
    body = "\n".join(_chapter(f"c{number}", chapter) for number, chapter in enumerate(chapters))
    verdicts = lead(_verdict(chapters), ())
    return whole(_TITLE, f"{verdicts}{contents(titles)}<p>{_INTRODUCTION}</p>\n{body}\n{_repeat(sources, command)}")


def _verdict(chapters: Sequence[Chapter]) -> Cell:
    """Return the number of flights lost or outside of their error limits, in a sentence."""
    flights = [flown for chapter in chapters for flown in chapter.flights]
    bad = [flown for flown in flights if not flown.good]
    if not bad:
        return Cell("Every flight of every complete law stayed inside its error limits.", GOOD)
    names = ", ".join(f"{label_of(one.item.controller)} on {label_of(one.item.experiment)}" for one in bad)
    return Cell(f"Lost vehicles or outside the error limits: {names}.", BAD)


_TITLE = "Event-triggered neural control of a dual-arm multirotor: the paper's experiments in simulation"

_INTRODUCTION = (
    "Two experiments of Wang et al., <i>Neural Network-Based Adaptive Event-Triggered Control for Dual-Arm Unmanned "
    "Aerial Manipulator Systems</i>, flown in virtual time: the estimation, law, trigger, conversion and limits that "
    "fly, against a simulated vehicle. The paper gives its errors as numbers, but sizes, speeds, arm motion and "
    "disturbances only as pictures: those here are ours. Only the reduction of the errors against the paper's own "
    "baseline, a PID with the paper's gains, can be compared. Errors are absolute, per axis of the world frame, of the "
    "true position, over the cycles that fly the trajectory; means and largest errors of a flight are averaged over "
    "the seeds."
)


def _chapter(anchor: str, chapter: Chapter) -> str:
    whole = {flown.item.controller: flown for flown in chapter.flights}
    parts = [
        ablation_grid(flown, own)
        for name, flown in whole.items()
        if (own := [variant for variant in chapter.variants if variant.item.controller == name])
    ]
    figures = "\n".join(picture(subject, caption, png.read_bytes()) for subject, caption, png in chapter.drawn)
    return (
        f'<section id="{anchor}">\n<h2>{escape(chapter.title)}</h2>\n<h3>Flight plan</h3>\n{facts(chapter.facts)}\n'
        f"<h3>Comparison with the paper</h3>\n{tables([comparison(chapter.flights), events(chapter.flights)])}\n"
        + (f"<h3>Ablations</h3>\n{tables(parts)}\n" if parts else "")
        + f"<h3>A closer look</h3>\n{figures}\n{tables(chapter.closer)}\n</section>"
    )


def _repeat(sources: Sequence[Source], command: str) -> str:
    """Return all that is needed to repeat the campaign."""
    versions = (
        f"dauam-companion {__version__}, Python {platform.python_version()}, numpy {np.__version__}, "
        f"matplotlib {mpl.__version__}"
    )
    files = "\n".join(f"<h3>{escape(one.path.name)}</h3>\n<pre>{escape(one.text)}</pre>" for one in sources)
    return (
        f'<section id="repeat">\n<h2>Repeat it</h2>\n<pre>{escape(command)}</pre>\n<p>{escape(versions)}. '
        "The same seeds give the same numbers to the last digit, on the same versions and kind of processor. Figures "
        "and the closer look show the first seed's vehicle, flown alone. The files at that time:</p>\n"
        f"{files}\n</section>"
    )
