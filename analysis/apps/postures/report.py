"""Postures on the screen, and as tables: the chosen sequence, and all postures of each target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.apps.postures.result import Postures
from analysis.apps.report.blocks import Block, Sentence, Table, paragraphs
from analysis.apps.report.texts import Language, Texts, texts_of
from analysis.robot.kinematics.arm import RAIL_MM
from analysis.runs.tables import RAIL, joint_columns
from analysis.runs.written_files import csv_text
from rigs.schema.robot import Robot

POSTURE_COLUMNS = ("expected_mm", "error_mm", "posture_u_mm", "measured_region")
"""Columns of a posture in each table: the expected rms error including uncertainty and play, the predicted error
without both (empty for a typical arm), the standard uncertainty, and whether the runs reach the posture (yes, no or
unknown)."""
_MOST_ROWS = 20
"""Maximum number of targets on the screen; JSON and tables contain all."""
_SHOWN_PLAY = 0.2
"""Share of the expected error from which play is mentioned. At this share, play increases the rms by 2 %."""


def answer_of(postures: Postures, labels: Sequence[str], language: Language = "en") -> list[Block]:
    texts = texts_of(language)
    best, usual = postures.best, postures.usual
    travel, before = (f"{np.degrees(sequence.travel_rad):.0f}" for sequence in (best, usual))
    motion = texts("postures_way", changes=best.changes, before=usual.changes, travel=travel, travel_before=before)
    unlisted = len(postures.poses) - _MOST_ROWS
    below = [texts("postures_more", count=unlisted) if unlisted > 0 else "", play_words(postures, texts)]
    return [
        *paragraphs(doubt_lines(postures, texts), "doubt"),
        Sentence(gain_words(postures, texts), "strong"),
        Sentence(motion),
        *paragraphs([map_words(postures, texts)], "strong"),
        _table(postures, labels, texts),
        *paragraphs(below),
        Sentence(texts("postures_collisions"), "note"),
    ]


def doubt_lines(postures: Postures, texts: Texts) -> list[str]:
    lines: list[str] = [texts("postures_verdict", why=postures.verdict)] if postures.verdict else []
    if postures.knowledge != "calibrated":
        lines.append(texts(f"postures_{postures.knowledge}"))
    if postures.outside:
        lines.append(texts.counted("postures_outside", postures.outside, total=len(postures.best.rows)))
    return lines


def gain_words(postures: Postures, texts: Texts) -> str:
    if not len(postures.best.rows):
        return texts("postures_none")
    key = "postures_gain_given" if postures.is_given else "postures_gain_short"
    best, usual = (f"{sequence.rms_mm:.3f}" for sequence in (postures.best, postures.usual))
    return texts.counted(key, len(postures.best.rows), best=best, usual=usual)


def map_words(postures: Postures, texts: Texts) -> str:
    """The best place for a part; empty if no map was computed."""
    work_map = postures.work_map
    if work_map is None:
        return ""
    part = " × ".join(f"{size:g}" for size in work_map.part_mm)
    if work_map.best_mm is None:
        return texts("postures_no_place", part=part)
    x, y = work_map.best_mm
    now = work_map.at(*postures.reached[:, :2, 3].mean(axis=0))
    words = texts("postures_place", part=part, x=f"{x:z.0f}", y=f"{y:z.0f}", best=f"{work_map.at(x, y):z.3f}")
    return words if np.isnan(now) else f"{words} {texts('postures_place_now', now=f'{now:.3f}')}"


def play_words(postures: Postures, texts: Texts) -> str:
    """Influence of the side of approach; empty if play is small or was not measured."""
    rows = postures.best.rows
    if postures.knowledge == "typical" or not len(rows):
        return ""
    errors = postures.errors.of(rows)
    if np.median(errors.play_mm / errors.expected_mm) < _SHOWN_PLAY:
        return ""
    unknown, chosen = (float(np.sqrt(np.mean(mm**2))) for mm in (errors.expected_mm, errors.best_approach()[1]))
    return texts("postures_play", unknown=f"{unknown:.3f}", chosen=f"{chosen:.3f}")


def _table(postures: Postures, labels: Sequence[str], texts: Texts) -> Table:
    candidates, rows = postures.candidates, []
    chosen = dict(zip(candidates.target[postures.best.rows].tolist(), postures.best.rows.tolist(), strict=True))
    of_target = dict(candidates.groups())
    for target, label in enumerate(labels[:_MOST_ROWS]):
        if target not in chosen:
            rows.append((label, "0", "–", "–", "–"))
            continue
        at, row = of_target[target], chosen[target]
        expected, solutions = postures.errors.expected_mm[at], np.unique(candidates.solution[at])
        spread = f"{expected.min():.3f} … {expected.max():.3f}"
        error = "" if postures.knowledge == "typical" else f"{postures.errors.size_mm[row]:.3f} "
        q, axes = candidates.q[row], len(postures.rig.robot.axes)
        angles = [f"{angle:z.0f}" for angle in np.degrees(q[:axes])]
        angles += [f"E1 {RAIL_MM * stand:z.0f} mm" for stand in q[axes:]]
        rows.append(
            (label, f"{len(solutions)}", spread, f"{error}± {postures.errors.u_mm[row]:.3f}", ", ".join(angles))
        )
    heads = tuple(texts(f"postures_column_{name}") for name in ("target", "count", "range", "chosen", "joints"))
    return Table(heads, tuple(rows), frozenset({1, 2, 3}))


# ----------------------------------------------------------------------------------------------------------------------
# Tables


def chosen_csv(postures: Postures, kept: dict[str, list[str]]) -> str:
    """Chosen sequence as CSV: the columns `kept` of the given table, by name, then the joint targets."""
    rows = postures.best.rows
    targets = postures.candidates.target[rows].tolist()
    head = [*kept, *_joint_names(postures.rig.robot), *POSTURE_COLUMNS]
    lines = [
        [*(column[target] for column in kept.values()), *_joint_cells(postures, row), f"{expected:.4f}",
         *_error_cells(postures, row)]
        for target, row, expected in zip(targets, rows.tolist(), postures.best.expected_mm.tolist(), strict=True)
    ]  # fmt: skip
    return csv_text([head, *lines])


def all_csv(postures: Postures, labels: Sequence[str]) -> str:
    robot = postures.rig.robot
    names = (*_joint_names(robot), "branch", *POSTURE_COLUMNS, "play_mm", "approached_mm", "approach", "conditioning")
    rising, approached = postures.errors.best_approach()
    lines: list[list[str]] = []
    for target, rows in postures.candidates.groups():
        for rank, row in enumerate(postures.ranked(rows), start=1):
            branch = int(postures.candidates.branch[row])
            playing = np.flatnonzero(postures.played[row]).tolist()
            sides = " ".join(f"J{axis + 1}{'+' if rising[row, axis] else '-'}" for axis in playing)
            lines.append([
                labels[target], str(rank), *_joint_cells(postures, row), str(branch) if branch >= 0 else "",
                f"{postures.errors.expected_mm[row]:.4f}", *_error_cells(postures, row),
                f"{postures.errors.play_mm[row]:.4f}", f"{approached[row]:.4f}", sides,
                f"{postures.candidates.conditioning[row]:.4f}",
            ])  # fmt: skip
    return csv_text([("target", "rank", *names), *lines])


def _joint_names(robot: Robot) -> list[str]:
    return [*joint_columns(len(robot.axes)), *((RAIL,) if robot.rail else ())]


def _joint_cells(postures: Postures, row: int) -> list[str]:
    axes, q = len(postures.rig.robot.axes), postures.candidates.q[row]
    return [*(f"{angle:z.6f}" for angle in np.degrees(q[:axes])), *(f"{RAIL_MM * stand:z.4f}" for stand in q[axes:])]


def _error_cells(postures: Postures, row: int) -> list[str]:
    errors = postures.errors
    size = "" if postures.knowledge == "typical" else f"{errors.size_mm[row]:.4f}"
    region = "unknown" if errors.covered is None else "yes" if errors.covered[row] else "no"
    return [size, f"{errors.u_mm[row]:.4f}", region]
