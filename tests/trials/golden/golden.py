"""Golden answers: what `rig` said of some forty runs and cells, kept as JSON, and what has changed in it since.

A case makes its runs in a directory of its own and lists the commands that are called there. What they print is
normalised: no paths, no times, six significant digits, and of long rows of numbers four that tell any change. Each run
is made anew from a seed, by generators that share no code with the product wherever there is one; poses of real arms
are read from where they lie, and left out where they are not.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from analysis.procedures.simulate import simulated_run
from rigs.effects import VOCABULARY
from rigs.load import load
from rigs.schema.vocabulary import Direction, TestName
from tests.support.command_line import ran
from tests.support.measured_series import DATA, UR5, jacobi, ur10
from tests.support.shipped_cells import cell_name
from tests.support.store_cases import edit_manifest
from tests.support.written_runs import import_table, write_simulated
from tests.trials.blind.trial import Job, make_case, runs_of
from tests.worlds.arms import independent_arm

ROOT = Path(__file__).parents[3]
KEPT = ROOT / "tests" / "golden"
BEGAN = datetime(2026, 5, 1, 9, tzinfo=UTC)
DIGITS = 6
SAME_OF_U, SAME = 0.05, 1e-3
"""What another processor may make of a figure: a twentieth of its u, a thousandth of one without."""
NOTHING = 1e-11
"""Figures below are rounding alone, which differs from computer to computer."""
WIDTH = 160
"""Of a line of a golden file."""
LONG = 24
"""A longer row of numbers is kept as its digest."""
_LEFT_OUT = ("seconds", "blocks")
"""Keys that differ from run to run, and words, which the catalogue of texts holds."""
_WORST = 10
"""Places of disagreement that are kept, the worst first."""


Make = Callable[[Path, Path], bool]
"""Puts runs into a directory; it is given that and the folder of measured data, and returns whether the data were
there."""


@dataclass(frozen=True)
class Case:
    """Commands, each a line after `rig`, called in a directory in which `make` has put runs. quick: one of those the
    tests make."""

    name: str
    make: Make
    commands: tuple[str, ...]
    quick: bool = False


@dataclass(frozen=True)
class Change:
    """A changed figure or text: path, old and new value, and size of the change in uncertainties or, if there is none,
    relative; inf for texts.
    """

    where: str
    before: Any
    now: Any
    size: float
    of_u: bool

    @property
    def is_of_processor(self) -> bool:
        """Whether another processor, which rounds differently, may cause it."""
        return self.size <= (SAME_OF_U if self.of_u else SAME)

    def __str__(self) -> str:
        if math.isinf(self.size):
            return f"{self.where}: {self.before!r:.120} → {self.now!r:.120}"
        return f"{self.where}: {self.before} → {self.now} ({self.size:.2g}{' u' if self.of_u else ' of it'})"


def made(case: Case, directory: Path, data: Path = DATA) -> dict[str, Any] | None:
    """Normalised output of all commands of a case; None if the data are missing."""
    directory.mkdir(parents=True)
    if not case.make(directory, data):
        return None
    _date(directory)
    said = {}
    for line in case.commands:
        words = [word for part in line.split() for word in _spread(part, directory)]
        done = ran(*words, "--json", cwd=directory)
        try:
            answer = json.loads(done.stdout)
        except ValueError:
            raise SystemExit(f"{case.name}: rig {line} ended with {done.returncode}: {done.stderr}") from None
        said[line] = {"exit": done.returncode} | normal(answer, directory)
    return said


def normal(value: Any, directory: Path) -> Any:
    """JSON without paths and times, figures to six digits, long rows of numbers as their digest."""
    if isinstance(value, dict):
        value = value | ({"where": value["where"][:_WORST]} if isinstance(value.get("where"), list) else {})
        return {key: normal(one, directory) for key, one in value.items() if key not in _LEFT_OUT}
    if isinstance(value, list):
        if len(value) > LONG and all(isinstance(one, int | float) for one in value):
            return digest(np.array(value, dtype=float))
        return [normal(one, directory) for one in value]
    if isinstance(value, float):
        return rounded(value)
    if isinstance(value, str):
        return value.replace(f"{directory}/", "").replace(str(directory), ".")
    return value


def rounded(value: float) -> float:
    """A figure as it is kept."""
    return 0.0 if abs(value) < NOTHING else float(f"{value:.{DIGITS}g}")


def digest(row: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, float]:
    """Four numbers of a row, by which any change of it, and any exchange in it, shows."""
    mixed = np.mean(row * np.cos(np.arange(len(row))))
    told = {"mean": np.mean(row), "rms": np.sqrt(np.mean(row**2)), "mixed": mixed}
    return {"length": len(row)} | {key: rounded(float(one)) for key, one in told.items()}


def changes(before: Any, now: Any, where: str = "", beside: Mapping[str, Any] | None = None) -> Iterator[Change]:
    """Every leaf that differs; beside: the object that holds this one, in which its uncertainty is looked for."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in sorted({*before, *now}, key=[*before, *now].index):
            if key in before and key in now:
                yield from changes(before[key], now[key], f"{where}.{key}" if where else key, before)
            else:
                yield Change(f"{where}.{key}", before.get(key, "(nothing)"), now.get(key, "(nothing)"), math.inf, False)
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for name, old, new in _paired(before, now):
            yield from changes(old, new, f"{where}[{name}]", beside)
    elif before != now:
        yield _change(where, before, now, beside or {})


