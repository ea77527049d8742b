"""Independently simulated robot motions around circles with known centres. Nothing here is imported from rig.

The kinematics multiply scipy rotations, the inverse kinematics is a separate Newton iteration, and the noise has
properties that the model of rig lacks. The arms are the shipped arms with changed lengths. Each motion has its own rig
file.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
RIGS = Path(__file__).parents[2] / "rigs"
POSTURES = {
    "paper-fanuc": (-2.8, 35.8, 7.6, 171.0, 136.6, -5.7),
    "ur10e": (2, -75.3, 101.4, 55.2, 84.6, 107.8),
    "ur10": (2, -75, 101, 55, 85, 108),
}
LENGTHS = ("a_mm", "d_mm")
Kind = Literal["arc", "lap", "stands"]


@dataclass(frozen=True)
class Motion:
    """A motion with its rig file: reported times t_s (n,) and angles q (n, 6) rad; true centre (3,) mm, normal (3,)
    and radius.
    """

    rig_text: str
    t_s: Array
    q: Array
    direction: Literal["acw", "cw"]
    centre: Array
    normal: Array
    radius: float
    arc_deg: float


class Chain:
    """Forward kinematics of the arm in a rig file, as a product of rotations."""

    def __init__(self, robot: dict) -> None:
        self.axes = robot["axes"]
        self.coupling = np.array(robot.get("coupling", np.eye(6)), dtype=float)
        self.tool = robot["tool"]

    def tool_at(self, q: Array) -> tuple[Array, Array]:
        """Return rotation (n, 3, 3) and position (n, 3) mm of the tool at reported angles q (n, 6) rad."""
        theta = q @ self.coupling.T
        turn, place = Rotation.from_matrix(np.tile(np.eye(3), (len(q), 1, 1))), np.zeros((len(q), 3))
        for k, axis in enumerate(self.axes):
            turn = turn * Rotation.from_euler("x", axis.get("alpha_deg", 0.0), degrees=True)
            place = place + turn.apply([axis.get("a_mm", 0.0), 0.0, 0.0])
            turn = turn * Rotation.from_rotvec(
                np.outer(theta[:, k] + np.radians(axis.get("offset_deg", 0.0)), [0, 0, 1.0])
            )
            place = place + turn.apply([0.0, 0.0, axis.get("d_mm", 0.0)])
        place = place + turn.apply(self.tool["xyz_mm"])
        turn = turn * Rotation.from_euler("xyz", self.tool.get("rpy_deg", [0, 0, 0]), degrees=True)
        return turn.as_matrix(), place

    def angles_at(self, turn: Array, place: Array, q: Array) -> Array | None:
        """Angles (6,) rad near q for a tool pose: rotation (3, 3), position (3,) mm. None if Newton does
        not converge.
        """
        for _ in range(20):
            tried = np.concatenate([q[None], q + 1e-6 * np.eye(6)])
            R, p = self.tool_at(tried)
            spun = Rotation.from_matrix(turn @ np.swapaxes(R, 1, 2)).as_rotvec()
            away = np.concatenate([(place - p) / 500, spun], axis=1)
            if np.abs(away[0]).max() < 1e-12:
                return q
            step = np.linalg.lstsq((away[1:] - away[0]).T / 1e-6, -away[0], rcond=1e-9)[0]
            q = q + np.clip(step, -0.3, 0.3)
        return None


def drawn(seed: int, kind: Kind) -> Motion:
    """Motion for a seed: an arc of 40° to 300°, one or two laps, continuous or with returns, or a series
    of stops.
    """
    for again in range(100):
        rng = np.random.default_rng((seed, again, ("arc", "lap", "stands").index(kind)))
        motion = _drawn(rng, kind)
        if motion is not None:
            return motion
    raise AssertionError("no circle was within reach")


def _drawn(rng: np.random.Generator, kind: Kind) -> Motion | None:
    name = str(rng.choice(list(POSTURES)))
    data = yaml.safe_load((RIGS / f"{name}.yaml").read_text(encoding="utf-8"))
    scale = rng.uniform(0.6, 1.6)
    for axis in data["robot"]["axes"]:
        axis |= {key: float(scale * rng.uniform(0.95, 1.05) * axis[key]) for key in LENGTHS if key in axis}
        axis["limits_deg"] = [-720, 720]
    data["tests"].pop("circle")
    chain = Chain(data["robot"])
    begin = np.radians(POSTURES[name]) + rng.uniform(-0.25, 0.25, 6)
    R, p = (one[0] for one in chain.tool_at(begin[None]))
    radius = float(np.exp(rng.uniform(np.log(40), np.log(160))))
    normal, towards = R[:, 0], -R[:, 2]
    centre = p - radius * towards
    direction: Literal["acw", "cw"] = "acw" if rng.random() < 0.5 else "cw"
    arc_deg = float(rng.uniform(40, 300)) if kind == "arc" else 384.0 if kind == "lap" else 360.0
    knots = _followed(chain, begin, centre, normal, towards, radius, np.radians(np.arange(0.0, arc_deg + 3, 3)))
    if knots is None:
        return None
    phi_of = _path(rng, kind, np.radians(arc_deg), radius)
    t_s, phi = phi_of if direction == "acw" else (phi_of[0], np.radians(arc_deg) - phi_of[1])
    exact = CubicSpline(np.radians(np.arange(0.0, arc_deg + 3, 3)), knots)
    if kind == "stands":
        q = _jogged(rng, exact, t_s, direction)
        if q is None:
            return None
        t_s, q = q
    else:
        q = exact(phi)
    return Motion(yaml.safe_dump(data), t_s, q + noise(rng, t_s), direction, centre, normal, radius, arc_deg)


def _followed(
    chain: Chain, q: Array, centre: Array, normal: Array, towards: Array, radius: float, phi: Array
) -> Array | None:
    """Return angles (k, 6) rad along a circle with the tool pointing at its centre; None if a joint would be too
    fast.
    """
    found = []
    for angle in phi:
        spin = Rotation.from_rotvec(angle * normal).as_matrix()
        r = spin @ towards
        turn = np.stack([normal, np.cross(-r, normal), -r], axis=1)
        ahead = q if len(found) < 2 else 2 * found[-1] - found[-2]
        solved = chain.angles_at(turn, centre + radius * r, ahead)
        if solved is None or (found and np.abs(solved - found[-1]).max() > np.radians(12)):
            return None
        found.append(solved)
        q = solved
    return np.array(found)


def _path(rng: np.random.Generator, kind: Kind, arc: float, radius: float) -> tuple[Array, Array]:
    """Return times (n,) s and circle angles (n,) rad of one lap from rest to rest, or of two laps with a return
    between them.
    """
    rate_hz = float(rng.choice([50.0, 125.0, 500.0]))
    speed = float(np.exp(rng.uniform(np.log(10), np.log(100)))) / radius
    ramp_s = 0.3
    seconds = arc / speed + ramp_s
    t = np.arange(0.0, seconds, 1 / rate_hz)
    inside = np.minimum(np.minimum(t, seconds - t), ramp_s)
    pace = np.where(inside < ramp_s, inside / ramp_s, 1.0)
    phi = np.concatenate([[0.0], np.cumsum((pace[1:] + pace[:-1]) / 2 * np.diff(t))])
    phi *= arc / phi[-1]
    if kind == "lap" and rng.random() < 0.5:
        pause = np.zeros(int(rng.uniform(0.3, 2) * rate_hz))
        phi = np.concatenate([phi, arc + pause, phi[::-1], pause, phi])
        t = np.arange(len(phi)) / rate_hz
    if kind == "arc" and rng.random() < 0.3:  # a stop on the way
        at = int(rng.uniform(0.2, 0.8) * len(phi))
        phi = np.insert(phi, at, np.full(int(2 * rate_hz), phi[at]))
        t = np.arange(len(phi)) / rate_hz
    return t, phi


def _jogged(rng: np.random.Generator, exact: CubicSpline, t_s: Array, direction: str) -> tuple[Array, Array] | None:
    """Return times and angles of a manual motion to 4 to 9 points around the circle, with joint moves and stops."""
    rate_hz = 1 / float(np.median(np.diff(t_s)))
    count = int(rng.integers(4, 10))
    places = np.sort((np.arange(count) + rng.uniform(-0.2, 0.2, count)) * 2 * np.pi / count) % (2 * np.pi)
    at = exact(places if direction == "acw" else places[::-1])
    pieces = []
    for here, there in zip(at, [*at[1:], at[-1]], strict=True):
        pieces.append(np.repeat(here[None], int(rng.uniform(1.0, 4.0) * rate_hz), axis=0))
        share = np.linspace(0, 1, int(2 * rate_hz))[:, None]
        pieces.append(here + (1 - np.cos(np.pi * share)) / 2 * (there - here))
    q = np.concatenate(pieces)
    return np.arange(len(q)) / rate_hz, q


def noise(rng: np.random.Generator, t_s: Array) -> Array:
    """Error of the reported angles (n, 6) rad: white noise, one of four kinds of slow noise, and encoder
    steps.
    """
    white = rng.uniform(0.1, 1.0, 6) * np.radians(np.exp(rng.uniform(np.log(2e-4), np.log(2e-3))))
    slow = rng.uniform(0.1, 1.0, 6) * np.radians(np.exp(rng.uniform(np.log(2e-4), np.log(5e-3))))
    step = np.radians(float(rng.choice([0.0, 1e-4, 1e-3])))
    kind = rng.choice(["none", "ou", "sines", "pink"])
    n, dt = len(t_s), float(np.median(np.diff(t_s)))
    wander = np.zeros((n, 6))
    if kind == "ou":
        tau = float(np.exp(rng.uniform(np.log(0.05), np.log(2.0))))
        kept = np.exp(-dt / tau)
        kicks = rng.normal(size=(n, 6)) * np.sqrt(1 - kept**2)
        wander[0] = rng.normal(size=6)
        for k in range(1, n):
            wander[k] = kept * wander[k - 1] + kicks[k]
    elif kind == "sines":
        for hz in np.exp(rng.uniform(np.log(0.3), np.log(8.0), 4)):
            wander += np.sin(2 * np.pi * hz * t_s[:, None] + rng.uniform(0, 2 * np.pi, 6)) / np.sqrt(2)
    elif kind == "pink":
        hz = np.fft.rfftfreq(n, dt)
        hz[0] = np.inf
        spectrum = (rng.normal(size=(len(hz), 6)) + 1j * rng.normal(size=(len(hz), 6))) / np.sqrt(np.maximum(hz, 0.1))[
            :, None
        ]
        wander = np.fft.irfft(spectrum, n, axis=0)
        wander /= wander.std(axis=0)
    found = wander * slow + rng.normal(size=(n, 6)) * white
    return np.round(found / step) * step if step else found
