"""Coverage of the uncertainties that `rig circle fit` states, over motions drawn from outside.

Arms, places, radii, arcs, speeds, rates and noise differ from motion to motion; the generator shares no code with rig
(tests/support/driven_motions.py). For each kind of motion: how often the truth lies within 1.96 u, for the coordinates
of the centre, the two tilts of the normal and the radius; the rms error over u; and the median u.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.apps.commission.driven_circle import driven_circle
from analysis.runs.loading import RobotMotion
from rigs.errors import FileError
from rigs.load import parse
from tests.support.driven_motions import Kind, drawn
from tests.support.trial import Trial, main

KINDS: tuple[Kind, ...] = ("arc", "lap", "stands")
SHARES = (0.5, 0.3, 0.2)
WITHIN = 1.96


@dataclass(frozen=True)
class Fit:
    """One motion: error over u of centre (3,), tilt (2,) and radius (1,), and u of each in mm, degrees, mm."""

    kind: Kind
    centre: np.ndarray
    tilt: np.ndarray
    radius: np.ndarray
    u: tuple[float, float, float]


def draw(given: Namespace) -> Iterator[tuple[Kind, int]]:
    for kind, share in zip(KINDS, SHARES, strict=True):
        yield from ((kind, seed) for seed in range(given.seed, given.seed + round(share * given.count)))


def tried(case: tuple[Kind, int]) -> Fit | str:
    """The errors of one fit in its own u; the reason if the arc was refused as too short."""
    kind, seed = case
    motion = drawn(seed, kind)
    rig = parse(motion.rig_text, "drawn")
    try:
        found = driven_circle([RobotMotion("drawn", motion.t_s, motion.q, motion.direction)], rig)
    except FileError as error:
        return f"{kind} refused ({motion.arc_deg:.0f}°): {error}"
    off = found.circle.centre - motion.centre
    # Two directions across the true normal, which the circle fitted does not know.
    across = np.linalg.svd(motion.normal[None])[2][1:]
    sd = np.sqrt(np.einsum("ki,ij,kj->k", across, found.normal_cov, across))
    u = (float(found.u_centre_mm.max()), float(np.degrees(found.u_normal)), found.u_radius_mm)
    radius = np.array([(found.circle.radius - motion.radius) / found.u_radius_mm])
    return Fit(kind, off / found.u_centre_mm, across @ found.circle.n / sd, radius, u)


def report(done: Sequence[Fit | str]) -> str:
    """Coverage, rms error over u and median u of centre, normal and radius, by kind of motion."""
    fits = [one for one in done if isinstance(one, Fit)]
    lines = [
        f"{len(done) - len(fits)} of {len(done)} refused",
        f"{'':<8} fits   {'centre':^24} {'normal':^24} {'radius':^24}",
    ]
    for what in (*KINDS, "all"):
        own = [fit for fit in fits if what in (fit.kind, "all")]
        if own:
            lines.append(f"{what:<8} {len(own):5d}{_shares(own)}")
    return "\n".join(lines)


def _shares(fits: Sequence[Fit]) -> str:
    line = ""
    for place, (name, unit) in enumerate((("centre", "mm"), ("tilt", "°"), ("radius", "mm"))):
        errors = np.concatenate([getattr(fit, name) for fit in fits])
        u = float(np.median([fit.u[place] for fit in fits]))
        within, rms = float(np.mean(np.abs(errors) < WITHIN)), float(np.sqrt(np.mean(errors**2)))
        line += f"  {100 * within:4.0f} % {rms:5.2f} u {u:8.2g} {unit:2}"
    return line


TRIAL = Trial(
    draw,
    tried,
    report,
    line=lambda one: one if isinstance(one, str) else "",
    count=200,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
