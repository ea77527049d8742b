"""Corrected targets of arms of another generator: how far the real tool stands off, beside the uncertainty stated.

Each arm has hidden constants, soft joints and joint curves, multiplied out here and not by rig: sizes of a healthy arm
times a factor of 0.5 to 4, waves that do not close in a turn, and torques summed link by link. A tracker sees 400
poses, 60 of them twice; `rig import`, `rig calibrate` and `rig correct --path` do the rest, as a person would.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
RIGS = Path(__file__).parents[1] / "rigs"
LOW_DEG, HIGH_DEG = (-120, -130, -120, -150, -100, -170), (120, -20, 120, 150, 100, 170)
POSES, TWICE, TARGETS = 400, 60, 200
OUTSIDE, SINGULAR = 10, 2
"""Targets, of all, with axis 1 outside the driven range, and at the singularity of the wrist."""
MARGIN_DEG = 3.0
"""Beyond the driven range up to which a target counts as covered, as docs/plan-and-correct.md says."""
NOISE_MM = 0.02
WAVES = 24
LENGTH_MM, ANGLE_DEG, WAVE_DEG = 0.2, 0.02, 0.005
SOFT_DEG_NM = (5e-5, 5e-5, 5e-5, 3e-4, 3e-4, 3e-4)
"""What a healthy arm shows."""
G = np.array([0.0, 0.0, -9.81])
JOINTS = tuple(f"q{k}_deg" for k in range(1, 7))


@dataclass(frozen=True)
class Arm:
    """Constants (6,) in mm and rad, tool (3,) mm, masses (7,) kg with centres (7, 3) mm in the frames of the links and,
    last, of the flange; compliance (6,) rad/Nm; waves of joints: amplitude, order and phase (6, w), rad."""

    a: Array
    alpha: Array
    beta: Array
    d: Array
    offset: Array
    tool: Array
    mass: Array
    centre: Array
    soft: Array
    wave: tuple[Array, Array, Array]

    def frames(self, q: Array) -> Array:
        """Return the frames (n, 6, 4, 4) of the links at joint angles q (n, 6) rad: modified Denavit-Hartenberg."""
        T, found = np.tile(np.eye(4), (len(q), 1, 1)), []
        for k in range(6):
            turn = Rotation.from_euler("x", self.alpha[k]) * Rotation.from_euler("y", self.beta[k])
            link = np.eye(4)
            link[:3, :3], link[0, 3] = turn.as_matrix(), self.a[k]
            screw = np.tile(np.eye(4), (len(q), 1, 1))
            screw[:, :3, :3] = Rotation.from_rotvec((q[:, k, None] + self.offset[k]) * [0, 0, 1]).as_matrix()
            screw[:, 2, 3] = self.d[k]
            T = T @ link @ screw
            found.append(T)
        return np.stack(found, axis=1)

    def tool_mm(self, q: Array, point: Array | None = None) -> Array:
        """Return where the tool, or another point (3,) mm of the flange, stands (n, 3) mm at commanded angles q (n, 6)
        rad."""
        amplitude, order, phase = self.wave
        link = q + (amplitude * np.sin(order * q[:, :, None] + phase)).sum(axis=2)
        link = link + self.soft * self._torques(link)
        T = self.frames(link)[:, -1]
        return np.asarray(T[:, :3, :3] @ (self.tool if point is None else point) + T[:, :3, 3])

    def _torques(self, q: Array) -> Array:
        """Return the torques (n, 6) Nm by which gravity turns each joint at joint angles q (n, 6) rad."""
        T = self.frames(q)
        hung = np.concatenate([T, T[:, -1:]], axis=1)
        centres = np.einsum("nkij,kj->nki", hung[:, :, :3, :3], self.centre) + hung[:, :, :3, 3]
        torques = np.zeros((len(q), 6))
        for k in range(6):
            arms_m = (centres[:, k:] - T[:, k, None, :3, 3]) / 1e3
            moments = np.cross(arms_m, self.mass[k:, None] * G).sum(axis=1)
            torques[:, k] = (T[:, k, :3, 2] * moments).sum(axis=1)
        return torques


def nominal(name: str) -> Arm:
    """Return the arm of a shipped rig file."""
    robot = yaml.safe_load((RIGS / f"{name}.yaml").read_text(encoding="utf-8"))["robot"]

    def of(key: str) -> Array:
        return np.array([axis.get(key, 0.0) for axis in robot["axes"]], dtype=float)

    centre = np.array([axis.get("centre_mm", [0, 0, 0]) for axis in robot["axes"]] + [[0, 0, 0]], dtype=float)
    mass = np.append(of("mass_kg"), robot.get("payload_kg", 0.0))
    nothing = np.zeros(6)
    return Arm(
        of("a_mm"),
        np.radians(of("alpha_deg")),
        nothing,
        of("d_mm"),
        np.radians(of("offset_deg")),
        np.array(robot["tool"]["xyz_mm"], dtype=float),
        mass,
        centre,
        nothing,
        (np.zeros((6, 1)), np.ones((6, 1)), np.zeros((6, 1))),
    )


def wrong(arm: Arm, rng: np.random.Generator) -> Arm:
    """Return the arm as it might be: everything off by what a healthy arm shows, times 0.5 to 4."""

    def off(size: float | Array) -> Array:
        return np.asarray(rng.normal(0, 1, 6) * size * np.exp(rng.uniform(np.log(0.5), np.log(4), 6)))

    parallel = np.abs(np.sin(arm.alpha)) < 1e-3
    parallel[0] = False  # before axis 1 a twist either way turns the whole arm: one of them is enough
    k = np.arange(1, WAVES + 1)
    fall = k ** -rng.uniform(0.6, 1.5, (6, 1))
    amplitude = np.radians(np.abs(off(WAVE_DEG)))[:, None] * fall
    order = k + rng.uniform(-0.4, 0.4, (6, WAVES))
    return Arm(
        arm.a + off(LENGTH_MM),
        arm.alpha + np.radians(off(ANGLE_DEG)),
        np.radians(off(ANGLE_DEG)) * parallel,
        arm.d + off(LENGTH_MM),
        arm.offset + np.radians(off(ANGLE_DEG)),
        arm.tool,
        arm.mass * rng.uniform(0.9, 1.1, 7),
        arm.centre + rng.normal(0, 10, (7, 3)),
        np.radians(np.abs(off(np.array(SOFT_DEG_NM)))),
        (amplitude, order, rng.uniform(0, 2 * np.pi, (6, WAVES))),
    )


def seen(arm: Arm, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the joint angles (n, 6) rad of poses, and where a tracker saw its target (n, 3) mm."""
    q = np.radians(rng.uniform(LOW_DEG, HIGH_DEG, (POSES, 6)))
    q = np.concatenate([q, q[:TWICE]])
    turn = Rotation.from_euler("xyz", [rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), rng.uniform(-3, 3)])
    places = arm.tool_mm(q, rng.uniform([-60, -60, 40], [60, 60, 120]))
    return q, turn.apply(places) + rng.uniform(-3000, 3000, 3) + rng.normal(0, NOISE_MM, (len(q), 3))


