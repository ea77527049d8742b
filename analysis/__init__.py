"""Analysis of measurements with a ball link and two digital probes: figures, models and diagnoses of a robot.

    from analysis import load_run, evaluate
    result = evaluate(load_run("runs/monday-acw"))
    print(result.figures["band_deg"])

The names below are the public API (docs/api.md) and are imported on first use. A folder of `analysis` must not share a
name with a function of the API, because importing the folder would hide the function. The folders form layers, from
`robot` inside to `cli`, with `apps` outside (docs/architecture.md). `analysis` uses only three parts of `daq`: those
that read runs, talk to a running daemon, and start an emulator.
"""

# ruff: noqa: F403, F405 - the names of the list below are those of `analysis.api`, which is slow to import
from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from analysis.api import *

__all__ = [
    "ArmAngles",
    "ArmPoses",
    "CalibratedArm",
    "CellError",
    "CircleCurve",
    "Compared",
    "Comparison",
    "Diagnosis",
    "FileError",
    "Gap",
    "JointReversal",
    "Measured",
    "Named",
    "PathCurve",
    "PoseCurve",
    "Quantity",
    "RadialCurve",
    "RepeatabilityCurve",
    "Result",
    "RigError",
    "calibrate",
    "calibrated_arm",
    "compare",
    "diagnose",
    "evaluate",
    "evaluate_runs",
    "load_run",
    "read_table",
    "save_run",
    "simulate",
]


def __getattr__(name: str) -> Any:
    """Import a public name on first use, because importing all of them takes most of a second."""
    if name not in __all__:
        raise AttributeError(f"module 'analysis' has no attribute {name!r}")
    from analysis import api  # noqa: PLC0415

    return getattr(api, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
