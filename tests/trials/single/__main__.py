"""Single effects of a UR10e in yaw alone, two laps each way: wrong names, listed rivals, faults too small to matter.

`scripts/dev single 60` hides 60 single effects in cells of `tests/worlds/unknown`, half of them gear errors of axis 6,
and counts wrong names, how often the truth is listed, and faults whose error is too small to matter. Then it simulates
and diagnoses the shipped example with seeds 1 to 20 by commands (`--example 20`): by yaw alone, and with roll, with
radial and with both (`--example-more 20`). With `--json FILE` each case is appended to FILE, and cases that stand in
FILE are not diagnosed again.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from tests.trials.unknown.rig_cli import RigFailedError, diagnose, import_tables, run_rig
from tests.worlds.unknown.files import write_cell
from tests.worlds.unknown.single import SingleCell, draw_single

SMALL_UM = 8.0
"""An error below this is nothing that anybody repairs: no fault."""
CERTAIN = 0.95
EXAMPLE_GEAR_DEG = 0.010
"""The shipped example hides a gear error of axis 6, order 2, of this amplitude (ur10e.effects.yaml)."""
MORE = ("roll", "radial", "roll+radial")
Row = dict[str, Any]


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="scripts/dev single",
        description="Diagnose single effects that yaw alone hardly separates; count wrong names and listed truths.",
    )
    parser.add_argument("cells", type=int, nargs="?", default=60, help="cells to draw (60)")
    parser.add_argument("--seed", type=int, default=0, help="of the first cell; the others follow (0)")
    parser.add_argument("--example", type=int, default=20, help="seeds of the shipped example by yaw alone (20)")
    parser.add_argument("--example-more", type=int, default=20, help="of these, seeds with roll or radial too (20)")
    parser.add_argument("--json", type=Path, help="append each case to this file; finished cases are read from it")
    return parser.parse_args()


def main() -> None:
    given = arguments()
    rows: list[Row] = []
    jobs: list[tuple[str, Callable[[Path], Row]]] = [
        (f"cell {seed}", lambda scratch, seed=seed: judged_cell(draw_single(seed), scratch))  # type: ignore[misc]
        for seed in range(given.seed, given.seed + given.cells)
    ]
    for more, count in (("", given.example), *((more, given.example_more) for more in MORE)):
        for seed in range(1, count + 1):
            name = f"example {seed}" + f" with {more}" * bool(more)
            jobs.append((name, lambda scratch, seed=seed, more=more: example(seed, more, scratch)))  # type: ignore[misc]
    try:
        for row in streamed(jobs, given.json):
            rows.append(row)
            print(row_text(row), flush=True)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
    print(counts_text(rows))


def streamed(jobs: Sequence[tuple[str, Callable[[Path], Row]]], file: Path | None) -> Iterator[Row]:
    """Yield the row of each job: from the file if it is there, else made and appended to it."""
    known: dict[str, Row] = {}
    if file and file.exists():
        known = {row["job"]: row for row in map(json.loads, file.read_text(encoding="utf-8").splitlines())}
    for name, make in jobs:
        row = known.get(name)
        if row is None:
            with tempfile.TemporaryDirectory() as scratch:
                try:
                    row = make(Path(scratch))
                except RigFailedError as error:
                    row = {"error": str(error)}
            row = {"job": name} | row
            if file:
                with file.open("a", encoding="utf-8") as out:
                    out.write(json.dumps(row) + "\n")
        yield row


# --- answers


def name_of(effect: Mapping[str, Any]) -> str:
    """Return the name of an effect or of a rival with its place: `wrist_coupling 4>6`, `gauge_scale g1`."""
    what = str(effect.get("effect", effect.get("name", "?")))
    if effect.get("from_axis") is not None:
        return f"{what} {effect['from_axis']}>{effect['to_axis']}"
    place = effect.get("gauge") if effect.get("gauge") is not None else effect.get("axis")
    field = f".{effect['field']}" if effect.get("field") else ""
    return what if place is None else f"{what} {place}{field}"


def odds(answer: Mapping[str, Any]) -> dict[str, float]:
    """Return the highest odds of each name among effects, their twins and their rivals."""
    found: dict[str, float] = {}
    for effect in answer.get("effects") or []:
        twins = [twin if isinstance(twin, str) else name_of(twin) for twin in effect.get("twins") or []]
        for name in (name_of(effect), *twins):
            found[name] = max(found.get(name, 0.0), float(effect.get("posterior") or 0.0))
        for rival in effect.get("rivals") or []:
            found[name_of(rival)] = max(found.get(name_of(rival), 0.0), float(rival.get("posterior") or 0.0))
    return found


def certain(answer: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the effects with odds of at least 95 %, and the faults of an answer that is called named."""
    named = answer.get("condition") == "named"
    return [
        effect
        for effect in answer.get("effects") or []
        if (named and effect.get("stands")) or float(effect.get("posterior") or 0.0) >= CERTAIN
    ]


def _has(effect: Mapping[str, Any], name: str) -> bool:
    twins = [twin if isinstance(twin, str) else name_of(twin) for twin in effect.get("twins") or []]
    return name in (name_of(effect), *twins)


def _words(effect: Mapping[str, Any]) -> str:
    state = "fault" if effect.get("stands") else str(effect.get("doubt"))
    worth = float(effect.get("worth_um") or 0.0)
    return f"{name_of(effect)} ({100 * float(effect.get('posterior') or 0):.1f} %, {state}, {worth:.1f} µm)"


