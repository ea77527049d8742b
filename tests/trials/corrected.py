"""Corrected targets of arms of another generator: how far the real tool stands off, beside the uncertainty stated.

Each arm has hidden constants, soft joints and joint curves, multiplied out here and not by rig: sizes of a healthy arm
times a factor of 0.5 to 4, waves that do not close in a turn, and torques summed link by link. A tracker sees 400
poses, 60 of them twice; `rig import`, `rig calibrate` and `rig correct --path` do the rest, as a person would.
"""

from __future__ import annotations

import csv
import subprocess
import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.support.trial import Trial, main, markdown, seeds
from tests.worlds.arms.soft_arm import HIGH_DEG, LOW_DEG, Array, nominal, seen, wrong

POSES, TWICE, TARGETS = 400, 60, 200
OUTSIDE, SINGULAR = 10, 2
"""Targets, of all, with axis 1 outside the driven range, and at the singularity of the wrist."""
MARGIN_DEG = 3.0
"""Beyond the driven range up to which a target counts as covered, as docs/correct.md says."""
JOINTS = tuple(f"q{k}_deg" for k in range(1, 7))


def asked(rng: np.random.Generator) -> Array:
    """Joint angles (n, 6) rad of the targets, the last of them singular and outside."""
    q = rng.uniform(LOW_DEG, HIGH_DEG, (TARGETS, 6))
    for axis, value in ((2, 70.0), (4, 60.0)):
        near = np.abs(q[:, axis]) < 15
        q[near, axis] = value
    q[-OUTSIDE:, 0] = rng.uniform(150, 175, OUTSIDE)
    q[-OUTSIDE - SINGULAR : -OUTSIDE, 4] = 0.0
    return np.radians(q)


def write_table(path: Path, names: tuple[str, ...], rows: Array) -> None:
    """Write a table of rows (n, k)."""
    np.savetxt(path, rows, "%.9f", ",", header=",".join(names), comments="")


def rig(place: Path, *words: str, codes: tuple[int, ...] = (0,)) -> str:
    """Run a command of rig in a directory and return what it said; leave where it failed."""
    done = subprocess.run(["rig", *words], cwd=place, capture_output=True, text=True, check=False)
    if done.returncode not in codes:
        raise SystemExit(f"rig {' '.join(words)} in {place} ended with {done.returncode}:\n{done.stderr}")
    return done.stdout


@dataclass(frozen=True)
class Judged:
    """The targets of one arm that were corrected: the tool's error (n,) mm before and after, in the base of the robot
    and with frame and tool taught over the covered targets; u (n,) mm of both; whether stated as covered; how many
    marks of covered targets are wrong."""

    before: Array
    after: Array
    frame_before: Array
    frame_after: Array
    u: Array
    u_frame: Array
    covered: NDArray[np.bool_]
    wrong_marks: int


def draw(given: Namespace) -> Iterator[tuple[str, int, Path]]:
    work = given.work or Path(tempfile.mkdtemp(prefix="corrected-"))
    yield from ((given.arm, seed, work / f"{given.arm}-{seed}") for seed in seeds(given))


