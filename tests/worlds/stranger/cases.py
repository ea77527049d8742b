"""A case: hidden effects, and the runs measured with them.

`case-0001/` contains `rig.yaml` (without effects), `unseen.yaml` (the same cell with a different circle), a CSV table
per run, and `runs.csv` with the description of each table. The truth is written to `case-0001.json` in a different
directory. Kind and seed determine everything.
"""

from __future__ import annotations

import csv
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.worlds.stranger.cell import ROBOTS, Cell, Place, moved
from tests.worlds.stranger.draw import DENSE, HAS_FORM, Foreign, Hidden, background, hide, hide_foreign
from tests.worlds.stranger.faults import SIZE, Fault
from tests.worlds.stranger.gauges import Link
from tests.worlds.stranger.measure import measure
from tests.worlds.stranger.motion import Motion, Track, lap, track_of, visits
from tests.worlds.stranger.noise import Noise, added, drawn_noise, stamps
from tests.worlds.stranger.reach import OutOfReachError
from tests.worlds.stranger.screws import Array
from tests.worlds.stranger.sight import REPEATS, Scales, Sight, sight_of
from tests.worlds.stranger.tables import write_table

KINDS = ("none", "one", "two", "three", "wrong_form", "dense", "outside")
SCATTERED = 0.1
SCALES = ("limits", "tolerance")
"""Scale of the background. `limits`: size visible at SNR 7, or the healthy size if smaller; hidden effects have SNR
7 … 60. `tolerance`: healthy size; hidden effects are 3 … 15 times larger.
"""


@dataclass(frozen=True)
class Lap:
    """A noise-free lap: t_s (m,), q (m, 6) rad, change by faults (m, 2) mm, and changes by the set-up (2 m, 5)."""

    direction: str
    t_s: Array
    q: Array
    added: Array
    by_setup: Array


def energy_of(laps: Sequence[Lap], parts: Sequence[Array]) -> float:
    """Energy in mm² of changes (m, 2) mm per lap that the set-up cannot absorb."""
    A = np.concatenate([lap.by_setup for lap in laps])
    x = np.concatenate([part.ravel() for part in parts])
    return float(np.sum((x - A @ np.linalg.lstsq(A, x, rcond=None)[0]) ** 2))


@dataclass(frozen=True)
class _Run:
    """A row of runs.csv. use: `train`, `held_out` or `unseen`."""

    test: str
    direction: str
    use: str


def generate(
    kind: str, seed: int, directory: Path, truth_directory: Path, *, scale: str = "limits", name: str = ""
) -> Path:
    """Write a case and its truth. Return the directory of the case, `case-SEED` or `name` in `directory`."""
    session, mode = _begun(kind, seed, scale)
    rng, sight, noise, unseen = session.rng, session.sight, session.noise, session.unseen
    scales = Scales(sight.placed(session.links), noise)
    share = _shares(scales, kind, scale)
    hidden, foreign = _drawn(kind, scale, scales, share, rng)
    secret = [one.fault for one in hidden] + ([foreign.fault] if foreign else [])
    apart = {one.fault.name for one in hidden}
    quiet = scales.frame({}) if kind == "dense" else None
    rest = background([other for other in share if other not in apart], share, rng, quiet)
    case = directory / (name or f"case-{seed:05d}")
    case.mkdir(parents=True)
    session.faults = [*secret, *rest]
    _write(case, session, sight.cell, unseen[0])
    truth = {
        "case": case.name,
        "kind": kind,
        "seed": seed,
        "scale": scale,
        "rig": session.robot,
        "hidden": [_hidden_json(one) for one in hidden],
        "outside": _foreign_json(foreign),
        "unseen": mode,
        "gap_um": session.gaps(secret),
        "noise": noise.__dict__,
        "setup": {use: _link_json(link) for use, link in session.links.items()},
        "background": [fault_json(fault) for fault in rest],
    }
    truth_directory.mkdir(parents=True, exist_ok=True)
    text = json.dumps(truth, indent=1, default=float) + "\n"
    (truth_directory / f"{case.name}.json").write_text(text, encoding="utf-8")
    return case


def _begun(kind: str, seed: int, scale: str) -> tuple[_Session, dict[str, Any]]:
    """Session of a case before effects are hidden, and a description of its unseen place."""
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode()), SCALES.index(scale)])
    robot = ROBOTS[rng.integers(len(ROBOTS))]
    sight, noise = sight_of(robot), drawn_noise(rng)
    unseen, mode = elsewhere(sight, rng)
    return _Session(robot, sight, unseen, noise, rng), mode