def _paired(before: Sequence[Any], now: Sequence[Any]) -> list[tuple[Any, Any, Any]]:
    """The items of two lists, by name if both have the same: parts of equal size may be sorted either way."""
    old, new = (sorted(range(len(each)), key=lambda k, each=each: (_label(each[k]), k)) for each in (before, now))
    if [_label(before[k]) for k in old] != [_label(now[k]) for k in new]:
        old = new = list(range(len(before)))
    pairs = sorted(zip(old, new, strict=True))
    return [(_label(before[k]) or k, before[k], now[other]) for k, other in pairs]


def _label(item: Any) -> str:
    keys = ("name", "first", "second") if isinstance(item, dict) else ()
    return " ".join(str(item[key]) for key in keys if item.get(key)) or (item.get("kind", "") if keys else "")


def _change(where: str, before: Any, now: Any, beside: Mapping[str, Any]) -> Change:
    if not all(isinstance(one, int | float) and not isinstance(one, bool) for one in (before, now)):
        return Change(where, before, now, math.inf, False)
    key = where.rsplit(".", 1)[-1]
    unit = key.rsplit("_", 1)[-1]
    for name in ("u", "sd", f"u_{key}", f"{key}_u", f"u_{unit}"):
        u = beside.get(name)
        if name != key and isinstance(u, int | float) and u > 0:
            return Change(where, before, now, abs(now - before) / u, True)
    return Change(where, before, now, abs(now - before) / max(abs(before), abs(now)), False)


def file_of(case: Case) -> Path:
    return KEPT / f"{case.name}.json"


def kept(case: Case) -> Any:
    """The golden answer of a case."""
    return json.loads(file_of(case).read_text(encoding="utf-8"))


def keep(case: Case, said: Mapping[str, Any]) -> None:
    """Store the output of a case as its golden answer."""
    KEPT.mkdir(exist_ok=True)
    file_of(case).write_text(as_text(said) + "\n", encoding="utf-8")


def as_text(value: Any, margin: str = "") -> str:
    """JSON in lines that a person and git compare: an object or a list that fits into a line stands in one."""
    line = json.dumps(value, ensure_ascii=False)
    if not isinstance(value, dict | list) or len(margin) + len(line) <= WIDTH:
        return line
    inner = f"{margin} "
    if isinstance(value, dict):
        parts = [f"{inner}{json.dumps(key)}: {as_text(one, inner)}" for key, one in value.items()]
        return "{\n" + ",\n".join(parts) + f"\n{margin}}}"
    return "[\n" + ",\n".join(inner + as_text(one, inner) for one in value) + f"\n{margin}]"


def _spread(word: str, directory: Path) -> list[str]:
    """A word of a command; runs/* as a shell would spread it."""
    if "*" not in word:
        return [word]
    return sorted(str(path.relative_to(directory)) for path in directory.glob(word))


def _date(directory: Path) -> None:
    """Runs count as measured a day apart, in the order of their names."""
    for day, manifest in enumerate(sorted(directory.glob("*/*/manifest.json"))):
        edit_manifest(manifest.parent, {"started": (BEGAN + timedelta(days=day)).isoformat()})


