"""Readings of the link and its gauges according to measurement.md, "Circle test", and their errors. mm, rad, s."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.worlds.stranger.cell import Place
from tests.worlds.stranger.faults import Fault
from tests.worlds.stranger.outside import dent, rate_hysteresis, thermal_step
from tests.worlds.stranger.play import lagging
from tests.worlds.stranger.screws import Array, Posed


@dataclass(frozen=True)
class Link:
    """A set-up: ball (3,) in the world, zeros (k,) subtracted from the readings, `at` (k,): positions on the
    baseline.
    """

    ball: Array
    zeros: Array
    at: Array


def raw_readings(posed: Posed, p: Array, link: Link, test: str, place: Place, faults: list[Fault]) -> Array:
    """Return readings (n, k) without gauge errors: g = (s - w (l·e)) / (l·z), less the zeros. p (n, 3): positions of
    the tool.
    """
    way = link.ball - p
    distance = np.sqrt((way**2).sum(axis=1))
    contact = np.arctan2(-way @ place.v, -way @ place.u)
    s = distance - place.radius + _form(contact, faults)
    if test == "radial":
        return (s if len(link.zeros) == 1 else s[:, None] * np.ones(2))[:, None] - link.zeros
    line = way / distance[:, None]
    e = posed.R[:, :, 1 if test == "yaw" else 0]
    to_e, to_z = (line * e).sum(axis=1), (line * posed.R[:, :, 2]).sum(axis=1)
    at = link.at.copy()
    for fault in faults:
        if fault.effect == "gauge_baseline":
            at = at + np.sign(at - at.mean()) * fault.size / 2
    return (s[:, None] - to_e[:, None] * at) / to_z[:, None] - link.zeros


def _form(contact: Array, faults: list[Fault]) -> Array:
    """Change (n,) of the distance by the form of the ball."""
    total = np.zeros_like(contact)
    for fault in faults:
        if fault.effect == "ball_form":
            lobes, phase = fault.shape["lobes"], np.radians(fault.shape["phase_deg"])
            more = 0.3 * fault.rough * np.sin((lobes + 1) * contact + fault.begin)
            total += fault.size * (np.sin(lobes * contact + phase) + more)
        elif fault.effect == "dent":
            total += dent(fault, contact)
    return total


def own_errors(g: Array, t: Array, faults: list[Fault], phase_rad: float) -> Array:
    """Return readings (n, k) with the errors of gauges, stand and plungers. phase_rad: of vibrations in this run."""
    g = g.copy()
    for fault in faults:
        if fault.effect == "vibration":
            phase = np.radians(fault.shape["phase_deg"]) + phase_rad
            beat = 1 + 0.3 * fault.rough * np.sin(2 * np.pi * t / 3.0)
            g += (fault.size * beat * np.sin(2 * np.pi * fault.shape["frequency_hz"] * t + phase))[:, None]
        elif fault.effect == "link_growth":  # a longer bar is closer to the ball
            g -= (fault.size * (1 - np.exp(-np.clip(t, 0, None) / fault.shape["time_constant_s"])))[:, None]
        elif fault.effect == "thermal_step":
            g += thermal_step(fault, t)[:, None]
        elif "gauge" in fault.keys and fault.keys["gauge"] in ("g1", "g2")[: g.shape[1]]:
            column = ("g1", "g2").index(str(fault.keys["gauge"]))
            g[:, column] += _wrong(fault, t, g[:, column])
    return g


def _wrong(fault: Fault, t: Array, g: Array) -> Array:
    """Error of a gauge for its readings g (n,)."""
    size, rough = fault.size, fault.rough
    match fault.effect:
        case "gauge_scale":
            return size * (g + 0.2 * rough * g**2)
        case "gauge_inclination":
            return g * (1 / np.cos(np.radians(size)) - 1)
        case "gauge_dead_band":
            return lagging(g, size / 2, rough, fault.begin)
        case "gauge_drift":
            return size / 60 * (t + 0.3 * rough * t * (1 - t / max(t[-1], 1.0)))
        case "gauge_cyclic":
            at = 2 * np.pi * g / fault.shape["period_mm"] + np.radians(fault.shape["phase_deg"])
            return size * (np.sin(at) + 0.2 * rough * np.sin(2 * at))
        case "rate_hysteresis":
            return rate_hysteresis(fault, t, g)
    return np.zeros_like(g)
