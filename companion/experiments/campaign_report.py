"""A campaign as one page that needs nothing but itself: HTML with its figures inside."""

import base64
import platform
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import matplotlib as mpl
import numpy as np

from companion import __version__
from companion.experiments.campaign import Flown
from companion.experiments.campaign_plots import Drawn
from companion.experiments.campaign_table import WORDS, Grid, ablation_grid, comparison, events
from companion.experiments.campaign_words import Facts


@dataclass(frozen=True)
class Chapter:
    """One experiment."""

    title: str
    facts: Facts
    flights: Sequence[Flown]
    """Whole laws, the baseline first."""
    variants: Sequence[Flown]
    closer: Sequence[Grid]
    """What the single flight of the first seed says: the network, the proof."""
    drawn: Sequence[Drawn]


@dataclass(frozen=True)
class Source:
    """A file that the campaign was flown from, as it was."""

    path: Path
    text: str


def page(chapters: Sequence[Chapter], sources: Sequence[Source], command: str) -> str:
    """The whole report; everything that is not ours is escaped."""
    body = "\n".join(_chapter(chapter) for chapter in chapters)
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<title>{_TITLE}</title>\n'
        f"<style>{_STYLE}</style>\n</head>\n<body>\n<h1>{_TITLE}</h1>\n<p>{_INTRODUCTION}</p>\n"
        f"{body}\n{_repeat(sources, command)}\n</body>\n</html>\n"
    )


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
    facts = "\n".join(f"<dt>{escape(name)}</dt><dd>{escape(said)}</dd>" for name, said in chapter.facts)
    whole = {flown.item.controller: flown for flown in chapter.flights}
    parts = [
        ablation_grid(flown, own)
        for name, flown in whole.items()
        if (own := [variant for variant in chapter.variants if variant.item.controller == name])
    ]
    figures = "\n".join(_figure(*drawn) for drawn in chapter.drawn)
    return (
        f"<section>\n<h2>{escape(chapter.title)}</h2>\n<h3>What was flown</h3>\n<dl>\n{facts}\n</dl>\n"
        f"<h3>Beside the paper</h3>\n{_tables([comparison(chapter.flights), events(chapter.flights)])}\n"
        + (f"<h3>What each part is worth</h3>\n{_tables(parts)}\n" if parts else "")
        + f"<h3>A closer look</h3>\n{figures}\n{_tables(chapter.closer)}\n</section>"
    )


def _tables(grids: Iterable[Grid]) -> str:
    return "\n".join(_table(grid) for grid in grids)


def _table(grid: Grid) -> str:
    tones = ("words" if cell.tone == WORDS else "" for cell in grid.rows[0])
    head = "".join(f'<th class="{tone}">{escape(name)}</th>' for name, tone in zip(grid.columns, tones, strict=True))
    rows = "\n".join(
        "<tr>" + "".join(f'<td class="{cell.tone}">{escape(cell.text)}</td>' for cell in row) + "</tr>"
        for row in grid.rows
    )
    note = f"<p class=note>{escape(grid.note)}</p>\n" if grid.note else ""
    return (
        f"<figure class=numbers><table>\n<caption>{escape(grid.title)}</caption>\n<thead><tr>{head}</tr></thead>\n"
        f"<tbody>\n{rows}\n</tbody>\n</table>\n{note}</figure>"
    )


def _figure(subject: str, caption: str, png: Path) -> str:
    data = base64.b64encode(png.read_bytes()).decode("ascii")
    words = escape(caption)
    image = f'<img alt="{escape(subject)}: {words}" src="data:image/png;base64,{data}">'
    return f"<figure>{image}<figcaption>{words}</figcaption></figure>"


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


_STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 "Source Sans 3", "Segoe UI", Roboto, "Helvetica Neue", sans-serif; color: #1b1b1b;
       max-width: 62rem; margin: 2.5rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.55rem; line-height: 1.25; } h2 { font-size: 1.3rem; margin-top: 3rem; border-bottom: 1px solid #999; }
h3 { font-size: 1.05rem; margin: 1.8rem 0 .6rem; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .25rem 1.2rem; margin: 0; }
dt { color: #666; } dd { margin: 0; }
figure { margin: 1rem 0 1.6rem; } figcaption, .note { color: #555; font-size: .88rem; margin: .3rem 0 0; }
img { width: 100%; height: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: .9rem; }
caption { text-align: left; font-weight: 600; padding-bottom: .3rem; }
th, td { text-align: right; padding: .18rem .5rem; vertical-align: top; }
th { font-weight: 500; color: #555; } thead tr { border-bottom: 1px solid #999; }
tbody tr:last-child { border-bottom: 1px solid #999; }
th:first-child, td:first-child { text-align: left; white-space: pre-wrap; min-width: 8.5rem; }
th { vertical-align: bottom; } td:nth-child(n+2) { white-space: nowrap; }
th.words:nth-child(n+2), td.words:nth-child(n+2) { text-align: left; white-space: normal; width: 45%; }
.good { color: #00704a; } .bad { color: #a8320a; } .faint { color: #777; }
pre { background: #f6f6f4; padding: .7rem .9rem; overflow-x: auto; font-size: .78rem; line-height: 1.4; }
@page { margin: 16mm; }
@media print {
  body { max-width: none; margin: 0; padding: 0; font-size: 9.5pt; } pre { white-space: pre-wrap; }
  th, td { padding: .15rem .3rem; } figure, tr, dl { break-inside: avoid; } h2, h3, caption { break-after: avoid; }
  section + section { break-before: page; }
}
"""
