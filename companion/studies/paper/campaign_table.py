"""Numbers of a campaign as tables for terminal and page, and as JSON."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from companion.analysis.report.tables import BAD, FAINT, GOOD, PLAIN, WORDS, Cell, Grid
from companion.core.types import Array
from companion.simulation.virtual_link import words_of
from companion.studies.paper.ablations import Ablation
from companion.studies.paper.campaign import BASELINE, Flown, label_of, numbers_of
from companion.studies.paper.paper_table import PAPER, PID_WITHIN, PaperExperiment, beside_paper, reduced_percent

_READABLE_M = 1000.0
"""Largest error of a lost vehicle that is printed; it may be infinite."""

_ERRORS = ("mean x", "y", "z", "max x", "y", "z")

_MEANING = {
    f"without_{Ablation.NETWORK}": "No learning: the gains of the weights are 0, and f_hat stays 0.",
    f"without_{Ablation.TRIGGER}": "A command in every cycle.",
    f"without_{Ablation.SWITCHING}": "No sgn term in the command, so nothing compensates the error between triggers.",
    f"without_{Ablation.COMPENSATOR}": (
        "iota_1 and iota_2 stay 0: the filter's error is not compensated, and f_hat, which acts through iota_2, is off."
    ),
    f"without_{Ablation.PREDICTION}": (
        "The law sees the state with delays and attitude lag. A disturbance observer that is part of the prediction "
        "is off, too."
    ),
    f"without_{Ablation.PUSH}": "A lasting disturbance is neither predicted nor compensated.",
    "horizon_uncorrected": "The error of the autopilot's horizon is not corrected.",
    "feedforward_off": "The law does not know the arms' commanded motion.",
    "feedforward_full": "The law knows the reaction to the arms' commanded motion.",
}


def variant_words(variant: str) -> str:
    """Return the name of a variant in a table."""
    if not variant:
        return "the whole law"
    return variant.replace("_", " ").replace("feedforward", "arms' feed-forward")


def comparison(flights: Sequence[Flown]) -> Grid:
    """Return the paper's rows and ours on one experiment; `flights` are whole laws, including the baseline."""
    experiment = label_of(flights[0].item.experiment)
    paper = PAPER.get(experiment)
    baseline = next(flown for flown in flights if flown.item.controller == BASELINE)
    rows = [] if paper is None else _paper_rows(paper)
    for flown in flights:
        rows.append(_our_row(flown))
        if flown is not baseline and not flown.diverged:
            rows.append(_reduction_row(flown, baseline, paper))
    return Grid(
        f"position errors on {experiment} (cm)", ("", *_ERRORS, "updates"), tuple(rows), _beside_words(baseline, paper)
    )


def _paper_rows(paper: PaperExperiment) -> list[tuple[Cell, ...]]:
    numbers = (("paper: PID", paper.pid), ("paper: ET-NN", paper.etnn))
    rows = [
        (Cell(name, FAINT), *(Cell(_cm(value), FAINT) for value in (*row.mean_m, *row.max_m)), Cell("", FAINT))
        for name, row in numbers
    ]
    reduced = (*paper.mean_reduced_percent, *paper.max_reduced_percent)
    return [*rows, (Cell("  reduced (%)", FAINT), *(Cell(f"{value:.2f}", FAINT) for value in reduced), Cell(""))]


def _our_row(flown: Flown) -> tuple[Cell, ...]:
    errors = (*flown.mean_error_m, *flown.max_error_m)
    name = label_of(flown.item.controller) + (f", {_lost(flown)}" if flown.diverged else "")
    tone = BAD if flown.diverged else PLAIN
    numbers = (_cm(value) if value < _READABLE_M else "–" for value in errors)
    return Cell(name, tone), *(Cell(number, tone) for number in numbers), Cell(f"{flown.update_share:.1%}")


def _reduction_row(flown: Flown, baseline: Flown, paper: PaperExperiment | None) -> tuple[Cell, ...]:
    """Return the reductions, marked where they are at least the paper's."""
    ours = reductions(flown, baseline)
    theirs = np.full(6, np.nan) if paper is None else [*paper.mean_reduced_percent, *paper.max_reduced_percent]
    cells = (_reduction(mine, wanted) for mine, wanted in zip(ours, theirs, strict=True))
    return Cell("  reduced (%)"), *cells, Cell("")


def _reduction(mine: float, wanted: float) -> Cell:
    if np.isnan(wanted):
        return Cell(f"{mine:.2f}")
    return Cell(f"✓ {mine:.2f}", GOOD) if mine >= wanted else Cell(f"{mine:.2f}", BAD)


def reductions(flown: Flown, baseline: Flown) -> Array:
    """Return the reduction of mean and largest errors against the baseline, per cent (6,)."""
    means = reduced_percent(flown.mean_error_m, baseline.mean_error_m)
    return np.concatenate((means, reduced_percent(flown.max_error_m, baseline.max_error_m)))


