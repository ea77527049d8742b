"""How an answer about a cell is judged: told, names, the first act done in the simulator, processor time.

A name counts as certain if it is a fault (it stands) or its odds are at least 95 %. It is right if the cell hides it in
about that size, related if a metrologist would accept it for the unknown cause, else wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.worlds.unknown.arms import Array, forward
from tests.worlds.unknown.ball import TOOL
from tests.worlds.unknown.cells import Cell, elsewhere, points_elsewhere, tool_point

CERTAIN = 0.95
TOLD_SHARE = 0.05
"""Share of the error's energy from which an unexplained remainder counts as said: the same as docs/diagnosis.md."""
IMITATED = 0.5
"""A calibrated model imitates a cause if no more than half of its foreign part is left elsewhere (a quarter of its
energy)."""
WORSE = 1.05
"""An act makes things worse if more than this times the error is there afterwards."""
_SIZE_U, _SIZE_SHARE = 3.0, 0.5
"""A name's size is right within three of its uncertainties, or within half of the hidden size."""
_TOLD = ("outside_library", "out_of_range")


@dataclass(frozen=True)
class Verdict:
    """What is counted of one answer. before_um, after_um: error at a place that had no part, without and with the
    first act; calibrated_um: with the calibrated model (NaN if there is none). imitated: that model predicts most of
    the cause at this place, though nothing names it."""

    condition: str
    told: bool
    imitated: bool
    right: list[str] = field(default_factory=list)
    related: list[str] = field(default_factory=list)
    wrong_faults: list[str] = field(default_factory=list)
    wrong_certain: list[str] = field(default_factory=list)
    act: str = "none"
    before_um: float = np.nan
    after_um: float = np.nan
    calibrated_um: float = np.nan
    cpu_s: float = np.nan

    @property
    def worse(self) -> bool:
        return bool(self.after_um > WORSE * self.before_um)

    def as_json(self) -> dict[str, Any]:
        """Return plain values; NaN as None."""
        plain = asdict(self) | {"worse": self.worse}
        return {key: None if isinstance(value, float) and np.isnan(value) else value for key, value in plain.items()}


def judge(cell: Cell, answer: Mapping[str, Any], found: Path) -> Verdict:
    """Judge an answer; found: the directory with the calibrated rig file."""
    names: dict[str, list[str]] = {"right": [], "related": [], "wrong_faults": [], "wrong_certain": []}
    for effect in answer.get("effects") or []:
        kind = judge_name(cell, effect)
        listed = {"right": ["right"], "related": ["related"], "wrong": ["wrong_certain"]}.get(kind, [])
        for name in [*listed, *["wrong_faults"] * (kind == "wrong" and bool(effect.get("stands")))]:
            names[name].append(_label(effect))
    acts = answer.get("acts") or []
    before, after, calibrated = first_act_um(cell, answer, found)
    return Verdict(
        condition=str(answer.get("condition")),
        told=was_told(answer),
        imitated=bool(calibrated <= IMITATED * np.sqrt(3) * cell.foreign_um) and cell.cause is not None,
        **names,
        act=" ".join(str(acts[0].get(key) or "") for key in ("kind", "why", "effect")).strip() if acts else "none",
        before_um=before,
        after_um=after,
        calibrated_um=calibrated,
        cpu_s=float(answer.get("cpu_s", np.nan)),
    )


def was_told(answer: Mapping[str, Any]) -> bool:
    """True if the answer reports an unknown cause: an unexplained error, a movement, or unusual scatter."""
    unexplained, remainder = answer.get("unexplained") or {}, answer.get("remainder") or {}
    unusual = any(unexplained.get(name) for name in ("visits_um", "unrepeated_um", "gauges_um", "scatter_um"))
    if unusual or remainder.get("is_material"):
        return True
    if answer.get("condition") in _TOLD or answer.get("movements"):
        return True
    if any(act.get("why") == "unexplained" for act in (answer.get("acts") or [])[:1]):
        return True
    return float(remainder.get("share") or 0.0) >= TOLD_SHARE


def judge_name(cell: Cell, effect: Mapping[str, Any]) -> str:
    """Return `right`, `related`, `ambiguous` or `wrong` of a certain name, an empty text of any other.

    A fault whose odds are below 95 % is ambiguous if a likely rival of it is right or related.
    """
    has_high_odds = float(effect.get("posterior") or 0.0) >= CERTAIN
    if not (effect.get("stands") or has_high_odds):
        return ""
    kind = truth_of_name(cell, effect)
    open_rivals = [] if has_high_odds else effect.get("rivals") or []
    likely = [rival for rival in open_rivals if float(rival.get("posterior") or 0.0) >= 1 - CERTAIN]
    if kind == "wrong" and any(truth_of_name(cell, rival) != "wrong" for rival in likely):
        return "ambiguous"
    return kind