def judged(case: tuple[str, int, Path]) -> Judged:
    """Make an arm, let rig calibrate and correct it, and look where its tool stands."""
    name, seed, place = case
    rng = np.random.default_rng(seed)
    right = nominal(name)
    arm = wrong(right, rng)
    q, xyz = seen(arm, rng, POSES, TWICE)
    sent = asked(rng)
    place.mkdir(parents=True, exist_ok=True)
    if not (place / "cal.yaml").exists():  # kept from a run before
        write_table(place / "poses.csv", (*JOINTS, "x_mm", "y_mm", "z_mm"), np.hstack([np.degrees(q), xyz]))
        rig(place, "import", "poses.csv", "--rig", name, "--test", "pose", "-o", "run")
        rig(place, "calibrate", "run", "-o", "cal.yaml")
    write_table(place / "targets.csv", JOINTS, np.degrees(sent))
    out = tempfile.mkdtemp(prefix="corrected-", dir=place)
    said = rig(place, "correct", "cal.yaml", "--path", "targets.csv", "-o", out, codes=(0, 3))
    print(f"{place.name}: {' '.join(said.split('┃')[0].split())[:330]}", flush=True)
    with (Path(out) / "corrected-targets.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    done = np.array([row["corrected"] == "yes" for row in rows])
    marked = np.array([row["covered"] == "yes" for row in rows])
    told = np.radians(np.array([[float(row[name]) for name in JOINTS] for row in rows]))
    margin = np.radians(MARGIN_DEG)
    inside = ((told > q.min(axis=0) - margin) & (told < q.max(axis=0) + margin)).all(axis=1)
    wrong_marks = int((marked != (inside & done)).sum())
    wanted, was, stands = (one[done] for one in (right.tool_mm(sent), arm.tool_mm(sent), arm.tool_mm(told)))
    kept, turns = marked[done], right.frames(sent[done])[:, -1, :3, :3]
    u, u_frame = (
        np.array([float(row[column] or "nan") for row, good in zip(rows, done, strict=True) if good]) / 1e3
        for column in ("u_um", "u_frame_um")
    )
    return Judged(
        np.linalg.norm(was - wanted, axis=1),
        np.linalg.norm(stands - wanted, axis=1),
        as_taught(was, wanted, turns, kept),
        as_taught(stands, wanted, turns, kept),
        u,
        u_frame,
        kept,
        wrong_marks,
    )


def in_frame(places: Array, wanted: Array, kept: NDArray[np.bool_]) -> Array:
    """Return places (n, 3) mm after the rigid motion that brings those of `kept` (n,) closest to where they are
    wanted."""
    middle, goal = places[kept].mean(axis=0), wanted[kept].mean(axis=0)
    turn, _ = Rotation.align_vectors(wanted[kept] - goal, places[kept] - middle)
    return np.asarray(turn.apply(places - middle) + goal)


def as_taught(places: Array, wanted: Array, turns: Array, kept: NDArray[np.bool_]) -> Array:
    """Return how far (n,) mm places (n, 3) mm are off in the frame, and with the point of a flange turned by `turns`
    (n, 3, 3), that fit those of `kept` (n,) best: no run shows the last link apart from the target on the flange."""
    places = in_frame(places, wanted, kept)  # exact for a large turn, about which the rest is linear
    lever = (wanted - wanted[kept].mean(axis=0)) / 1e3
    turned = np.cross(np.eye(3)[None], lever[:, None]).transpose(0, 2, 1)
    columns = np.concatenate([np.tile(np.eye(3), (len(wanted), 1, 1)), turned, turns], axis=2)
    off = places - wanted
    found = np.linalg.lstsq(columns[kept].reshape(-1, 9), off[kept].ravel(), rcond=None)[0]
    return np.asarray(np.linalg.norm(off - columns @ found, axis=1))


def row(what: str, found: Sequence[Judged]) -> list[str]:
    """A row of the table: medians and shares over the covered targets of arms."""

    def over(name: str) -> Array:
        return np.concatenate([getattr(one, name)[one.covered] for one in found])

    parts = [what]
    for before, after, u in (("frame_before", "frame_after", "u_frame"), ("before", "after", "u")):
        ratio = over(after) / over(u)
        parts += [
            f"{1e3 * np.median(over(before)):.0f} → {1e3 * np.median(over(after)):.0f}",
            f"{1e3 * np.median(over(u)):.0f}",
            f"{100 * np.mean(ratio <= 2):.1f} %",
            f"{np.sqrt(np.mean(ratio**2)):.2f}",
        ]
    return [*parts, str(sum(one.wrong_marks for one in found))]


HEAD = (
    "covered targets, µm", "frame and tool taught: error", "u", "within 2 u", "rms of error/u", "base: error", "u",
    "within 2 u", "rms of error/u", "wrong marks",
)  # fmt: skip


def report(found: Sequence[Judged]) -> str:
    return markdown(HEAD, [*(row(f"arm {k}", [one]) for k, one in enumerate(found)), row("all", found)])


TRIAL = Trial(
    draw,
    judged,
    report,
    line=lambda one: "",
    count=8,
    options={
        "arm": ("ur10", "shipped rig file (ur10)"),
        "work": (Path, "directory for the runs; a calibration that is there is used again"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
