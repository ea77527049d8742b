"""What stays of places after the calibrated model, and what it was held against: what was looked for and not found.

Each neighbourhood of poses is left out in its turn, and what the model of all others misses there is what stays. It is
held against all that a place may go with and no name has: posture, the side from which joints came, the order of time,
temperature. Each as an error of every joint, fitted to what stays in all neighbourhoods but one and held against that
one, so that the share that it explains is of places that had no part in the fit: what explains nothing there was not
found.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from analysis.inference.blocks import Block
from analysis.inference.result import Looked, Remains, Subject
from analysis.inference.search import SearchResult
from analysis.inference.validation import LeftOut
from analysis.kinematics.arm import Array
from analysis.traces.kind import SAME_RAD

_UNIT_RAD = np.radians(1e-3)
"""Unit of an error of a joint. It has no effect on the result, because the strength is scaled."""
_STRENGTHS = 4.0 ** np.arange(-8, 7)
"""Squares of a form's strength in this unit; the one that leaves least is taken. From a 256th of a unit to 64."""
_SLOW = 4
"""Half waves over the duration of a run, or one beside it. Chosen: warming, a shift of an instrument, a day's cycle."""
_FEWEST_GROUPS = 4
"""Neighbourhoods below which nothing is said: one left out of three leaves too little to fit."""
_Functions = Callable[[Block], Array]


def remains_of(result: SearchResult, left_out: LeftOut, temperature: Array | None) -> Remains | None:
    """Return what stays of places that were `left_out`, None where there are none; temperature (n,) in °C of the rows
    of the one table of all, None where it is unknown."""
    linear = result.linear
    if not len(left_out.rows) or len(np.unique(left_out.group)) < _FEWEST_GROUPS:
        return None
    half_waves = np.pi * np.arange(1, _SLOW + 1)
    warmth: Array | None = None
    one_table = len({id(block.table) for block in linear.blocks if block.table.kind.of_places}) == 1
    if temperature is not None and one_table and np.ptp(temperature) > 0:
        warmth = ((temperature - temperature.mean()) / np.ptp(temperature))[:, None]
    # What places may go with, each as functions (n, c) rad at a block's samples, None where the runs do not have it.
    subjects: dict[Subject, _Functions | None] = {
        "posture": _of_places(lambda block: np.concatenate([f(block.table.q) for f in (np.cos, np.sin)], axis=1)),
        "approach": _of_places(_sides),
        "time": _of_places(lambda block: np.cos(half_waves * np.linspace(0.0, 1.0, len(block.table.q))[:, None])),
        "temperature": None if warmth is None else _of_places(lambda _: warmth),
        "speed": None,  # a robot that stands has none
    }
    off = np.sqrt(left_out.robust) * left_out.missed
    looked = []
    for subject, functions in subjects.items():
        share = None
        if functions is not None:
            axes = [linear.by_joint(axis, functions)[left_out.rows] for axis in range(1, linear.axes + 1)]
            share = _share_left_out(np.sqrt(left_out.robust)[:, None] * np.concatenate(axes, axis=1), off, left_out)
        looked.append(Looked(subject, share))
    mean_squares = [np.average(square, weights=left_out.robust) for square in (left_out.missed_mm2, left_out.noise_mm2)]
    whole, noise = (1e3 * float(np.sqrt(3 * square)) for square in mean_squares)
    return Remains(whole, noise, tuple(looked))


def _of_places(of_rows: Callable[[Block], Array]) -> _Functions:
    """Return functions at the samples of a block's path, of which each row of its table has as many, from those of the
    rows (n, c); zero for circles."""

    def functions(block: Block) -> Array:
        samples = len(block.path.q)
        if not block.table.kind.of_places:
            return np.zeros((samples, of_rows(block).shape[1]))
        values = _UNIT_RAD * of_rows(block)
        return np.repeat(values, samples // len(values), axis=0)

    return functions


def _sides(block: Block) -> Array:
    """Return the way (n, axes) in which each joint came: as the rows say, or else from the row before."""
    table = block.table
    sides = table.kind.sides(table)
    if sides is not None:
        return sides.astype(float)
    way = np.diff(table.q, axis=0, prepend=table.q[:1])
    return np.where(np.abs(way) > SAME_RAD, np.sign(way), 0.0)


def _share_left_out(columns: Array, off: Array, left_out: LeftOut) -> float:
    """Return the share of the square of what stays (n,) that columns (n, c) explain at neighbourhoods left out, at the
    strength that explains most: 0 where none explains anything."""
    order = np.argsort(left_out.group, kind="stable")
    ends = [0, *(np.flatnonzero(np.diff(left_out.group[order])) + 1).tolist(), len(order)]
    groups = [order[begin:end] for begin, end in pairwise(ends)]
    normal, right = columns.T @ columns, columns.T @ off
    squares = np.zeros(len(_STRENGTHS))
    for rows in groups:
        of_group = columns[rows]
        power, turn = np.linalg.eigh(normal - of_group.T @ of_group)
        seen = turn.T @ (right - of_group.T @ off[rows])
        fitted = seen / (np.maximum(power, 0.0) + 1 / _STRENGTHS[:, None])
        squares += ((off[rows] - fitted @ (of_group @ turn).T) ** 2).sum(axis=1)
    return max(1 - float(squares.min() / (off @ off)), 0.0)