def _shares(scales: Scales, kind: str, scale: str) -> dict[str, float]:
    """Largest size of each background effect in healthy sizes, by name."""
    part = DENSE if kind == "dense" else SCATTERED
    tops = {name: min(1.0, limit) if scale == "limits" else 1.0 for name, limit in scales.limits().items()}
    return {name: part * top for name, top in tops.items()}


def _drawn(
    kind: str, scale: str, scales: Scales, share: Mapping[str, float], rng: np.random.Generator
) -> tuple[list[Hidden], Foreign | None]:
    sizes = (3.0, 15.0) if scale == "tolerance" else None
    match kind:
        case "none":
            return [], None
        case "outside":
            return [], hide_foreign(scales, share, rng)
        case "wrong_form":
            return hide(scales, share, 1, rng, HAS_FORM, (0.6, 1.0), sizes), None
    count = {"one": 1, "dense": 1, "two": 2, "three": 3}[kind]
    return hide(scales, share, count, rng, sizes=sizes), None


def elsewhere(sight: Sight, rng: np.random.Generator) -> tuple[tuple[Cell, Track], dict[str, Any]]:
    """Cell with a circle at a different place or of a different radius, and the change."""
    circle = sight.cell.circle
    for _ in range(30):
        if rng.uniform() < 0.5:
            way = rng.standard_normal(3)
            place = replace(
                circle, centre=np.round(circle.centre + rng.uniform(70, 130) * way / np.linalg.norm(way), 3)
            )
            mode = {"place_mm": [float(x) for x in place.centre - circle.centre]}
        else:
            place = replace(circle, radius=float(rng.choice([50.0, 90.0])))
            mode = {"radius_mm": place.radius}
        try:
            track = track_of(sight.cell, place)
        except (OutOfReachError, np.linalg.LinAlgError):
            continue
        start = np.array([np.interp(0.0, track.psi, column) for column in track.q.T])
        there: Place = replace(place, posture=start)
        return (moved(sight.cell, there), replace(track, place=there)), mode
    raise OutOfReachError("no other place for the circle")


class _Session:
    """A measuring session: set-ups, and runs in the order of their measurement."""

    def __init__(
        self, robot: str, sight: Sight, unseen: tuple[Cell, Track], noise: Noise, rng: np.random.Generator
    ) -> None:
        self.robot, self.sight, self.unseen, self.noise, self.rng = robot, sight, unseen, noise, rng
        self.faults: list[Fault] = []
        cell = sight.cell
        self.links = {
            "yaw": self._link(cell.circle, 2, cell),
            "roll": self._link(cell.circle, 2, cell),
            "radial": self._link(cell.hemisphere, 1, cell),
            "unseen": self._link(unseen[0].circle, 2, cell),
        }

    def _link(self, place: Place, gauges: int, cell: Cell) -> Link:
        way = self.rng.standard_normal(3)
        off = self.rng.uniform(0.1, 1.0) * way / np.linalg.norm(way)
        return Link(place.centre + off, self.rng.uniform(-0.3, 0.3, gauges), cell.gauge_at)

    def order(self) -> list[_Run]:
        """Runs in random order of the set-ups and within each set-up."""
        yaw = [_Run("yaw", way, "train") for way in ("acw", "cw") for _ in range(REPEATS)]
        yaw += [_Run("yaw", way, "held_out") for way in ("acw", "cw")]
        roll = [_Run("roll", way, "train") for way in ("acw", "cw") for _ in range(REPEATS)]
        blocks = [yaw, roll, [_Run("radial", "", "train")], [_Run("yaw", way, "unseen") for way in ("acw", "cw")]]
        shuffled = [blocks[k] for k in self.rng.permutation(len(blocks))]
        return [block[k] for block in shuffled for k in self.rng.permutation(len(block))]

    def motion(self, run: _Run, rng: np.random.Generator) -> Motion:
        if run.test == "radial":
            at = self.sight.targets
            order = np.roll(np.arange(len(at["q"])), int(rng.integers(len(at["q"]))))
            return visits(self.sight.cell, at, order, rng.uniform(1.5, 3.0, len(order)))
        cell, track = self.unseen if run.use == "unseen" else (self.sight.cell, self.sight.track)
        return lap(cell, track, run.test, 1 if run.direction == "acw" else -1, stamps(self.noise, 60.0, rng))

    def link(self, run: _Run) -> Link:
        return self.links["unseen" if run.use == "unseen" else run.test]

    def readings(self, run: _Run, motion: Motion) -> Array:
        """Return readings (m, k) mm with scatter of the run and noise."""
        rng, noise, link = self.rng, self.noise, self.link(run)
        link = replace(link, ball=link.ball + noise.ball_mm * rng.standard_normal(3))
        scatter = np.radians(noise.joints_deg) * rng.standard_normal(6)
        phases = {"vibration": float(rng.uniform(0, 2 * np.pi))}
        g = measure(self.sight.cell, motion, self.faults, link, scatter, phases)
        return g + added(noise, motion.t[motion.rows], g.shape[1], rng)

    def gaps(self, secret: list[Fault]) -> dict[str, float]:
        """Rms in µm of the hidden effects after fitting the set-up, for held-out runs and the unseen
        place.
        """
        found = {}
        for use, name in (("held_out", "held_out"), ("unseen", "unseen_place")):
            laps = self.laps(use, secret)
            x, A = np.concatenate([lap.added.ravel() for lap in laps]), np.concatenate([lap.by_setup for lap in laps])
            left = x - A @ np.linalg.lstsq(A, x, rcond=None)[0]
            found[name] = round(1e3 * float(np.sqrt(np.mean(left**2))), 4)
        return found

    def laps(self, use: str, secret: list[Fault]) -> list[Lap]:
        """Return noise-free yaw laps, acw and cw, with the changes by faults."""
        found = []
        for way in ("acw", "cw"):
            run = _Run("yaw", way, use)
            motion, link, cell = self.motion(run, np.random.default_rng(0)), self.link(run), self.sight.cell
            plain = measure(cell, motion, [], link)
            balls = [replace(link, ball=link.ball + step) for step in 1e-3 * np.eye(3)]
            by_ball = [(measure(cell, motion, [], ball) - plain).ravel() / 1e-3 for ball in balls]
            by_setup = np.stack([*by_ball, *np.tile(np.eye(2), len(plain))], axis=1)
            added = measure(cell, motion, secret, link) - plain
            found.append(Lap(way, motion.t[motion.rows], motion.q[motion.rows], added, by_setup))
        return found


