"""Model of the live view: samples and states as displayed values, without terminal, clock or socket."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from analysis.apps.live.lap import JointMotion, LapProgress, LiveReversal, Sweep
from analysis.apps.live.live_rows import NO_ROWS, LiveCell, LiveRows
from analysis.robot.kinematics.arm import Array, Mask
from rigs.schema.vocabulary import Direction, TestName

_KEPT_ROWS = 6000
"""Number of rows: a minute at 100 Hz."""
_KEPT_EVENTS = 200
_TREND_S = 2.0
_LEAST_TREND = 4
"""Minimum number of rows for a trend."""


@dataclass(frozen=True)
class GaugeReading:
    mm: float
    age_s: float


@dataclass(frozen=True)
class Played:
    name: str
    at_s: float
    of_s: float
    speed: float
    ended: bool = False


@dataclass(frozen=True)
class Update:
    """Changes since the previous update. None and empty fields mean no change."""

    rows: LiveRows = NO_ROWS
    readings: Mapping[str, GaugeReading] | None = None
    state: dict[str, Any] | None = None
    cell: LiveCell | None = None
    lost: str = ""
    notice: str = ""
    label: tuple[str, TestName, Direction | None] | None = None
    played: Played | None = None


@dataclass(frozen=True)
class LiveEvent:
    t_s: float
    words: str
    reversal: LiveReversal | None = None


@dataclass(frozen=True)
class LiveView:
    cell: LiveCell | None = None
    rows: LiveRows = NO_ROWS
    phi: Array = field(default_factory=lambda: np.empty(0))
    readings: Mapping[str, GaugeReading] = field(default_factory=dict)
    extremes_mm: Array | None = None
    """Smallest and largest reading of each gauge (2, 2); nan before the first."""
    lap: LapProgress = field(default_factory=LapProgress)
    acw: Sweep = field(default_factory=Sweep)
    cw: Sweep = field(default_factory=Sweep)
    joints: JointMotion = field(default_factory=JointMotion)
    events: tuple[LiveEvent, ...] = ()
    reversal_counts: tuple[int, ...] = (0,) * 6
    last_reversals: Mapping[int, LiveReversal] = field(default_factory=dict)
    state: dict[str, Any] | None = None
    lost: str = ""
    cut: str = ""
    """Message about a recording interrupted by the loss of the daemon, until the next recording starts."""
    played: Played | None = None
    name: str | None = None
    """Name, test and direction of the recording or the played run."""
    test: str | None = None
    direction: Direction | None = None
    shown_test: str | None = None

    def after(self, update: Update) -> LiveView:
        # Only data proves that the daemon has returned: refused requests also arrive while it is lost.
        lost = self.lost if not update.lost and update.readings is None else update.lost
        view = replace(self, lost=lost, played=update.played)
        if bool(lost) != bool(self.lost):
            during = f" while {self.name} is recorded" if self.name else ""
            view = view._with_words([f"rigd does not answer{during}" if lost else "rigd answers again"])
        if update.cell is not None:
            events = tuple(event for event in view.events if event.reversal is None)
            view = LiveView(update.cell, state=self.state, cut=self.cut, events=events, played=update.played)
        if update.label is not None:
            view = view.labelled(*update.label)
        if (state := update.state) is not None:
            words = [*_recording_changes(view.state, state), *_new_faults(view.state, state)]
            cut = _cut(view.state, state) or ("" if state["recording"] or state.get("last_end") else view.cut)
            view = replace(view, state=state, cut=cut)._with_words(words)
            is_recording = state["recording"] is not None
            view = view.labelled(*(state[key] if is_recording else None for key in ("recording", "test", "direction")))
        if update.notice:
            view = view._with_words([update.notice])
        if update.readings is not None:
            view = replace(view, readings=update.readings)
        return view._with_rows(update.rows) if len(update.rows) else view

    def labelled(self, name: str | None, test: str | None, direction: Direction | None) -> LiveView:
        """View of a new recording: laps are counted from now, and its curve replaces the last in this direction."""
        if (name, test, direction) == (self.name, self.test, self.direction):
            return self
        view = replace(self, name=name, test=test, direction=direction)
        if name is None:
            return view
        kept = test == self.shown_test
        return replace(
            view,
            shown_test=test,
            lap=LapProgress(),
            joints=JointMotion(),
            acw=self.acw if kept and direction == "cw" else Sweep(),
            cw=self.cw if kept and direction == "acw" else Sweep(),
        )

    def restarted(self) -> LiveView:
        reset = ("extremes_mm", "lap", "acw", "cw", "joints", "events", "reversal_counts", "last_reversals")
        fresh = LiveView()
        return replace(self, **{name: getattr(fresh, name) for name in reset})

    @property
    def trends_mm_s(self) -> Array:
        recent = self.since(_TREND_S)
        slopes = np.full(2, np.nan)
        for k in range(2):
            finite = np.isfinite(recent.g_mm[:, k])
            if finite.sum() >= _LEAST_TREND and np.ptp(recent.t_s[finite]) > 0:
                t_s = recent.t_s[finite] - recent.t_s[finite].mean()
                slopes[k] = float(t_s @ recent.g_mm[finite, k] / (t_s @ t_s))
        return slopes

    def since(self, seconds: float) -> LiveRows:
        if not len(self.rows):
            return self.rows
        return self.rows.select_rows(slice(int(np.searchsorted(self.rows.t_s, self.rows.t_s[-1] - seconds)), None))

    @property
    def reversals(self) -> list[LiveReversal]:
        return [event.reversal for event in self.events if event.reversal]

    def _with_events(self, events: Iterable[LiveEvent]) -> LiveView:
        return replace(self, events=(*self.events, *events)[-_KEPT_EVENTS:])

    def _with_words(self, words: Iterable[str]) -> LiveView:
        at_s = float(self.rows.t_s[-1]) if len(self.rows) else 0.0
        return self._with_events(LiveEvent(at_s, sentence) for sentence in words)

    def _with_rows(self, rows: LiveRows) -> LiveView:
        extremes = np.stack([np.fmin.reduce(rows.g_mm, axis=0), np.fmax.reduce(rows.g_mm, axis=0)], axis=1)
        if self.extremes_mm is not None:
            smallest = np.fmin(self.extremes_mm[:, 0], extremes[:, 0])
            extremes = np.stack([smallest, np.fmax(self.extremes_mm[:, 1], extremes[:, 1])], axis=1)
        kept = self.rows.followed_by(rows, _KEPT_ROWS)
        view = replace(self, rows=kept, extremes_mm=extremes)
        if self.cell is None:
            return replace(view, phi=np.full(len(kept), np.nan))
        phi = self.cell.phi(rows.q)
        lap, sense, share = self.lap.after(phi, self.cell.start_rad, self.cell.lead_rad)
        joints, turned = self.joints.after(rows, phi, sense)
        # Lead-in and lead-out do not belong to a lap: joints reverse there that do not reverse there in the lap.
        lead = self.cell.lead_rad / (2 * np.pi)
        inside: Mask = (share >= 0) & ((share < 1) | (share % 1 > lead))
        values = np.where(inside, self.cell.error_source(rows.g_mm), np.nan)

        def swept(sweep: Sweep, direction: Direction, sign: int) -> Sweep:
            if self.direction not in (None, direction):  # a return between laps measures nothing
                return sweep
            return sweep.after(phi, np.where(sign * sense > 0, values, np.nan))

        counts = Counter(reversal.axis for reversal in turned)
        return replace(
            view._with_events(LiveEvent(reversal.t_s, "", reversal) for reversal in turned),
            reversal_counts=tuple(count + counts[axis] for axis, count in enumerate(self.reversal_counts, start=1)),
            last_reversals={**self.last_reversals, **{reversal.axis: reversal for reversal in turned}},
            lap=lap,
            joints=joints,
            phi=np.concatenate([self.phi, phi])[-_KEPT_ROWS:],
            acw=swept(self.acw, "acw", 1),
            cw=swept(self.cw, "cw", -1),
        )


def _recording_changes(before: dict[str, Any] | None, state: dict[str, Any]) -> list[str]:
    if before is None or _run_of(before) == _run_of(state):
        return []
    words = []
    if before["recording"]:
        why = f": {state['last_end']}" if state.get("last_end") else ""
        words.append(_cut(before, state) or f"recording {before['recording']} ended{why}")
    if state["recording"]:
        words.append(f"recording {state['recording']} began: {_run_of(state)}")
    return words


def _cut(before: dict[str, Any] | None, state: dict[str, Any]) -> str:
    """Message about a recording lost with the daemon: a new daemon does not know it."""
    if before is None or not before["recording"] or state["recording"] or state["last_end"]:
        return ""
    return f"recording {before['recording']} was interrupted: rigd was restarted"


def _run_of(state: dict[str, Any]) -> str | None:
    run: str | None = state.get("run", state["recording"])
    return run


def _new_faults(before: dict[str, Any] | None, state: dict[str, Any]) -> list[str]:
    """Faults since the last state, and connections that were made or lost."""
    words = []
    for name, stream in state["streams"].items():
        if before is None or (old := before["streams"].get(name)) is None:
            continue
        gained = Counter(stream["counters"]) - Counter(old["counters"])
        del gained["samples"]
        if gained:
            listed = ", ".join(f"{count} {kind}" for kind, count in gained.items())
            words.append(f"{name}: {listed}: {stream['last_fault']}")
        elif old["connected"] != stream["connected"]:
            words.append(f"{name}: {'connected' if stream['connected'] else 'connection lost'}")
    return words
