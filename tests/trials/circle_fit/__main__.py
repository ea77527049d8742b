"""Coverage of the uncertainties that `rig circle fit` states, over motions drawn from outside.

Arms, places, radii, arcs, speeds, rates and noise differ from motion to motion; the generator shares no code with rig
(tests/support/driven_motions.py). For each kind of motion: how often the truth lies within 1.96 u, for the coordinates
of the centre, the two tilts of the normal and the radius; the rms error over u; and the median u.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from analysis.apps.commission.driven_circle import driven_circle
from analysis.runs.loading import RobotMotion
from rigs.errors import FileError
from rigs.load import parse
from tests.support.driven_motions import Kind, Motion, drawn

KINDS: tuple[Kind, ...] = ("arc", "lap", "stands")
SHARES = (0.5, 0.3, 0.2)
WITHIN = 1.96


@dataclass(frozen=True)
class Trial:
    """One motion: error over u of centre (3,), tilt (2,) and radius (1,), and u of each in mm, degrees, mm."""

    centre: np.ndarray
    tilt: np.ndarray
    radius: np.ndarray
    u: tuple[float, float, float]


def main() -> None:
    parser = argparse.ArgumentParser(prog="scripts/dev circle_fit", description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=200, help="motions (200)")
    parser.add_argument("--seed", type=int, default=0, help="of the first motion (0)")
    given = parser.parse_args()
    everything: list[Trial] = []
    print(f"{'':<8} motions refused  {'centre':^24} {'normal':^24} {'radius':^24}")
    for kind, share in zip(KINDS, SHARES, strict=True):
        count = round(share * given.count)
        trials = [tried(drawn(seed, kind)) for seed in range(given.seed, given.seed + count)]
        told(kind, trials)
        everything += [trial for trial in trials if trial]
    told("all", list(everything))


def tried(motion: Motion) -> Trial | None:
    """The errors of one fit in its own u; None where the arc was refused as too short."""
    rig = parse(motion.rig_text, "drawn")
    try:
        found = driven_circle([RobotMotion("drawn", motion.t_s, motion.q, motion.direction)], rig)
    except FileError as error:
        print(f"refused ({motion.arc_deg:.0f}°): {error}")
        return None
    off = found.circle.centre - motion.centre
    # Two directions across the true normal, which the circle fitted does not know.
    across = np.linalg.svd(motion.normal[None])[2][1:]
    sd = np.sqrt(np.einsum("ki,ij,kj->k", across, found.normal_cov, across))
    u = (float(found.u_centre_mm.max()), float(np.degrees(found.u_normal)), found.u_radius_mm)
    radius = np.array([(found.circle.radius - motion.radius) / found.u_radius_mm])
    return Trial(off / found.u_centre_mm, across @ found.circle.n / sd, radius, u)


def told(what: str, trials: list[Trial | None]) -> None:
    """A line: coverage, rms error over u, and median u, of centre, normal and radius."""
    sound = [trial for trial in trials if trial]
    line = f"{what:<8} {len(trials):7d} {len(trials) - len(sound):7d}"
    units = ("mm", "°", "mm")
    for place, (name, unit) in enumerate(zip(("centre", "tilt", "radius"), units, strict=True)):
        errors = np.concatenate([getattr(trial, name) for trial in sound])
        u = float(np.median([trial.u[place] for trial in sound]))
        within, rms = float(np.mean(np.abs(errors) < WITHIN)), float(np.sqrt(np.mean(errors**2)))
        line += f"  {100 * within:4.0f} % {rms:5.2f} u {u:8.2g} {unit:2}"
    print(line, flush=True)


if __name__ == "__main__":
    main()
