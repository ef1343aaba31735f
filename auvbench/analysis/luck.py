"""Few seeds that agree: an interval that is narrow by luck as much as by merit, and looks like merit alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auvbench.analysis.effects import learns
from auvbench.analysis.formatting import listed, unit
from auvbench.analysis.measures import Measure
from auvbench.analysis.model import Agent
from auvbench.statistics import means

FEW = 4
"""seeds up to which a variance between them is hardly known"""
TIMES = 4.0
"""how much wider another agent's interval is, before a reader would compare the two"""
MOST = 3
"""agents that the sentence names"""


def agreement(agents: Sequence[Agent], m: Measure, confidence: float) -> str:
    """A sentence where seeds of one agent agree and those of another do not; '' where no interval misleads.

    Seeds agree where they differ no more than one policy does from itself in another test: the variance between
    their means is not above that which episodes alone explain.
    """
    few = [a for a in agents if learns(a) and 2 <= len(a.outcome) <= FEW and np.isfinite(m.values(a)).all()]
    if len(few) < 2:
        return ""
    table = m.table(few, paired=False)
    width = np.array([e.high - e.low for e in means(table, confidence)])
    rows = [m.values(agent).mean(axis=1) for agent in few]
    agree = np.array([np.ptp(row) == 0 for row in rows]) | (table.between_seeds <= table.residual)
    widest = int(np.where(agree, -np.inf, width).argmax())
    close = [i for i in np.flatnonzero(agree) if width[widest] >= TIMES * width[i]]
    if agree[widest] or not close:
        return ""
    names = listed([f"{few[i].label} ({_values(rows[i], m)})" for i in close], MOST)
    return (
        f"Few seeds: those of {names} agree as one policy does with itself in another test, those of "
        f"{few[widest].label} ({_values(rows[widest], m)}) do not. That a few agree may be luck, so the narrow "
        f"interval{'s are' if len(close) > 1 else ' is'} no sign of reliable training; more seeds would tell."
    )


def _values(row: np.ndarray, m: Measure) -> str:
    """'98.6 and 98.6 %'."""
    texts = [f"{100 * x:.1f}" if m.rate else f"{x:.4g}" for x in row]
    return f"{listed(texts)}{unit(m)}"