def _beside_words(baseline: Flown, paper: PaperExperiment | None) -> str:
    """Return a sentence that compares this baseline with the paper's."""
    if paper is None:
        return "The paper has no such experiment: the reductions are against our own PID."
    off = beside_paper(baseline.mean_error_m, paper)
    said = ", ".join(f"{name} {round(100.0 * value):+d} %" for name, value in zip("xyz", off.tolist(), strict=True))
    near = "within" if (np.abs(off) <= PID_WITHIN).all() else "not within"
    within = f"{near} {100.0 * PID_WITHIN:.0f} %"
    return f"Our PID's mean errors are {within} of the paper's: {said}. ✓: reduced at least as much."


def events(flights: Sequence[Flown]) -> Grid:
    """Return the table of triggers, updates and times between triggers of each law."""
    columns = ("", "triggers", "share", "updates", "least gap", "mean", "largest", "1 cycle")
    rows = tuple(_event_row(flown) for flown in flights)
    note = (
        "Mean number of triggers in a flight; share of the cycles with a trigger, and with an update (a setpoint "
        "sent): after a trigger the rate limits may need several updates. Zeno behaviour cannot occur with any law: "
        f"two triggers are at least one control period, {1e3 * flights[0].period_s:.0f} ms, apart. 1 cycle: share of "
        "the gaps that are one period long, which only the control period limits."
    )
    return Grid(f"triggers on {label_of(flights[0].item.experiment)}", columns, rows, note)


def _event_row(flown: Flown) -> tuple[Cell, ...]:
    gaps = flown.gap_s
    return (
        Cell(label_of(flown.item.controller)),
        Cell(f"{flown.events.mean():.0f}"),
        Cell(f"{flown.score.event_share.mean():.1%}"),
        Cell(f"{flown.update_share:.1%}"),
        *(Cell("" if gaps is None else f"{1e3 * gap:.0f} ms") for gap in gaps or (0.0, 0.0, 0.0)),
        Cell("" if gaps is None else f"{(flown.gap_cycles == 1).mean():.1%}"),
    )


def ablation_grid(whole: Flown, variants: Sequence[Flown]) -> Grid:
    """Return the table of ablations: the errors without each part of a law."""
    columns = ("", "error (cm)", "ratio", "largest (cm)", "updates", "meaning")
    rows = tuple(_ablation_row(flown, whole) for flown in (whole, *variants))
    name, experiment = label_of(whole.item.controller), label_of(whole.item.experiment)
    note = "Error: norm of the axes' means; ratio: to the whole law's. Largest: of any axis, averaged over the seeds."
    return Grid(f"{name} with one part changed, {experiment}", columns, rows, note)


def _ablation_row(flown: Flown, whole: Flown) -> tuple[Cell, ...]:
    variant = flown.item.variant
    means = f"{_MEANING[variant]} {_outcome(flown, whole)}" if variant else ""
    first = Cell(variant_words(variant))
    if flown.diverged:
        return first, Cell(_lost(flown), BAD), Cell(""), Cell(""), Cell(f"{flown.update_share:.1%}"), Cell(means, WORDS)
    ratio = "" if flown is whole or whole.diverged else f"{flown.error_m / whole.error_m:.2f}"
    largest = float(flown.max_error_m.max())
    numbers = (_cm(flown.error_m), ratio, _cm(largest), f"{flown.update_share:.1%}")
    return first, *map(Cell, numbers), Cell(means, WORDS)


def _outcome(flown: Flown, whole: Flown) -> str:
    """Return the result in a sentence."""
    if flown.diverged:
        return f"It diverges: {_lost(flown)}."
    if whole.diverged:
        return ""
    ratio = flown.error_m / whole.error_m
    error = "The error hardly changes" if abs(ratio - 1.0) <= 0.05 else f"The error is {ratio:.2f} times as large"
    before, after = whole.update_share, flown.update_share
    same = abs(after - before) <= 0.1 * before
    updates = "about as many updates" if same else f"updates in {after:.1%} instead of {before:.1%} of the cycles"
    return f"{error}; {updates}."


def _cm(value_m: float) -> str:
    return f"{100.0 * value_m:.2f}"


def _lost(flown: Flown) -> str:
    return f"lost {flown.diverged} of {len(flown.item.seeds)}"


def summary(flights: Sequence[Flown]) -> dict[str, Any]:
    """Return `experiments.<experiment>.<controller>` with numbers, reductions and variants."""
    found: dict[str, Any] = {}
    wholes = {(flown.item.experiment, flown.item.controller): flown for flown in flights if not flown.item.variant}
    for (experiment, controller), flown in wholes.items():
        numbers = numbers_of(flown)
        baseline = wholes.get((experiment, BASELINE))
        if baseline is not None and baseline is not flown:
            reduced = [float(value) if np.isfinite(value) else None for value in reductions(flown, baseline)]
            numbers |= {"mean_reduced_percent": reduced[:3], "max_reduced_percent": reduced[3:]}
        own = (item for item in flights if (item.item.experiment, item.item.controller) == (experiment, controller))
        variants = {item.item.variant: numbers_of(item) for item in own if item.item.variant}
        if variants:
            numbers["variants"] = variants
        found.setdefault(label_of(experiment), {})[label_of(controller)] = numbers
    first = flights[0].item
    return {
        "experiments": found,
        "seeds": list(first.seeds),
        "bandwidth_radps": first.bandwidth_radps,
        "horizon": first.horizon,
        "law_on": "board" if first.radio is None else "ground",
        "link": None if first.radio is None else words_of(first.radio),
    }
