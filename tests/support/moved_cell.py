"""A cell with a reference of touches, and touches after something moved, by an independent world."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from analysis.api import read_table, save_run
from analysis.apps.commission.next_touch import candidates_of, next_posture
from analysis.diagnosis.evidence.observation import ObservedRun, by_socket, observe
from analysis.movement.causes import Cause
from analysis.movement.inference import Reference, compare, study
from analysis.robot.predict import Model, model_of
from analysis.runs.tables import TouchTable
from rigs.load import parse
from tests.worlds import moved as world


def rig_text(kind: world.Kind) -> str:
    """Rig file of the nominal arm of a kind."""
    axes = "\n".join(
        f"    - {{name: J{k}, a_mm: {a}, alpha_deg: {alpha}, d_mm: {d}, limits_deg: [-360, 360], speed_deg_s: 120}}"
        for k, (a, alpha, d) in enumerate(zip(kind.a, kind.alpha_deg, kind.d, strict=True), start=1)
    )
    touch = f"tests:\n  touch:\n    sockets: [A, B]\n    ball_mm: {list(kind.tool)}\n"
    return f"name: moved\nrobot:\n  name: trial\n  axes:\n{axes}\n{touch}"


def model_for(kind: world.Kind) -> Model:
    """Return rig's model of the nominal arm of a kind."""
    return model_of(parse(rig_text(kind), "trial"))


def observed(model: Model, sockets: list[str], q: np.ndarray) -> list[ObservedRun]:
    return by_socket(observe(model, TouchTable(np.array(sockets), q), "trial"))


class Case:
    """One drawn arm, its reference and what changed."""

    def __init__(self, kind: world.Kind, cause: str, scatter_mm: float, seed: int) -> None:
        self.rng = np.random.default_rng([seed, *cause.encode()])
        self.model, self.scatter_mm, self.rig_text = model_for(kind), scatter_mm, rig_text(kind)
        self.arm = world.drawn_arm(kind, self.rng)
        count = int(self.rng.integers(20, 41))
        self.sockets = (["A", "B"] * count)[:count]
        self.q = self._postures(self.sockets)
        axes = len(kind.a)
        self.before = world.touched(self.arm, self.q, self.sockets, world.no_change(axes), scatter_mm, self.rng)
        self.reference: Reference = study(observed(self.model, self.sockets, self.before))
        self.change = world.drawn_change(cause, axes, self.rng)
        self.after = world.changed_arm(self.arm, self.change)

    def _postures(self, sockets: list[str]) -> np.ndarray:
        found = {name: world.postures(self.arm, world.SOCKETS[name], sockets.count(name), self.rng) for name in "AB"}
        taken = Counter[str]()
        rows = []
        for name in sockets:
            rows.append(found[name][taken[name]])
            taken[name] += 1
        return np.array(rows)

    def touch(self, sockets: list[str], q: np.ndarray | None = None) -> tuple[list[str], np.ndarray]:
        """Return touches after the change, near given postures or in random ones."""
        near = self._postures(sockets) if q is None else q
        return sockets, world.touched(self.after, near, sockets, self.change, self.scatter_mm, self.rng)

    def touch_again(self, count: int) -> tuple[list[str], np.ndarray]:
        """Return touches after the change in postures of the reference drawn at random, both sockets in turn."""
        rows = [
            int(self.rng.choice([k for k, name in enumerate(self.sockets) if name == "AB"[n % 2]]))
            for n in range(count)
        ]
        return self.touch([self.sockets[row] for row in rows], self.q[rows])

    def touch_planned(self, count: int) -> tuple[list[str], np.ndarray]:
        """Return touches made after the change, at most `count`, until a cause is named.

        The plan chooses each posture from the touches before it.
        """
        candidates, compared = candidates_of(self.reference), None
        sockets: list[str] = []
        q = np.empty((0, self.q.shape[1]))
        while len(sockets) < count:
            posture = next_posture(self.reference, candidates, compared)
            row = int(np.abs(self.q - posture.angles).max(axis=1).argmin())
            name, near = self.touch([self.sockets[row]], self.q[row : row + 1])
            sockets, q = sockets + name, np.concatenate([q, near])
            compared = compare(self.reference, observed(self.model, sockets, q))
            if compared.identified_cause is not None:
                break
        return sockets, q

    def named(self, touches: tuple[list[str], np.ndarray]) -> Cause | None:
        return compare(self.reference, observed(self.model, *touches)).identified_cause


def label(cause: Cause | None) -> str:
    """A cause as the world names it."""
    if cause is None:
        return "open"
    if cause.members:
        return "+".join(sorted(map(label, cause.members)))
    return f"zero {cause.axis}" if cause.what == "zero" else cause.what


def moved_cell(folder: Path, cause: str, seed: int = 2) -> Case:
    """Write the rig file and the run `before` of a cell in which a cause then moves something."""
    case = Case(world.SIX, cause, 0.05, seed)
    (folder / "cell.yaml").write_text(case.rig_text, encoding="utf-8")
    write_touches(folder, "before", case.sockets, case.before)
    return case


def write_touches(folder: Path, name: str, sockets: list[str], q: np.ndarray) -> Path:
    head = ",".join(["socket", *(f"q{k}_deg" for k in range(1, q.shape[1] + 1))])
    rows = [",".join([s, *(f"{a:.6f}" for a in np.degrees(row))]) for s, row in zip(sockets, q, strict=True)]
    table = folder / f"{name}.csv"
    table.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    (folder / "runs").mkdir(exist_ok=True)
    return save_run(read_table(table, folder / "cell.yaml", "touch"), folder / "runs" / name)


def touch_near(case: Case, joints_deg: list[float]) -> np.ndarray:
    """Joint angles in degrees of a touch after the movement, near a proposed posture of the reference."""
    row = int(np.abs(case.before - np.radians(joints_deg)).max(axis=1).argmin())
    _, q = case.touch([case.sockets[row]], case.q[row : row + 1])
    return np.asarray(np.degrees(q[0]))