def _simulated(
    rig_name: str, effects: Sequence[Mapping[str, Any]], *tests: tuple[TestName, Direction | None, int]
) -> Make:
    """Runs of rig's own simulator: a test, a direction and the seed of its noise each."""

    def make(directory: Path, data: Path) -> bool:
        rig, text = load(cell_name(rig_name))
        hidden = [VOCABULARY[one["effect"]].model_validate(one) for one in effects]
        for test, direction, seed in tests:
            list(write_simulated(rig, text, test, [direction], [seed], directory / "runs", hidden))
        return True

    return make


def _growing(directory: Path, data: Path) -> bool:
    """Eight yaw runs of a robot whose play doubles after the fourth."""
    from analysis import save_run  # noqa: PLC0415

    rig, text = load("ur10e-cell")
    for day in range(8):
        play = VOCABULARY["backlash"].model_validate({"axis": 3, "width_deg": 0.01 if day < 4 else 0.02})
        save_run(simulated_run(rig, text, "yaw", "acw", day, [play]), directory / "runs" / f"lap-{day}")
    return True


def _stranger(kind: str, seed: int, kinds: str) -> Make:
    """Of a cell of the blind trial the first run of each test and direction that `kinds` names, as yaw-cw or radial;
    runs left out and of the unseen place as they are."""

    def make(directory: Path, data: Path) -> bool:
        job = Job(kind, seed, directory / "blind")
        make_case(job)
        runs = runs_of(job.case)
        for one in kinds.split():
            first = next((path for path in runs["train"] if path.name[3:] == one), None)
            if first is not None:
                _move(first, directory / "runs" / one)
        for use in ("held_out", "unseen"):
            for path in runs[use]:
                _move(path, directory / use / path.name[3:])
        return True

    return make


def _move(path: Path, to: Path) -> None:
    to.parent.mkdir(exist_ok=True)
    if not to.exists():
        path.rename(to)


