"""Noise-free error caused by faults at the unseen place, which the answered effects should remove."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.worlds.stranger.cases import Lap, fault_from
from tests.worlds.stranger.cell import Cell, cell_of
from tests.worlds.stranger.faults import Fault
from tests.worlds.stranger.gauges import Link
from tests.worlds.stranger.measure import measure, trace_of
from tests.worlds.stranger.motion import track_of
from tests.worlds.stranger.real.programs import circle
from tests.worlds.stranger.real.setups import Watch, by_setup, centred, watched
from tests.worlds.stranger.screws import Array


def gap_of_real(truth: Mapping[str, Any], case: Path, said: Collection[str]) -> tuple[list[Lap], list[Lap], Array]:
    """Return noise-free laps at the unseen place with the faults, the same with the faults and all named effects
    `said`, each with the ball mounted anew, and the ball position (3,) mm.

    Answers are compared with the second, because a named effect also removes its healthy size.
    """
    cell = cell_of(yaml.safe_load((case / "unseen.yaml").read_text(encoding="utf-8")))
    setup = truth["setup"]["unseen"]
    link = Link(np.array(setup["ball_mm"]), np.array(setup["zeros_mm"]), cell.gauge_at)
    hidden = [fault_from(one) for one in truth["hidden"]]
    other = [fault_from(one) for one in truth["background"] if one["name"] in said and one["effect"] != "vibration"]
    track = track_of(cell, cell.circle)
    motions = [circle(cell, track, "yaw", sense, 1) for sense in (1, -1)]
    watches = [watched(cell, motion, trace_of(cell, motion), link) for motion in motions]
    links = [centred(cell, watches, link, faults) for faults in (hidden, [*hidden, *other])]
    faults, named = _laps(cell, watches, links[0], hidden), _laps(cell, watches, links[1], [*hidden, *other])
    return faults, named, links[1].ball


def _laps(cell: Cell, watches: Sequence[Watch], there: Link, faults: Sequence[Fault]) -> list[Lap]:
    """Every fifth reading of the changes by faults and the new ball position."""
    rows, found = slice(None, None, 5), []
    for watch in watches:
        added = measure(cell, watch.motion, faults, there, trace=watch.trace) - watch.plain
        thin = replace(watch, plain=watch.plain[rows], by_ball=watch.by_ball[rows])
        way = "acw" if watch.motion.sense > 0 else "cw"
        found.append(Lap(way, watch.motion.t[rows], watch.motion.q[rows], added[rows], by_setup([thin])))
    return found
