"""Tables of the network and of the paper's proof, from one flight of each law."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from companion.analysis.report.tables import Cell, Grid
from companion.core.types import Array
from companion.studies.paper.campaign import label_of, tracking
from companion.studies.paper.campaign_detail import Detail, Proof, learnt

_NETWORK_NOTE = (
    "Second half of the first seed's flight. A share of 1: the signal is the same; 0: it knows nothing of it; below "
    "0: it is further from it than nothing would be. The network's input is the reference's velocity and a constant "
    "1, and its weights follow y_2, whatever made it: so it does not tell friction from any other push that is slow "
    "enough to be followed, and what it learns is their sum. An observed push, where a law has one, is what the "
    "rotors do not explain of the motion."
)

_PROOF_NOTE = (
    "V of eq. V-comp, with the best output weights for the true friction as ideal ones. The bounds that the theorem "
    "takes for known are those that this flight kept: it is a statement about this flight. Delta is everything that "
    "moved the vehicle and was neither u, nor smooth friction at its velocity, nor known of the arms; so it holds what "
    "the theorem's vehicle does not have, the delays and the lags of attitude and rotors. V of a law that predicts is "
    "that of the predicted errors; the theorem does not speak of them, as nothing bounds what then stands for Delta."
)


def closer(details: Sequence[Detail]) -> list[Grid]:
    """Return the tables of one experiment; empty where no law is the paper's."""
    thinking = [detail for detail in details if "f_hat" in detail.signals and not detail.lost]
    proved = [(detail, detail.proof) for detail in details if detail.proof is not None]
    grids = []
    if thinking:
        columns = ("", "rms x", "y", "z (m/s²)", *_shares("friction"), *_shares("friction and room"))
        rows = tuple(row for detail in thinking for row in _signal_rows(detail))
        grids.append(Grid("what the network learns", columns, rows, _NETWORK_NOTE))
    if proved:
        rows = tuple(_proof_row(detail, proof) for detail, proof in proved)
        gone = (label_of(detail.item.controller) for detail in details if detail.lost)
        verdicts = " ".join(
            [*(_verdict(detail, proof) for detail, proof in proved), *(f"{name}: lost, so left out." for name in gone)]
        )
        grids.append(
            Grid("the Lyapunov function and the fixed-time bound", _PROOF_COLUMNS, rows, f"{_PROOF_NOTE} {verdicts}")
        )
    return grids


def _shares(of: str) -> tuple[str, str, str]:
    return f"share of {of}: x", "y", "z"


def _signal_rows(detail: Detail) -> Iterator[tuple[Cell, ...]]:
    name = label_of(detail.item.controller)
    yield _signal_row(f"{name}: f_hat", detail, "f_hat")
    if "push" in detail.signals and detail.signals["push"].any():
        yield _signal_row(f"{name}: observed push", detail, "push")


def _signal_row(name: str, detail: Detail, signal: str) -> tuple[Cell, ...]:
    found = learnt(detail, signal)
    shares = (*found.of_friction, *found.of_friction_and_room)
    sizes = (Cell(f"{size:.3f}") for size in found.size_mps2)
    return Cell(name), *sizes, *(Cell("–" if np.isnan(share) else f"{share:.2f}") for share in shares)


_PROOF_COLUMNS = (
    "",
    "V at 0 s",
    "largest V",
    "largest of the states",
    "bound on V",
    "holds after",
    "bound on |p - p_d|",
    "largest |p - p_d|",
)


def _proof_row(detail: Detail, proof: Proof) -> tuple[Cell, ...]:
    now = tracking(detail.trace)
    v, states = proof.lyapunov.total[now], proof.lyapunov.states[now]
    bound = proof.bound
    bounds = (
        (f"{bound.v_bound:.1f}", f"{bound.settling_time_s:.0f} s", f"{bound.position_m:.1f} m")
        if bound.applies
        else ("–", "–", "–")
    )
    return (
        Cell(label_of(detail.item.controller)),
        *map(Cell, (f"{v[0]:.2f}", f"{v.max():.2f}", f"{states.max():.3f}", *bounds)),
        Cell(f"{_largest(detail.trace.error_w_m[now]):.3f} m"),
    )


def _largest(vectors: Array) -> float:
    return float(np.sqrt((vectors**2).sum(axis=-1)).max())


def _verdict(detail: Detail, proof: Proof) -> str:
    name = label_of(detail.item.controller)
    delta = f"|Delta| up to {proof.delta_mps2:.2f} m/s² and " if math.isfinite(proof.delta_mps2) else ""
    taken = f"with {delta}L_f = {proof.lipschitz_per_s:.2f} 1/s"
    if proof.bound.applies:
        return f"{name}: the theorem's conditions hold, {taken}."
    failed = "; ".join(str(condition) for condition in proof.bound.conditions if not condition.holds)
    return f"{name}: the fixed-time bound does not apply, {taken}: {failed}."