def _tracked(name: str, wrong: str, seed: int, count: int) -> Make:
    """Poses of a tracker before an arm of the independent generator, a twentieth of them wild where it is bad."""

    def make(directory: Path, data: Path) -> bool:
        rng = np.random.default_rng(seed)
        cell = independent_arm.cell(name, getattr(independent_arm, wrong)(rng), rng)
        for run, poses in (("used", count), ("left", count // 3)):
            seen = cell.seen(independent_arm.postures(name, poses, rng), rng, wild=0.05 * (wrong == "bad_arm"))
            _import_poses(directory, run, np.degrees(seen.q), seen.xyz_mm, name)
        return True

    return make


def _import_poses(directory: Path, run: str, q_deg: Any, xyz_mm: Any, rig: str) -> None:
    names = [*(f"q{k}_deg" for k in range(1, 7)), "x_mm", "y_mm", "z_mm"]
    table = directory / f"{run}.csv"
    np.savetxt(table, np.hstack([q_deg, xyz_mm]), "%.9f", ",", header=",".join(names), comments="")
    (directory / "runs").mkdir(exist_ok=True)
    import_table(table, directory / "runs" / run, rig_file=cell_name(rig), test="pose", operator="golden")


def _ur10(series: str, every: int) -> Make:
    """Every so manieth pose of a series of the real UR10, and others between them to judge by."""

    def make(directory: Path, data: Path) -> bool:
        file = data / "ipa-ur10" / f"series_{series}.csv"
        if not file.is_file():
            return False
        q, xyz = ur10(file)
        for run, first in (("used", 0), ("left", every // 2)):
            _import_poses(directory, run, np.degrees(q[first::every]), xyz[first::every], "ur10")
        return True

    return make


def _ur5(directory: Path, data: Path) -> bool:
    return import_ur5(directory, data, np.zeros(3))


def import_ur5(directory: Path, data: Path, off_mm: Any) -> bool:
    """Every tenth pose of the grid of the real UR5 as the run `used`, and its random poses, whose places are off by
    `off_mm` (3,) or (20, 3), as `left`; False where the data are not there."""
    if not (data / "jacobi" / "ur5_grid.csv").is_file():
        return False
    rig = yaml.safe_load(load("ur10-cell")[1]) | {"name": "ur5"}
    for key, values in UR5.items():
        for axis, value in zip(rig["robot"]["axes"], values, strict=True):
            axis[key] = value
    (directory / "ur5.yaml").write_text(yaml.safe_dump(rig, sort_keys=False), encoding="utf-8")
    for run, name, every in (("used", "grid", 10), ("left", "random", 1)):
        q, xyz = (one[::every] for one in jacobi(data / "jacobi" / f"ur5_{name}.csv"))
        xyz = xyz.copy()
        xyz += off_mm if run == "left" else 0.0
        _import_poses(directory, run, np.degrees(q), xyz, str(directory / "ur5.yaml"))
    return True


def _nothing(directory: Path, data: Path) -> bool:
    return True


BOTH: tuple[Direction, Direction] = ("acw", "cw")
_PLAY = {"effect": "backlash", "axis": 1, "width_deg": 0.02}
_GEAR = {"effect": "transmission_error", "axis": 4, "order": 8, "amplitude_deg": 0.01, "phase_deg": 30}
_SOFT = {"effect": "compliance", "axis": 2, "deg_per_Nm": 0.0003}
_YAW = tuple(("yaw", way, 1) for way in BOTH)
_ROLL = tuple(("roll", way, 10) for way in BOTH)
_LOOK = ("analyse runs/*", "diagnose runs/*")
_JUDGED = ("analyse runs/*", "diagnose runs/used --hold-out runs/left")
_DH = "calibrate runs/used --hold-out runs/left --fit joint_offset,link_geometry"
_LAPS = "yaw-cw yaw-acw roll-acw roll-cw radial"

CASES = (
    Case("yaw-lap", _simulated("ur10e", [_PLAY], *_YAW), (*_LOOK, "calibrate runs/* --fit backlash:1")),
    Case("yaw-one-way", _simulated("paper-fanuc", [_GEAR], ("yaw", "acw", 3)), _LOOK, quick=True),
    Case("yaw-healthy", _simulated("paper-fanuc", [], *_YAW), (*_LOOK, "compare runs/*")),
    Case("yaw-repeats", _simulated("ur10e", [_GEAR], *_YAW, *(("yaw", way, 2) for way in BOTH)), _LOOK),
    Case("roll-lap", _simulated("ur10e", [_SOFT], *_ROLL), (*_LOOK, "calibrate runs/* --fit compliance:2")),
    Case("roll-gear", _simulated("paper-fanuc", [_GEAR, _PLAY], *_ROLL), _LOOK),
    Case("yaw-and-roll", _simulated("paper-fanuc", [_PLAY, _SOFT], *_YAW, *_ROLL), (*_LOOK, "compare runs/*")),
    Case("radial", _simulated("ur10e", [_PLAY], ("radial", None, 20)), (*_LOOK, "calibrate runs/*", "compare runs/*")),
    Case("repeatability", _simulated("ur10e", [_PLAY], ("repeatability", None, 20)), _LOOK, quick=True),
    Case(
        "all-tests",
        _simulated("ur10e", [_PLAY, _GEAR], *_YAW, *_ROLL, ("radial", None, 20), ("repeatability", None, 21)),
        ("analyse runs/*", "calibrate runs/* --fit backlash"),
    ),
    Case("poses-healthy-fanuc", _tracked("paper-fanuc", "healthy", 1, 60), (*_JUDGED, _DH)),
    Case("poses-zeros-ur10e", _tracked("ur10e", "bad_zeros", 2, 60), (*_JUDGED, _DH)),
    Case("poses-bad-fanuc", _tracked("paper-fanuc", "bad_arm", 3, 50), (*_JUDGED, _DH)),
    Case("poses-bad-ur10e", _tracked("ur10e", "bad_arm", 4, 50), (*_JUDGED, "compare runs/used")),
    Case("poses-few", _tracked("ur10e", "bad_zeros", 5, 24), ("analyse runs/*", "diagnose runs/used")),
    Case("ur10-b", _ur10("b", 24), (*_JUDGED, _DH)),
    Case("ur10-d", _ur10("d", 10), _JUDGED),
    Case("ur5-grid", _ur5, (*_JUDGED, _DH)),
    *(Case(f"real-{kind}", _stranger(kind, 2, laps), _LOOK)
      for kind, laps in (("healthy", "yaw-cw yaw-acw radial"), ("one_large", _LAPS),
                         ("foreign_large", "roll-cw roll-acw repeatability"), ("dirty", "yaw-cw roll-acw radial"))),
    Case("history", _growing, ("history ur10e --runs runs",), quick=True),
    Case("plan-yaw", _nothing, ("plan ur10e-cell --tests yaw --runs 1",)),
    Case("plan-targets", _nothing, ("plan paper-fanuc --tests radial,repeatability --runs 2",)),
    Case("plan-propose", _nothing, ("plan ur10e-cell --tests yaw,radial --runs 1 --propose --minutes 20",)),
)  # fmt: skip
