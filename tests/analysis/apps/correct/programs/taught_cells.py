"""Programs taught by hand on arms with hidden errors, and the places where the real tool then is.

A hand jogs the arm until the real tool is within 20 µm of the part, and the pendant stores what its controller shows.
An independent interpreter drives the program; the real arm and the controller are independent of rig.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from analysis.apps.correct.corrected_program import CorrectedProgram, correct_program
from analysis.apps.correct.stated_frames import frames_of
from analysis.apps.correct.stated_points import StatedPoints
from rigs.rig import Rig
from tests.analysis.apps.correct.programs import cells
from tests.worlds.arms.faulty_arm import flange_at, frame, hidden, joints_of
from tests.worlds.interpreters.arms import rig_of
from tests.worlds.languages import arms, fanuc, inform, krl, rapid, urscript
from tests.worlds.languages.execution import Ended, Robot, Ways, World

Array = np.ndarray
JOGGED_MM = 0.02
MAKERS = ("ur", "kuka", "abb", "fanuc", "yaskawa", "linuxcnc")
_MACHINES = {"ur": urscript, "abb": rapid, "kuka": krl, "fanuc": fanuc, "yaskawa": inform}
_LISTS = {"ur": "UR", "kuka": "KUKA", "abb": "ABB", "fanuc": "FANUC", "yaskawa": "YASKAWA", "linuxcnc": "LINUXCNC"}
_TEXTS = {
    "ur": {"a.script": cells.TCP + "movej({q0})\nmovel({p1})\nmovej({q3})\nmovel({p4})\n"},
    "kuka": {"a.src": cells.HEAD + "PTP {q0}\nLIN {p1}\nPTP {p4}\nEND\n"},
    "abb": cells.module_of("MoveAbsJ {q0},v9,fine,t;\nMoveL {p1},v9,fine,t;\nMoveJ {p3},v9,fine,t;\n"),
    "fanuc": {"a.ls": cells.selecting(cells.J1, cells.L2)},
    "yaskawa": {"A.JBI": cells.job_of(cells.M1, cells.M2)},
    "linuxcnc": {"a.ngc": cells.LINUXCNC_HEAD + "G1 {p1}\nG1 {p2}\n"},
}
_TOOLS = {"kuka": ("1", cells.KUKA_TOOL), "fanuc": ("1", cells.FANUC_TOOL), "yaskawa": ("3", cells.YASKAWA_TOOL)}
_FRAMES = {"kuka": {"2": cells.KUKA_BASE, "3": np.eye(4)}, "fanuc": {"3": np.eye(4)}, "yaskawa": {"4": np.eye(4)}}
_TIP = np.array([0.0, 0.0, 150.0, 1.0])
"""Point of the tool that has to be at the part."""


@dataclass(frozen=True)
class TaughtCell:
    """A program taught on a real arm.

    moved_deg (6,): by which the links have turned since at unchanged readings, for example after a crash. shown_deg
    (6,): by which the readings differ from then at an unchanged posture, because values were entered.
    """

    maker: str
    rig: Rig
    files: dict[str, str]
    parts: Array = field(repr=False)
    """Places (n, 3) mm of the tip where the hand brought it."""

    def flange(self, q: Array) -> Array:
        """Flange (4, 4) of the real arm at readings q (6,) rad of the controller as it was."""
        if self.maker == "linuxcnc":
            return flange_at(self.rig, q, hidden())
        return arms.cell(self.maker).flanges(q[None])[0]

    def tips(self, readings: Sequence[Array], shown_deg: Array, moved_deg: Array) -> Array:
        coupling = np.array(self.rig.robot.coupling)  # A motor turns its own link, also if the readings are coupled.
        turned = np.radians(np.linalg.solve(coupling, np.diag(coupling) * moved_deg) - shown_deg)
        return np.array([(self.flange(q + turned) @ _TIP)[:3] for q in readings])

    def off_mm(
        self, files: dict[str, bytes], shown_deg: Array | float = 0.0, moved_deg: Array | float = 0.0, **changed: Array
    ) -> Array:
        """Distances (n,) mm of the real tip from its parts, driven by an interpreter.

        changed: other constants of the controller.
        """
        readings = self.driven(files, **changed)
        assert len(readings) == len(self.parts)
        zero = np.zeros(6)
        return np.linalg.norm(self.tips(readings, zero + shown_deg, zero + moved_deg) - self.parts, axis=1)

    def driven(self, files: dict[str, bytes], **changed: Array) -> list[Array]:
        texts = {name: data.decode("latin-1") for name, data in files.items()}
        if self.maker == "linuxcnc":
            return self._g_code(texts["a.ngc"])
        return _driven(self.maker, texts, **changed)

    def _g_code(self, text: str) -> list[Array]:
        readings = []
        for k, line in enumerate([line for line in text.splitlines() if line.startswith("G1 ")]):
            values = [float(number) for number in re.findall(rf"[XYZABC]({cells.NUMBER})", line)]
            if k == 0:
                readings.append(np.radians(values))
                continue
            turn = Rotation.from_euler("xyz", values[3:], degrees=True)
            readings.append(joints_of(self.rig, frame(np.add(values[:3], [100, -50, 20]), turn), readings[0]))
        return readings

    def corrected(self, directory: Path, points: StatedPoints) -> CorrectedProgram:
        cells.write_files(directory, self.files)
        stated = frames_of(self.rig.robot, *cells.STATED.get(self.maker, ((), ())))
        return correct_program(points, directory / next(iter(self.files)), stated)

    @property
    def given(self) -> dict[str, bytes]:
        return {name: text.encode("latin-1") for name, text in self.files.items()}


def _driven(maker: str, texts: dict[str, str], **changed: Array) -> list[Array]:
    language = _MACHINES[maker]
    tools = dict([_TOOLS[maker]]) if maker in _TOOLS else {}
    stated = {("tool", name): T for name, T in tools.items()}
    world, ways = World(0, stated | {("frame", name): T for name, T in _FRAMES.get(maker, {}).items()}), Ways()
    machine = language.Machine(language.Program(texts, next(iter(texts))), world, ways)
    if changed:
        here = replace(arms.cell(maker), controller=f"{maker} with other constants", **changed)
        Robot._cache.clear()
        machine.robot = Robot(maker, here, world, ways)
    with suppress(Ended):
        machine.run()
    return [reached.q for reached in machine.robot.reached]


def taught_cell(maker: str, monkeypatch, seed: int = 0) -> TaughtCell:
    """Teach the points of a maker's cell by hand."""
    rig = rig_of("ur10e") if maker == "linuxcnc" else arms.cell(maker).rig
    bare = TaughtCell(maker, rig, {}, np.zeros((0, 3)))
    rng, name = np.random.default_rng(seed), _LISTS[maker]
    taught = []
    for q_deg in getattr(cells, name):
        q0 = np.radians(np.array(q_deg, dtype=float))
        wanted = flange_at(rig, q0)
        jogged = rng.normal(size=3)
        wanted[:3, 3] += JOGGED_MM * rng.uniform() * jogged / np.linalg.norm(jogged)
        taught.append(tuple(np.degrees(_jogged(bare, wanted, q0)).tolist()))
    monkeypatch.setattr(cells, name, taught)
    make = getattr(cells, f"{maker}_files")
    files = make(_TEXTS[maker])[1]
    cell = replace(bare, files=files)
    readings = cell.driven(cell.given)
    return replace(cell, parts=cell.tips(readings, np.zeros(6), np.zeros(6)))


def _jogged(cell: TaughtCell, wanted: Array, near: Array) -> Array:
    """Readings (6,) rad at which the flange of the real arm is at a pose (4, 4)."""

    def away(q: Array) -> Array:
        T = cell.flange(q)
        turn = Rotation.from_matrix(T[:3, :3].T @ wanted[:3, :3]).as_rotvec()
        return np.concatenate([T[:3, 3] - wanted[:3, 3], 500 * turn])

    return np.asarray(least_squares(away, near, xtol=1e-14, ftol=1e-14, gtol=1e-14).x)
