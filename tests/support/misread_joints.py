"""Pose tables whose joints have other zeros, directions or units than the rig file, with their true angles."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from analysis.intake.imports import propose_map
from analysis.intake.table_map import TO_DEG, Angles
from analysis.procedures.checks.columns import MOST_ZERO_DEG, left_mm
from analysis.robot.kinematics.arm import Arm, arm_of, without_setup
from rigs.arms import load_arm
from rigs.errors import RigError
from tests.support.drawn_tables import constants, postures, seen_by_tracker
from tests.worlds.arms.independent_arm import bad_arm, flange

Array = NDArray[np.float64]
ARMS = ("ur10e", "ur3e", "abb-irb-1600", "fanuc-m-10ia", "kuka-kr-6-r900-2", "staubli-tx2-60", "kawasaki-rs007n")
UNITS = ("deg", "rad", "gon", "turn", "1/4096 turn")
_SAME_DEG = 2.5
"""Difference of angles up to which a reading is the true one: a healthy arm has zeros of some tenths of a degree."""
_AS_WELL = 1.5


@dataclass(frozen=True)
class Misread:
    """A table of an arm, with signs (6,) and zeros (6,) degrees: angle = sign times column plus zero."""

    arm: str
    q: Array
    xyz_mm: Array
    signs: Array
    zeros_deg: Array
    unit: str
    rounded_deg: float = 0.0
    """Step of the angles in the table."""

    @property
    def text(self) -> str:
        angles_deg = np.degrees(self.q) - self.zeros_deg
        if self.rounded_deg:
            angles_deg = np.round(angles_deg / self.rounded_deg) * self.rounded_deg
        columns = angles_deg * self.signs / TO_DEG[self.unit]
        digits = {"rad": "%.6f", "turn": "%.7f", "1/4096 turn": "%.0f"}.get(self.unit, "%.5f")
        formats = [digits] * 6 + ["%.5f"] * 3
        file = io.StringIO()
        header = ",".join([*(f"J{axis}" for axis in range(1, 7)), "X", "Y", "Z"])
        np.savetxt(file, np.column_stack([columns, self.xyz_mm]), formats, ",", header=header, comments="")
        return file.getvalue()

    @property
    def words(self) -> str:
        zeros = [f"{zero:+.1f}° on J{axis}" for axis, zero in enumerate(self.zeros_deg, start=1) if zero]
        backwards = [f"J{axis} reversed" for axis, sign in enumerate(self.signs, start=1) if sign < 0]
        return ", ".join([self.arm, f"{len(self.q)} rows", self.unit, *zeros, *backwards])


def draw_misread(rng: np.random.Generator) -> Misread:
    """Up to three zeros of ±20° or a quarter turn, and up to two reversed joints, in any unit."""
    arm, unit = str(rng.choice(ARMS)), str(rng.choice(UNITS))
    poses = seen_by_tracker(arm, int(rng.integers(20, 61)), rng)
    return Misread(arm, poses.q, poses.xyz_mm, *_drawn_reading(rng), unit)


def draw_homemade(rng: np.random.Generator) -> Misread:
    """Tables as of `draw_misread`, of an arm that rig does not model, with rounded angles and some wrong places.

    Its links are longer or shorter by millimetres, bend under their weight by up to 0.3° and have gear waves of orders
    that are not whole. Angles are rounded to 0.1° or to the step of a servo, and the tracker scatters by up to 1 mm.
    """
    arm, unit = str(rng.choice(ARMS)), str(rng.choice(UNITS))
    q = postures(arm, int(rng.integers(20, 61)), rng)
    soft_rad = np.radians(rng.uniform(0.0, 0.3, 3))
    levers = np.column_stack([np.cos(q[:, 1]), np.cos(q[:, 1] + q[:, 2]), np.cos(q[:, 1] + q[:, 2] + q[:, 3])])
    bent = np.zeros_like(q)
    bent[:, 1:4] = -soft_rad * levers
    waves_rad, orders = np.radians(rng.uniform(0, 0.15, 6)), rng.uniform(0.6, 12, 6)
    bent += waves_rad * np.sin(orders * q + rng.uniform(0, 6, 6))
    R, p = flange(constants(arm), bad_arm(rng), q + bent)
    place = p + R @ rng.uniform([-80, -80, 40], [80, 80, 250]) + rng.normal(0, rng.uniform(0.02, 1.0), p.shape)
    place = Rotation.random(rng=rng).apply(place) + rng.uniform(-3000, 3000, 3)
    lost = rng.uniform(size=len(q)) < rng.choice([0.0, 0.05])
    place[lost] += rng.normal(0, 30, (int(lost.sum()), 3))
    return Misread(arm, q, place, *_drawn_reading(rng), unit, float(rng.choice([0.1, 0.1, 360 / 4096])))


def _drawn_reading(rng: np.random.Generator) -> tuple[Array, Array]:
    """Signs (6,) and zeros (6,) degrees of the columns of a table."""
    signs, zeros_deg = np.ones(6), np.zeros(6)
    off = rng.permutation(np.arange(1, 5))[: rng.integers(0, 4)]
    quarter = rng.uniform(size=len(off)) < 1 / 3
    zeros_deg[off] = np.where(quarter, rng.choice([-90.0, 90.0], len(off)), rng.uniform(-20, 20, len(off)).round(2))
    if rng.uniform() < 1 / 2:
        signs[rng.permutation(6)[: rng.integers(1, 3)]] = -1.0
    return signs, zeros_deg


def outcome_of(table: Misread, folder: Path) -> tuple[str, str]:
    """How an import reads a table, and the words of its answer.

    right: as it is, or as the first answer to a question. equivalent: readings that these places do not distinguish
    from the truth and that differ from the columns in no more joints. asked: the truth is another answer, or refused
    without a cause. wrong: any other reading.
    """
    path = folder / "table.csv"
    path.write_text(table.text)
    try:
        proposal = propose_map([path], table.arm)
    except RigError as error:
        return "asked", str(error)
    words = " | ".join([*proposal.checked, *proposal.table_map.assumed])
    readings = [
        reading.value
        for question in proposal.questions
        if question.key == "joints"
        for reading in question.readings
        if reading.value.reversed or reading.value.zeros_deg  # the others are the columns as they are named
    ]
    assert proposal.table_map.joints
    bare = without_setup(arm_of(load_arm(table.arm).robot))
    results = [_compared(table, bare, angles) for angles in readings or [proposal.table_map.joints]]
    if results[0] in ("right", "equivalent"):
        return results[0], words
    return ("asked" if "right" in results or "equivalent" in results else "wrong"), words


def _compared(table: Misread, bare: Arm, angles: Angles) -> str:
    columns = (table.q - np.radians(table.zeros_deg)) * table.signs * 180 / np.pi / TO_DEG[table.unit]
    backwards = np.isin(np.arange(1, 7), angles.reversed)
    q = np.radians(columns * angles.factors) * np.where(backwards, -1, 1) + np.radians(angles.zeros_deg or 0.0)
    away_deg = np.degrees(np.abs((q - table.q + np.pi) % (2 * np.pi) - np.pi))
    off_deg = np.ptp(away_deg, axis=0) + np.where([0, 1, 1, 1, 1, 0], away_deg.max(axis=0), 0.0)
    most_deg = MOST_ZERO_DEG if not (angles.reversed or angles.zeros_deg) else _SAME_DEG
    if off_deg.max() <= most_deg:
        return "right"
    is_as_good = left_mm(bare, q, table.xyz_mm, 100) <= _AS_WELL * left_mm(bare, table.q, table.xyz_mm, 100)
    changed = int((backwards | (np.abs(np.array(angles.zeros_deg or np.zeros(6))) > _SAME_DEG)).sum())
    true = int(((table.signs < 0) | (np.abs(table.zeros_deg) > _SAME_DEG)).sum())
    return "equivalent" if is_as_good and changed <= true else "wrong"
