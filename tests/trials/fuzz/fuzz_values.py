"""Crafted values in the chunks of a lap whose checksums are right: to the figures, or to one line that says why not."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from analysis.procedures.results import result_of
from analysis.runs.loading import measured_of
from daq.store import Run
from daq.store.manifest import new_manifest
from rigs.errors import RigError
from rigs.load import load
from tests.support.table_cases import circle_values

Array = np.ndarray[Any, Any]
RIG_FILE = "paper-fanuc"
STAMPS = ("requested_ns", "first_byte_ns", "last_byte_ns")
INTEGERS = (-(2**63), -(2**31), -2, -1, 0, 1, 2**31 - 1, 2**53, 2**61, 2**62, 2**63 - 1)
NUMBERS = (np.nan, np.inf, -np.inf, 0.0, -0.0, 5e-324, 1.0, 1e5, -1e5, 1e7, 1e20, 1e200, 1.7e308, -1.7e308)


@cache
def lap() -> Run:
    """A recorded yaw lap of two gauges that are asked and a robot that streams by a clock of its own."""
    t_s, q, g_mm = circle_values("yaw", "acw")
    at = 1_000_000_000 + (t_s * 1e9).astype(np.int64)
    streams = {}
    for name, values in (("g1", g_mm[:, :1]), ("g2", g_mm[:, 1:]), ("robot", np.degrees(q))):
        robot = name == "robot"
        columns = [f"q{axis}_deg" for axis in range(1, 7)] if robot else [f"{name}_mm"]
        streams[name] = {
            "requested_ns": np.full(len(at), -1) if robot else at - 5_000_000,
            "first_byte_ns": at,
            "last_byte_ns": at + 1000,
            "size": np.full(len(at), 60 if robot else 7, dtype=np.int32),
            "device_time_s": t_s + 77 if robot else np.full(len(at), np.nan),
            "status": np.zeros(len(at), dtype=np.int32),
            "sequence": np.arange(len(at)),
            **dict(zip(columns, values.T, strict=True)),
        }
    manifest = new_manifest(
        name="lap",
        test="yaw",
        direction="acw",
        rig_name=RIG_FILE,
        rig_text=load(RIG_FILE)[1],
        operator="",
        streams={name: tuple(columns)[7:] for name, columns in streams.items()},
    )
    return Run(Path("lap"), manifest.model_copy(update={"exit_status": "complete"}), streams, [])


def crafted(dice: Random) -> int:
    """Spoils a column or two; a warning is a failure too."""
    run = lap()
    streams = {name: dict(columns) for name, columns in run.streams.items()}
    for _ in range(dice.choice((1, 1, 2, 3))):
        columns = streams[dice.choice(tuple(streams))]
        if dice.random() < 0.2:  # stamps that agree with each other
            stamps = np.sort(spoilt(dice, columns["last_byte_ns"]))
            columns.update(dict.fromkeys(STAMPS[1:], stamps), requested_ns=np.full(len(stamps), -1))
        else:
            name = dice.choice(tuple(columns))
            columns[name] = spoilt(dice, columns[name])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            figures = result_of(measured_of(replace(run, streams=streams))).figures
        except RigError as error:
            assert all(line.isprintable() and len(line) < 500 for line in error.lines())
        else:
            assert all(np.isfinite(figure.value) for figure in figures.values()), figures
    return 1


def spoilt(dice: Random, column: Array) -> Array:
    """Some rows, half of them or all but a few with odd values; or in another order."""
    rng, count = np.random.default_rng(dice.getrandbits(32)), len(column)
    if column.dtype.kind == "f":
        odd: Array = rng.choice(NUMBERS, 3)
    else:
        bounds = np.iinfo(column.dtype)
        odd = np.array([min(max(dice.choice(INTEGERS), bounds.min), bounds.max) for _ in range(3)], dtype=column.dtype)
    new = column.copy()
    match dice.randrange(6):
        case 0:
            new[rng.integers(0, count, dice.randint(1, 3))] = odd[0]
        case 1:
            new[:: dice.randint(2, 5)] = odd[0]
        case 2:
            new[dice.randint(0, 3) :] = odd[0]
        case 3:
            new[:] = rng.choice(odd, count)
        case 4:
            new = new[::-1].copy() if dice.random() < 0.5 else rng.permutation(new)
        case _:
            new[:] = new[count // 2]
    return new