def judged_cell(single: SingleCell, directory: Path) -> Row:
    """Diagnose a cell and judge its names."""
    runs = import_tables(write_cell(single.cell, directory), directory / "cell.yaml", directory / "runs")
    answer = diagnose(runs)
    names, sure = odds(answer), certain(answer)
    faults = [effect for effect in answer.get("effects") or [] if effect.get("stands")]
    return {
        "name": single.name,
        "size": single.size,
        "order": single.order,
        "worth_um": round(single.worth_um, 2),
        "condition": answer["condition"],
        "wrong": [_words(effect) for effect in sure if not _has(effect, single.name)],
        "wrong_faults": [_words(effect) for effect in faults if not _has(effect, single.name)],
        "named": any(_has(effect, single.name) for effect in sure),
        "listed": names.get(single.name),
        "small_fault": bool(faults) and single.worth_um < SMALL_UM,
        "cpu_s": answer["cpu_s"],
    }


def example(seed: int, more: str, directory: Path) -> Row:
    """Simulate and diagnose the shipped example by commands, by yaw and more tests."""
    tests = ("yaw", *(test for test in more.split("+") if test))
    run_rig("example", directory / "try")
    rig_file = directory / "try" / "ur10e.yaml"
    for test in tests:
        run_rig("simulate", rig_file, "--test", test, "--seed", str(seed), "--effects", "ur10e", "-o", directory / test)
    runs = [run for test in tests for run in _runs_in(directory / test)]
    answer = diagnose(runs)
    names = odds(answer)
    gear = next((e for e in answer["effects"] if _has(e, "transmission_error 6")), None)
    size = (gear or {}).get("parameters", {}).get("amplitude_deg", {})
    value, u = size.get("value"), size.get("sd")
    return {
        "condition": answer["condition"],
        "faults": [_words(effect) for effect in answer["effects"] if effect.get("stands")],
        "ball_form": names.get("ball_form", 0.0),
        "gear": names.get("transmission_error 6", 0.0),
        "gear_named": gear is not None,
        "gear_deg": value,
        "gear_within": bool(value and u and abs(value - EXAMPLE_GEAR_DEG) <= 2 * u),
        "cpu_s": answer["cpu_s"],
    }


def _runs_in(directory: Path) -> list[Path]:
    """Return the run directories in what `rig simulate` wrote: one run, or a run each way."""
    return [directory] if (directory / "manifest.json").exists() else sorted(directory.iterdir())


# --- what is printed


def row_text(row: Row) -> str:
    """Return the line of one case."""
    if "error" in row:
        return f"{row['job']}: ERROR {row['error']}"
    if row["job"].startswith("example"):
        size = f"{row['gear_deg']:.4f}°" if row["gear_deg"] else "not named"
        return (
            f"{row['job']}: {row['condition']}; ball's form {100 * row['ball_form']:.1f} %, gear error of axis 6 "
            f"{100 * row['gear']:.1f} % ({size}); faults: {', '.join(row['faults']) or 'none'}; "
            f"{row['cpu_s']:.1f} s"
        )
    listed = "not listed" if row["listed"] is None else f"listed with {100 * row['listed']:.1f} %"
    order = f" order {row['order']}" if row["order"] else ""
    words = [
        f"{row['job']}: {row['name']}{order}, {row['size']:.4g}, worth {row['worth_um']:.1f} µm: {row['condition']}"
    ]
    words += [f"truth {listed}", *(f"WRONG {one}" for one in row["wrong"])]
    words += ["fault for a small error"] * row["small_fault"] + [f"{row['cpu_s']:.1f} s"]
    return "; ".join(words)


def counts_text(rows: Sequence[Row]) -> str:
    """Return the counts of cells by effect, and of the example."""
    fine = [row for row in rows if "error" not in row]
    cells = [row for row in fine if row["job"].startswith("cell")]
    lines = ["", "| hidden | cells | wrong name | wrong fault | truth certain | truth listed | fault below 8 µm |"]
    lines.append("| --- | --- | --- | --- | --- | --- | --- |")
    kinds = list(dict.fromkeys(row["name"].split()[0] for row in cells))
    for kind in (*kinds, "all"):
        some = [row for row in cells if kind in ("all", row["name"].split()[0])]
        small = sum(row["worth_um"] < SMALL_UM for row in some)
        counts = [sum(bool(row[key]) for row in some) for key in ("wrong", "wrong_faults", "named")]
        listed = sum(row["listed"] is not None for row in some)
        line = [kind, len(some), *counts, listed, f"{sum(row['small_fault'] for row in some)} of {small}"]
        lines.append("| " + " | ".join(map(str, line)) + " |")
    for more in ("", *MORE):
        some = [row for row in fine if row["job"].startswith("example") and row["job"].partition(" with ")[2] == more]
        if some:
            over = sum(row["ball_form"] > 0.5 for row in some)
            lines.append(
                f"example by yaw{f' and {more}' if more else ' alone'}, {len(some)} seeds: ball's form above 50 % in "
                f"{over}, a fault in {sum(bool(row['faults']) for row in some)}; gear error of axis 6 listed in "
                f"{sum(row['gear'] > 0 for row in some)}, named in {sum(row['gear_named'] for row in some)}, "
                f"within 2 u in {sum(row['gear_within'] for row in some)}"
            )
    times = sorted(row["cpu_s"] for row in fine)
    if times:
        lines.append(f"processor time of a diagnosis: median {median(times):.1f} s, most {times[-1]:.1f} s")
    errors = len(rows) - len(fine)
    return "\n".join([*lines, f"{errors} ended in an error; goals: 1 wrong name of 60, ball's form never above 50 %"])


if __name__ == "__main__":
    main()
