"""Sizes of faults that a stranger hid: the errors of `calibrate` and `diagnose` over the u that they state.

The cells are those of `scripts/dev blind --world real`, whose generator shares no code with rig. `calibrate` is given
the hidden names (a gear with its order, a ball with its lobes); `diagnose` finds names, and those count that it stands
by and that are the hidden ones. A size's truth is what was planted and the arm's healthy share of it.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.trials.blind.answers import name_in
from tests.trials.blind.scoring import wilson
from tests.trials.blind.trial import Job, make_case, runs_of

SEATS = {
    "transmission_error": "{axis}:{order:g}",
    "link_geometry": "{axis}.{field}",
    "wrist_coupling": "{from_axis}.{to_axis}",
    "ball_form": "{lobes:.0f}",
    "gauge_cyclic": "{gauge}:{period_mm:g}",
    "vibration": "{frequency_hz:.4f}",
}
"""How the places of some effects are written after `--fit`; those of all others are an axis, a gauge or none."""


@dataclass(frozen=True)
class Size:
    """One size: the case and the hidden fault, `calibrate` or `diagnose`, the error and its stated u in the unit of the
    size, the true and a healthy size."""

    case: str
    name: str
    by: str
    error: float
    u: float
    true: float
    healthy: float


BY = ("calibrate", "diagnose")


def fit_word(fault: Mapping[str, Any]) -> str:
    """Return the name and place of a fault of a truth as `--fit` takes it."""
    place = SEATS.get(fault["effect"], "{axis}" if "axis" in fault else "{gauge}" if "gauge" in fault else "")
    return f"{fault['effect']}:{place.format(**fault, **fault['parameters'])}".rstrip(":")


def sizes_of(job: Job, by: str, truth: Mapping[str, Any]) -> Iterator[Size]:
    """Yield the sizes of the hidden faults that `calibrate`, given their names, or `diagnose` states."""
    from analysis import calibrate, diagnose, load_run  # noqa: PLC0415

    runs = [load_run(run) for run in runs_of(job.case)["train"]]
    if by == "calibrate":
        found = calibrate(runs, ",".join(fit_word(fault) for fault in truth["hidden"])).effects
    else:
        found = diagnose(runs).standing
    stated = [named.to_dict() for named in found]
    for fault in truth["hidden"]:
        own = [one["parameters"][fault["size"]] for one in stated if name_in(one) == fault["name"]]
        true = float(fault["parameters"][fault["size"]])
        if own and own[0]["sd"]:
            yield Size(str(job), fault["name"], by, own[0]["value"] - true, own[0]["sd"], true, fault["healthy"])


def table(sizes: Sequence[Size]) -> list[str]:
    """Return the lines of the table: a row each of `calibrate` and `diagnose`, and of `calibrate` for the names that
    both have."""
    both = {(one.case, one.name) for one in sizes if one.by == "diagnose"}
    rows = {
        "`calibrate`, given the names": [one for one in sizes if one.by == "calibrate"],
        "`diagnose`, the names it found": [one for one in sizes if one.by == "diagnose"],
        "`calibrate`, these names alone": [
            one for one in sizes if one.by == "calibrate" and (one.case, one.name) in both
        ],
    }
    lines = [
        "| | sizes | rms of error/u | median of abs(error)/u | within 1 u | within 2 u | median error, healthy sizes "
        "| median error, of the size |",
        "|" + " --- |" * 8,
    ]
    return lines + [_row(what, own) for what, own in rows.items() if own]


def _row(what: str, sizes: Sequence[Size]) -> str:
    error, u, true, healthy = np.array([(one.error, one.u, one.true, one.healthy) for one in sizes]).T
    ratio, n = np.abs(error / u), len(sizes)
    parts = [what, str(n), f"{np.sqrt(np.mean(ratio**2)):.2f}", f"{np.median(ratio):.2f}"]
    for most in (1, 2):
        low, high = wilson(int((ratio <= most).sum()), n)
        parts.append(f"{100 * np.mean(ratio <= most):.0f} % ({100 * low:.0f} … {100 * high:.0f})")
    parts += [f"{np.median(np.abs(error) / healthy):.3f}", f"{100 * np.median(np.abs(error / true)):.2f} %"]
    return f"| {' | '.join(parts)} |"


def main() -> int:
    """Make the cells, calibrate and diagnose them, print each size and the table."""
    parser = argparse.ArgumentParser(
        prog="scripts/dev sizes",
        description=(__doc__ or "").split("\n", 1)[0],
        epilog="Seeds from 10000 on are for a report, never looked at before; say which.",
    )
    parser.add_argument("cells", type=int, nargs="?", default=16, help="of all kinds together (16)")
    parser.add_argument("--kinds", default="one,two", help="of faults that are hidden, or an effect (one,two)")
    parser.add_argument("--by", nargs="*", choices=BY, default=BY, help="calibrate, diagnose (both)")
    parser.add_argument("--seed", type=int, default=0, help="of the first cell of each kind (0)")
    parser.add_argument("--minutes", type=float, default=60.0, help="after which no further cell is begun (60)")
    parser.add_argument("--keep", type=Path, help="a directory for cells and truths; what is there is used again")
    given = parser.parse_args()
    warnings.simplefilter("ignore")  # numpy's, of runs too short for a figure
    kinds, begin = given.kinds.split(","), time.monotonic()
    sizes: list[Size] = []
    with nullcontext(given.keep) if given.keep else tempfile.TemporaryDirectory(prefix="rig-sizes-") as root:
        for k in range(given.cells):
            if time.monotonic() - begin > 60 * given.minutes:
                print(f"stopped after {k} of {given.cells} cells")
                break
            job = Job(kinds[k % len(kinds)], given.seed + k // len(kinds), "", Path(root), "real")
            make_case(job)
            truth = json.loads(job.truth.read_text(encoding="utf-8"))
            for by in given.by:
                for one in sizes_of(job, by, truth):
                    sizes.append(one)
                    said = f"{one.true + one.error:.6g} ± {one.u:.2g}, true {one.true:.6g}"
                    print(f"{job}: {by} {one.name}: {said}, error/u {one.error / one.u:+.2f}", flush=True)
    print("\n".join(table(sizes)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