def asked(rng: np.random.Generator) -> Array:
    """Return the joint angles (n, 6) rad of the targets, the last of them singular and outside."""
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


def judged(name: str, seed: int, place: Path) -> Judged:
    """Make an arm, let rig calibrate and correct it, and look where its tool stands."""
    rng = np.random.default_rng(seed)
    right = nominal(name)
    arm = wrong(right, rng)
    q, xyz = seen(arm, rng)
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
        np.array([float(row[column]) for row, good in zip(rows, done, strict=True) if good]) / 1e3
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


def row(what: str, found: list[Judged]) -> str:
    """Return a row of the table: medians and shares over the covered targets of arms."""

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
    return f"| {' | '.join(parts)} | {sum(one.wrong_marks for one in found)} |"


def main() -> int:
    """Run the arms and print the table."""
    parser = argparse.ArgumentParser(prog="scripts/dev corrected", description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("count", type=int, nargs="?", default=8, help="arms (8)")
    parser.add_argument("--first", type=int, default=0, help="the first seed (0)")
    parser.add_argument("--arm", default="ur10", help="shipped rig file (ur10)")
    parser.add_argument("--work", type=Path, help="directory for the runs; a calibration that is there is used again")
    given = parser.parse_args()
    work = given.work or Path(tempfile.mkdtemp(prefix="corrected-"))
    found = []
    lines = []
    for seed in range(given.first, given.first + given.count):
        found.append(judged(given.arm, seed, work / f"{given.arm}-{seed}"))
        lines.append(row(f"{given.arm}, seed {seed}", found[-1:]))
    print("| covered targets, µm | frame and tool taught: error | u | within 2 u | rms of error/u "
          "| base: error | u | within 2 u | rms of error/u | wrong marks |")  # fmt: skip
    print("|" + " --- |" * 10)
    print("\n".join([*lines, row("all", found)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