def _write(case: Path, session: _Session, cell: Cell, unseen: Cell) -> None:
    for name, data in (("rig", cell.data), ("unseen", unseen.data)):
        (case / f"{name}.yaml").write_text(yaml.safe_dump(data, sort_keys=False, allow_unicode=True), encoding="utf-8")
    with (case / "runs.csv").open("w", encoding="utf-8", newline="") as file:
        lines = csv.writer(file)
        lines.writerow(["file", "test", "direction", "use", "rig"])
        for number, run in enumerate(session.order(), start=1):
            motion = session.motion(run, session.rng)
            table = f"{number:02d}-{'-'.join(filter(None, [run.test, run.direction]))}.csv"
            write_table(case / table, motion, session.readings(run, motion), session.noise.encoder_deg)
            rig = "unseen.yaml" if run.use == "unseen" else "rig.yaml"
            lines.writerow([table, run.test, run.direction, run.use, rig])


def fault_json(fault: Fault) -> dict[str, Any]:
    size = {SIZE.get(fault.effect, "size"): fault.size}
    form = {"rough": fault.rough, "begin": fault.begin}
    return {
        "name": fault.name,
        "effect": fault.effect,
        **fault.keys,
        "parameters": size | dict(fault.shape),
        "form": form,
    }


def fault_from(one: Mapping[str, Any]) -> Fault:
    """Fault described in the truth."""
    size = SIZE[one["effect"]]
    keys = {key: one[key] for key in ("axis", "field", "gauge", "from_axis", "to_axis") if key in one}
    shape = {key: value for key, value in one["parameters"].items() if key != size}
    form = one["form"]
    return Fault(one["effect"], keys, float(one["parameters"][size]), shape, form["rough"], form["begin"])


def _hidden_json(one: Hidden) -> dict[str, Any]:
    return fault_json(one.fault) | {
        "size": SIZE[one.fault.effect],
        "healthy": one.fault.healthy,
        "snr": one.snr,
        "snr_noise": one.snr_noise,
        "class": sorted({one.fault.name, *one.twins}),
        "nearest_rival": {"name": one.rival, "sigma": one.rival_sigma},
    }


def _foreign_json(foreign: Foreign | None) -> dict[str, Any] | None:
    if foreign is None:
        return None
    more = {"snr": foreign.snr, "snr_unexplained": foreign.snr_unexplained, "nearest": foreign.nearest}
    return fault_json(foreign.fault) | more


def _link_json(link: Link) -> dict[str, Any]:
    return {"ball_mm": link.ball.tolist(), "zeros_mm": link.zeros.tolist()}
