"""Rows of a live view: gauges and joints at the times of gauge 1, joined by their arrival (`analysis.runs.align`: by
fitted clocks)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from analysis.robot.geometry.circle import CircleFrame, frame_of, link_angle
from analysis.robot.kinematics.arm import Arm, Array, arm_of, forward
from analysis.runs.laps import is_on_circle
from rigs.rig import Rig

GAUGES = ("g1", "g2")
ROBOT = "robot"
_SILENT_S = 1.0
"""Delay after which the view stops waiting for a stream. Polled instruments answer several times a second."""
_GAP_S = 0.5
"""Longest interval for interpolation: values across a longer gap are not measurements."""


@dataclass(frozen=True)
class LiveRows:
    """Rows in order of t_s (n,). g_mm (n, 2) and q (n, 6) in rad are nan if missing."""

    t_s: Array
    g_mm: Array
    q: Array

    def __len__(self) -> int:
        return len(self.t_s)

    def select_rows(self, rows: slice) -> LiveRows:
        return LiveRows(self.t_s[rows], self.g_mm[rows], self.q[rows])

    def followed_by(self, newer: LiveRows, most: int) -> LiveRows:
        """The last `most` of these and newer rows."""
        if not len(newer):
            return self
        parts = ((self.t_s, newer.t_s), (self.g_mm, newer.g_mm), (self.q, newer.q))
        return LiveRows(*(np.concatenate(pair)[-most:] for pair in parts))


NO_ROWS = LiveRows(np.empty(0), np.empty((0, 2)), np.empty((0, 6)))


@dataclass(frozen=True)
class LiveTrack:
    """Samples of an instrument: ordered times t_s (n,) and values (n, k) in mm or rad."""

    t_s: Array
    values: Array


@dataclass(frozen=True)
class Joiner:
    """Samples of each instrument that wait for the others; silent ones are not waited for, and are nan."""

    tracks: Mapping[str, LiveTrack]
    until_s: float = -np.inf
    """Time of the last joined row."""

    def joined(self, new: Mapping[str, LiveTrack]) -> tuple[Joiner, LiveRows]:
        tracks = {**self.tracks, **new}
        for name, newer in new.items():
            if (track := self.tracks.get(name)) is not None and len(track.t_s):
                later = newer.t_s > track.t_s[-1]  # out-of-order samples are dropped
                values = np.concatenate([track.values, newer.values[later]], axis=0)
                tracks[name] = LiveTrack(np.concatenate([track.t_s, newer.t_s[later]]), values)
        tracks = {name: track for name, track in tracks.items() if len(track.t_s)}
        if not tracks:
            return self, NO_ROWS
        newest_s = max(float(track.t_s[-1]) for track in tracks.values())
        awake = {name: track for name, track in tracks.items() if track.t_s[-1] > newest_s - _SILENT_S}
        lead = next(awake[name] for name in (*GAUGES, ROBOT) if name in awake)
        ready_s = min(float(track.t_s[-1]) for track in awake.values())
        t_s = lead.t_s[(lead.t_s > self.until_s) & (lead.t_s <= ready_s)]
        gauges = [_at(t_s, awake.get(name), 1) for name in GAUGES]
        rows = LiveRows(t_s, np.concatenate(gauges, axis=1), _at(t_s, awake.get(ROBOT), 6))
        until_s = float(t_s[-1]) if len(t_s) else self.until_s
        kept = {}
        for name, track in tracks.items():
            # keep the sample before the others, needed for interpolation
            first = max(0, int(np.searchsorted(track.t_s, ready_s - _SILENT_S)) - 1)
            kept[name] = LiveTrack(track.t_s[first:], track.values[first:])
        return replace(self, tracks=kept, until_s=until_s), rows


NO_TRACKS = Joiner({})


def _at(t_s: Array, track: LiveTrack | None, count: int) -> Array:
    """Values (n, count) at times t_s (n,); nan outside a track and in gaps."""
    if track is None:
        return np.full((len(t_s), count), np.nan)
    values = np.stack([np.interp(t_s, track.t_s, column) for column in track.values.T], axis=1)
    after = np.searchsorted(track.t_s, t_s).clip(0, len(track.t_s) - 1)
    before = (np.searchsorted(track.t_s, t_s, side="right") - 1).clip(0)
    values[track.t_s[after] - track.t_s[before] > _GAP_S] = np.nan
    values[(t_s < track.t_s[0]) | (t_s > track.t_s[-1])] = np.nan
    return values


@dataclass(frozen=True)
class LiveCell:
    name: str
    arm: Arm
    axes: tuple[str, ...]
    baseline_mm: float
    """0 for a single gauge."""
    frame: CircleFrame | None
    start_rad: float
    lead_rad: float
    laps: int
    range_mm: tuple[tuple[float, float] | None, ...]
    """Certified range of each gauge."""
    signs: tuple[int, ...]
    """Signs that make the readings increase with the distance from the ball."""

    def phi(self, q: Array) -> Array:
        """Circle angles (n,), 0 … 2 pi, of joint angles q (n, 6) in rad; nan off the circle."""
        phi = np.full(len(q), np.nan)
        known_rows = np.isfinite(q).all(axis=1)
        if self.frame is not None and known_rows.any():
            tool = forward(self.arm, q[known_rows])[:, :3, 3]
            phi[known_rows] = np.where(is_on_circle(tool, self.frame), self.frame.angle(tool) % (2 * np.pi), np.nan)
        return phi

    def error_source(self, g_mm: Array) -> Array:
        """Values (n,) drawn around the circle: angles in rad for two gauges, otherwise distances in mm."""
        return link_angle(g_mm[:, 0], g_mm[:, 1], self.baseline_mm) if self.has_angle else g_mm[:, 0]

    @property
    def has_angle(self) -> bool:
        return self.baseline_mm != 0


def cell_of(rig: Rig) -> LiveCell:
    circle, ranges = rig.tests.circle, list[tuple[float, float] | None]()
    for _, gauge in rig.gauges:
        certified = gauge.certificate and gauge.certificate.valid_mm
        low, high = sorted(gauge.sign * end for end in certified or (0.0, 0.0))
        ranges.append((low, high) if certified else None)
    return LiveCell(
        rig.name,
        arm_of(rig.robot),
        tuple(axis.name for axis in rig.robot.axes),
        rig.gauges.baseline_mm if rig.gauges.g2 else 0.0,
        frame_of(circle) if circle else None,
        float(np.radians(circle.start_deg)) if circle else 0.0,
        float(np.radians(circle.lead_deg)) if circle else 0.0,
        circle.laps if circle else 0,
        tuple(ranges),
        tuple(gauge.sign for _, gauge in rig.gauges),
    )
