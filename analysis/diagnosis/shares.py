"""The share of a name that each set-up shows: an effect of the arm acts at every place with one size.

An error that no effect explains can look like one on a circle, and even on two, but hardly with the same size at
every place. So where set-ups disagree on the size of a name, the name imitates something else.
"""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.diagnosis import Share
from analysis.diagnosis.search import SearchResult
from analysis.diagnosis.worth import worth
from analysis.kinematics.arm import Array


def shares_of(result: SearchResult, k: int, limits: Array) -> tuple[Share, ...]:
    """Return the shares of name k in the set-ups in which it changes readings by more than the limits (b,) µm.

    Everything else that may be present is fitted beside each share. How the robot came to a target is assumed, so that
    an effect with a history is judged on circles alone.
    """
    linear, change = result.linear, result.contributions[k]
    history = result.state.refined.effects[k].departures().has_history
    judged = np.array([block.sampling is not None or not history for block in linear.blocks])
    setups = np.array([block.one.setup for block in linear.blocks])
    found = []
    for setup in dict.fromkeys(setups[judged & (worth(linear, change).um > limits)].tolist()):
        own = np.zeros_like(change)
        for rows, here in zip(linear.rows, judged & (setups == setup), strict=True):
            own[rows] = here * change[rows]
        precision, slope = result.posterior.cavity(own[:, None])
        known = float(precision[0, 0])
        if known > 0:
            found.append(Share(setup, 1 + float(slope[0]) / known, float(known**-0.5)))
    return tuple(found)
