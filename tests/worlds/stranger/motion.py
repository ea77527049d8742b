"""Robot motions and reading times: laps with smooth starts, or stops at targets; angles in rad, lengths in mm.

Motions are sampled finely, and the reading times are among the samples, so nothing is interpolated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tests.worlds.stranger.cell import Cell, Place
from tests.worlds.stranger.reach import OutOfReachError, solve, walk
from tests.worlds.stranger.screws import Array, pose

_RAMP_S = 0.55
_LEAN = 0.5
_TILT = np.radians(20.0)
Rows = NDArray[np.int64]


@dataclass(frozen=True)
class Motion:
    """A motion: t (n,) s, motor angles q (n, 6) rad, rows (m,) of the readings; test `yaw`, `roll` or `radial`;
    sense ±1 of a circle; labels (m,) of a radial run by column.
    """

    test: str
    t: Array
    q: Array
    rows: Rows
    place: Place
    sense: int = 0
    labels: dict[str, Array] | None = None


def circle_frames(place: Place, phi: Array) -> tuple[Array, Array]:
    """Tool frames R (n, 3, 3), p (n, 3) according to measurement.md: P = C + R r, z = -r, x = n, y = z ×
    x.
    """
    r = np.cos(phi)[:, None] * place.u + np.sin(phi)[:, None] * place.v
    x = np.broadcast_to(place.n, r.shape)
    return np.stack([x, np.cross(-r, x), -r], axis=2), place.centre + place.radius * r


@dataclass(frozen=True)
class Track:
    """A circle as angles q (n, 6) over the acw arc psi (n,) rad, including lead-in and lead-out."""

    place: Place
    psi: Array
    q: Array


def track_of(cell: Cell, place: Place) -> Track:
    """Solve a circle. Raises OutOfReachError if the arm cannot drive it within its limits and half its speeds."""
    lead = max(place.lead, 0.02)
    psi = np.linspace(-lead - 0.01, 2 * np.pi + lead + 0.01, 800)
    R, p = circle_frames(place, place.start + psi)
    q = walk(cell.arm, R, p, place.posture, 10)
    if (q < cell.limits[:, 0]).any() or (q > cell.limits[:, 1]).any():
        raise OutOfReachError("beyond the limits")
    rate = np.abs(np.diff(q, axis=0)).max(axis=0) / (psi[1] - psi[0]) * place.speed / place.radius
    if (rate > cell.speeds / 2).any():
        raise OutOfReachError("too near a singularity")
    return Track(place, psi, q)


def lap(cell: Cell, track: Track, test: str, sense: int, stamps: Array, fine_s: float = 0.01, laps: int = 1) -> Motion:
    """Return laps, acw (+1) or cw (-1), with readings at `stamps` (m,) s up to the end of the motion.

    A cw lap has the same angles in reverse. The run includes half a second at rest before and after. Between two laps
    the robot returns along the same path at twice the speed.
    """
    place = track.place
    length = 2 * np.pi + 2 * place.lead
    speed = place.speed / place.radius
    there, back = length / speed + _RAMP_S + 1.0, length / (2 * speed) + _RAMP_S + 1.0
    seconds = laps * there + (laps - 1) * back
    stamps = stamps[stamps <= seconds]
    t = np.union1d(np.arange(0.0, seconds, fine_s), stamps)
    psi = np.full(len(t), -place.lead)
    for k in range(laps):
        begin = k * (there + back) + 0.5
        psi += _way(t - begin, length, speed)
        if k < laps - 1:
            psi -= _way(t - begin - there, length, 2 * speed)
    psi = psi if sense > 0 else 2 * np.pi - psi
    guess = np.stack([np.interp(psi, track.psi, column) for column in track.q.T], axis=1)
    R, p = circle_frames(place, place.start + psi)
    return Motion(test, t, solve(cell.arm, R, p, guess), np.searchsorted(t, stamps), place, sense)


def _way(t: Array, length: float, speed: float) -> Array:
    """Arc (n,) rad driven at times t (n,) s, from rest to rest."""
    return np.asarray(speed * (_soft(t) - _soft(t - length / speed)))


def _soft(t: Array) -> Array:
    """Time integral of the relative speed, which rises as (1 - cos)/2 over the start ramp."""
    s = np.clip(t, 0.0, _RAMP_S)
    return s / 2 - _RAMP_S / (2 * np.pi) * np.sin(np.pi * s / _RAMP_S) + np.maximum(t - _RAMP_S, 0.0)


def targets(cell: Cell) -> dict[str, Array]:
    """Return labels and angles of the hemisphere targets within reach: number from 1, polar, azimuth, orientation.

    They are ordered from the pole, ring by ring. The tool leans halfway to the radius; orientations are tilts about its
    x axis.
    """
    rings = np.arange(1, 4) * np.pi / 6
    polar = np.concatenate([[0.0], np.repeat(rings, 12)])
    azimuth = np.concatenate([[0.0], np.tile(np.arange(12) * np.pi / 6, 3)])
    number = np.repeat(np.arange(1, len(polar) + 1), 3)
    found: dict[str, list[Array]] = {key: [] for key in ("target", "polar", "azimuth", "orientation", "q")}
    for k, orientation in zip(number, np.tile([1, 2, 3], len(polar)), strict=True):
        R, p = _target_frame(cell.hemisphere, polar[k - 1], azimuth[k - 1], _TILT * (orientation - 2))
        q = _reached(cell, R, p, found["q"][-1:])
        if q is None:
            continue
        for key, value in zip(found, (k, polar[k - 1], azimuth[k - 1], orientation, q), strict=True):
            found[key].append(value)
    return {key: np.array(values) for key, values in found.items()}


def _reached(cell: Cell, R: Array, p: Array, before: list[Array]) -> Array | None:
    """Return angles (6,) within the limits, starting from the posture or from previous targets; None if there are
    none.
    """
    for start in (cell.hemisphere.posture, *before):
        try:
            q: Array = solve(cell.arm, R[None], p[None], start[None])[0]
        except (OutOfReachError, np.linalg.LinAlgError):
            continue
        if (q >= cell.limits[:, 0]).all() and (q <= cell.limits[:, 1]).all():
            return q
    return None


def _target_frame(place: Place, polar: float, azimuth: float, tilt: float) -> tuple[Array, Array]:
    out = np.cos(azimuth) * place.u + np.sin(azimuth) * place.v
    towards = np.cos(polar) * place.n + np.sin(polar) * out
    z = -(np.cos(_LEAN * polar) * place.n + np.sin(_LEAN * polar) * out)
    # The x axis of the tool is as close to u as the lean allows.
    half = np.cross(place.n, out)
    x = _about(half, _LEAN * polar, place.u)
    y = np.cross(z, x)
    c, s = np.cos(tilt), np.sin(tilt)
    R = np.stack([x, c * y + s * z, c * z - s * y], axis=1)
    return R, place.centre + place.radius * towards


def _about(axis: Array, angle: float, x: Array) -> Array:
    return np.cos(angle) * x + np.sin(angle) * np.cross(axis, x) + (1 - np.cos(angle)) * (axis @ x) * axis


def visits(cell: Cell, at: dict[str, Array], order: Rows, dwell_s: Array) -> Motion:
    """Return visits of targets in an order, each read after its dwell time (m,) s, with synchronous smooth joint
    moves.
    """
    q_at = at["q"][order]
    share = (1 - np.cos(np.pi * np.arange(1, 7) / 6)) / 2
    t, q, rows, now = [0.0], [q_at[0]], [], 0.0
    for k in range(len(order)):
        if k:
            seconds = max(0.8, float(np.abs(q_at[k] - q_at[k - 1]).max() / np.radians(30)))
            t += list(now + seconds * np.arange(1, 7) / 6)
            q += list(q_at[k - 1] + share[:, None] * (q_at[k] - q_at[k - 1]))
            now += seconds
        t += [now + 0.6 * dwell_s[k], now + dwell_s[k], now + dwell_s[k] + 0.3]
        q += [q_at[k]] * 3
        rows.append(len(t) - 2)
        now += dwell_s[k] + 0.3
    labels = {key: at[key][order] for key in at if key != "q"}
    return Motion("radial", np.array(t), np.array(q), np.array(rows), cell.hemisphere, 0, labels)


def approaches(cell: Cell, at: dict[str, Array], numbers: list[int], step_mm: float, rounds: int) -> Motion:
    """A repeatability test: at each target a reading, then `rounds` times one after an approach from outside
    and one from inside, over `step_mm` along the radius, in the middle orientation.
    """
    q, labels, read = [], [], []
    for number in numbers:
        (k,) = np.nonzero((at["target"] == number) & (at["orientation"] == 2))
        if not len(k):
            continue
        here = at["q"][k[0]]
        frame = pose(cell.arm, here[None])
        out = frame.p - cell.hemisphere.centre
        out = step_mm * out / np.linalg.norm(out)
        aside = {way: solve(cell.arm, frame.R, frame.p + s * out, here[None])[0] for way, s in (("out", 1), ("in", -1))}
        for way, turn in [("none", 1), *((way, r + 1) for r in range(rounds) for way in ("out", "in"))]:
            if way != "none":
                q.append(aside[way])
                read.append(False)
            q.append(here)
            read.append(True)
            labels.append((number, way, turn))
    stops = visits(cell, {"q": np.array(q)}, np.arange(len(q)), np.full(len(q), 2.0))
    columns = dict(zip(("target", "approach", "round"), map(np.array, zip(*labels, strict=True)), strict=True))
    return replace(stops, rows=stops.rows[np.array(read)], labels=columns)
