"""Parts of a self-contained HTML page. All text from records is escaped."""

import base64
from collections.abc import Iterable, Mapping
from html import escape

from companion.analysis.report.tables import WORDS, Cell, Grid


def whole(title: str, body: str) -> str:
    """Return the document; `title` is trusted HTML."""
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<title>{title}</title>\n'
        f"<style>{_STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n{body}\n</body>\n</html>\n"
    )


def facts(pairs: Iterable[tuple[str, str]]) -> str:
    """Return names and their values as a definition list."""
    rows = "\n".join(f"<dt>{escape(name)}</dt><dd>{escape(said)}</dd>" for name, said in pairs)
    return f"<dl>\n{rows}\n</dl>"


def lead(verdict: Cell, lines: Iterable[str]) -> str:
    """Return the verdict in one sentence, with more lines below."""
    said = "<br>\n".join(escape(line) for line in lines)
    return f'<p class="verdict {verdict.tone}">{escape(verdict.text)}</p>' + (f"\n<p>{said}</p>" if said else "")


def contents(links: Iterable[tuple[str, str]]) -> str:
    """Return a line of links, each an anchor on this page and its text."""
    return "<nav>" + " ".join(f'<a href="#{anchor}">{escape(text)}</a>' for anchor, text in links) + "</nav>"


def swatches(colours: Mapping[str, str]) -> str:
    """Return the legend of the phases' background colours."""
    said = " ".join(f'<span style="background:{colour}">{escape(name)}</span>' for name, colour in colours.items())
    return f"<p class=swatches>Phases, in all figures over time: {said}</p>" if said else ""


def tables(grids: Iterable[Grid]) -> str:
    """Return the HTML of several tables, one after the other."""
    return "\n".join(table(grid) for grid in grids)


def table(grid: Grid) -> str:
    """Return the HTML of a table with its title above and its note below; without rows only the note."""
    if not grid.rows:
        return f"<p><b>{escape(grid.title)}</b>: {escape(grid.note)}</p>"
    tones = ("words" if cell.tone == WORDS else "" for cell in grid.rows[0])
    head = "".join(f'<th class="{tone}">{escape(name)}</th>' for name, tone in zip(grid.columns, tones, strict=True))
    rows = "\n".join(
        "<tr>" + "".join(f'<td class="{cell.tone}">{escape(cell.text)}</td>' for cell in row) + "</tr>"
        for row in grid.rows
    )
    note = f"<p class=note>{escape(grid.note)}</p>\n" if grid.note else ""
    return (
        f"<figure class=numbers><div class=scroll><table>\n<caption>{escape(grid.title)}</caption>\n"
        f"<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table></div>\n{note}</figure>"
    )


def picture(subject: str, caption: str, png: bytes, *, wide: bool = False) -> str:
    """Return a PNG inside the page; a phone scrolls a wide one, so that its text stays readable."""
    data, words = base64.b64encode(png).decode("ascii"), escape(caption)
    image = f'<img alt="{escape(subject)}: {words}" src="data:image/png;base64,{data}">'
    image = f"<div class=scroll>{image}</div>" if wide else image
    return f"<figure class=picture>{image}<figcaption>{words}</figcaption></figure>"


_STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 "Source Sans 3", "Segoe UI", Roboto, "Helvetica Neue", sans-serif; color: #1b1b1b;
       max-width: 62rem; margin: 2.5rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.55rem; line-height: 1.25; } h2 { font-size: 1.3rem; margin-top: 3rem; border-bottom: 1px solid #999; }
h3 { font-size: 1.05rem; margin: 1.8rem 0 .6rem; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .25rem 1.2rem; margin: 0; }
dt { color: #666; } dd { margin: 0; overflow-wrap: anywhere; }
figure { margin: 1rem 0 1.6rem; } figcaption, .note { color: #555; font-size: .88rem; margin: .3rem 0 0; }
img { width: 100%; height: auto; }
.pair { display: grid; grid-template-columns: 1fr 1fr; gap: 0 1.2rem; align-items: start; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: .9rem; }
caption { text-align: left; font-weight: 600; padding-bottom: .3rem; }
th, td { text-align: right; padding: .18rem .5rem; vertical-align: top; }
th { font-weight: 500; color: #555; } thead tr { border-bottom: 1px solid #999; }
tbody tr:last-child { border-bottom: 1px solid #999; }
th:first-child, td:first-child { text-align: left; white-space: pre-wrap; min-width: 8.5rem; }
th { vertical-align: bottom; } td:nth-child(n+2) { white-space: nowrap; }
th.words:nth-child(n+2), td.words:nth-child(n+2) { text-align: left; white-space: normal; width: 45%; }
.scroll { overflow-x: auto; }
body { counter-reset: picture; }
.picture figcaption::before { counter-increment: picture; content: "Figure " counter(picture) ". "; }
.verdict { font-size: 1.1rem; font-weight: 600; margin-bottom: .4rem; }
nav { margin: 1rem 0; } nav a { color: #0a58a8; margin-right: 1.2rem; }
.swatches { font-size: .82rem; color: #555; } .swatches span { padding: .1rem .5rem; color: #1b1b1b; }
.good { color: #00704a; } .bad { color: #a8320a; } .faint { color: #777; }
pre { background: #f6f6f4; padding: .7rem .9rem; overflow-x: auto; font-size: .78rem; line-height: 1.4; }
summary { cursor: pointer; color: #0a58a8; margin: .6rem 0; }
@page { margin: 16mm; }
@media (max-width: 40rem) { .pair { grid-template-columns: 1fr; } .scroll img { width: 46rem; } }
@media print {
  nav { display: none; }
  body { max-width: none; margin: 0; padding: 0; font-size: 9.5pt; } pre { white-space: pre-wrap; }
  th, td { padding: .15rem .3rem; } figure, tr, dl { break-inside: avoid; } h2, h3, caption { break-after: avoid; }
  section + section { break-before: page; }
}
"""