def truth_of_name(cell: Cell, effect: Mapping[str, Any]) -> str:
    """Return `right`, `related` or `wrong` of any name, whatever its probability."""
    name = str(effect.get("name"))
    twins = [str(twin.get("name") if isinstance(twin, Mapping) else twin) for twin in effect.get("twins") or []]
    hidden = cell.known.names()
    if any(one in hidden for one in (name, *twins)):
        size, u = _size_of(effect)
        truth = sum(hidden.get(one, 0.0) for one in (name, *twins))
        if abs(abs(size) - abs(truth)) <= max(_SIZE_U * u, _SIZE_SHARE * abs(truth)):
            return "right"
    cause = cell.cause
    if cause is not None and any(word in name for word in cause.related):
        axis = effect.get("axis")
        if not cause.axis or axis is None or axis == cause.axis:
            return "related"
    return "wrong"


def _size_of(effect: Mapping[str, Any]) -> tuple[float, float]:
    """Main size of an effect and its standard uncertainty."""
    for key, given in (effect.get("parameters") or {}).items():
        if isinstance(given, Mapping) and given.get("sd") is not None and "phase" not in key and "order" not in key:
            return float(given["value"]), float(given["sd"])
    return np.nan, np.nan


def _label(effect: Mapping[str, Any]) -> str:
    size, u = _size_of(effect)
    odds = 100 * float(effect.get("posterior") or 0.0)
    mark = "fault" if effect.get("stands") else str(effect.get("doubt"))
    return f"{effect.get('name')} {size:.3g} ± {u:.1g} ({odds:.0f} %, {mark})"


# --- the first act, done


def first_act_um(cell: Cell, answer: Mapping[str, Any], found: Path) -> tuple[float, float, float]:
    """Error (µm rms) elsewhere now, after the first act, and with the calibrated model."""
    motion = elsewhere(cell)
    truth = points_elsewhere(cell, motion)
    before = _error_um(cell, truth, forward(cell.nominal, motion.q_read).flange)
    calibrated = calibrated_um(cell, motion.q_read, truth, found)
    acts = answer.get("acts") or []
    kind, effect = (acts[0].get("kind"), str(acts[0].get("effect") or "")) if acts else (None, "")
    if kind in ("load", "enter"):
        return before, calibrated if np.isfinite(calibrated) else before, calibrated
    repaired = after_repair(cell, kind, effect, answer)
    if repaired is cell:
        return before, before, calibrated
    truth = points_elsewhere(repaired, motion)
    return before, _error_um(cell, truth, forward(cell.nominal, motion.q_read).flange), calibrated


def after_repair(cell: Cell, kind: str | None, effect: str, answer: Mapping[str, Any]) -> Cell:
    """Cell after a repair or a new zero of the named part; the same cell if that changes nothing in it."""
    name, _, axis = effect.partition(" ")
    if kind == "remaster" and name == "joint_offset":
        named: Mapping[str, Any] = next((one for one in answer.get("effects") or [] if one.get("name") == effect), {})
        zero = cell.known.zero.copy()
        zero[int(axis) - 1] -= np.radians(np.nan_to_num(_size_of(named)[0]))
        return replace(cell, known=replace(cell.known, zero=zero))
    if kind != "repair":
        return cell
    cause = cell.cause
    if cause is not None and any(word in effect for word in cause.related) and axis in ("", str(cause.axis)):
        return cell.sound()
    part = {"backlash": "play", "compliance": "compliance"}.get(name)
    if part is None or not axis.isdigit():
        return cell
    sizes = getattr(cell.known, part).copy()
    sizes[int(axis) - 1] = 0.0
    return replace(cell, known=replace(cell.known, **{part: sizes}))


def calibrated_um(cell: Cell, q: Array, truth: Array, found: Path) -> float:
    """Error of the calibrated model, µm rms; NaN without one."""
    from analysis import RigError, calibrated_arm  # noqa: PLC0415 - the one place that asks rig's Python API

    files = sorted(found.glob("*.yaml")) if found.exists() else []
    if not files or not list(found.glob("*.calibration.json")):
        return float("nan")
    try:
        T = calibrated_arm(files[0]).forward(np.degrees(q)).T
    except RigError:
        return float("nan")
    T = np.array(T, dtype=float)
    flange = T @ np.linalg.inv(TOOL) if cell.test == "circle" else T
    return _error_um(cell, truth, flange)


def _error_um(cell: Cell, truth: Array, flange: Array) -> float:
    """Rms distance (µm) of the true points from those of a model, frame and tool's point fitted."""
    at = np.einsum("nij,j->ni", flange[:, :3, :3], tool_point(cell)) + flange[:, :3, 3]
    error = truth - at
    columns = [np.broadcast_to(np.eye(3)[k], at.shape) for k in range(3)]
    columns += [np.cross(np.eye(3)[k], at - at.mean(axis=0)) for k in range(3)]
    columns += [flange[:, :3, k] for k in range(3)]
    A = np.stack([column.ravel() for column in columns], axis=1)
    rest = error.ravel() - A @ np.linalg.lstsq(A, error.ravel(), rcond=1e-9)[0]
    return 1e3 * float(np.sqrt(np.mean(rest.reshape(-1, 3) ** 2 @ np.ones(3))))
