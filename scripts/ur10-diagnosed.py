"""What is missing in the nominal model of a real UR10 (Fraunhofer IPA, laser tracker), by the engine of `rig diagnose`.

For each series and fold: set-up and names from the poses of four fifths of the neighbourhoods in joint space, then the
frozen model on the fifth that had no part in it, beside the nominal arm and an ordinary calibration of 24 parameters.

A real arm has more errors than any vocabulary has names, so what names leave is not the tracker's noise. Here it
counts as noise of unknown strength: names are searched with the noise that those of the round before left, the first
round with all of the gap. What no effect explains is alike in neighbours, though, and a play whose side goes with the
posture is a welcome excuse for it; so in the last round neighbours share noise, as much as is likely.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from ur10 import FIT, read

from analysis.diagnose.blocks import Block, blocks_of
from analysis.diagnose.candidates import candidates_for, name_of
from analysis.diagnose.evidence import Dictionary
from analysis.diagnose.linear import Linear
from analysis.diagnose.observed import Seen, see
from analysis.diagnose.refine import Refined, refine
from analysis.diagnose.search import QUIET, Search
from analysis.fitting.calibrate import calibrate
from analysis.fitting.estimate import fit
from analysis.fitting.observation import residuals_of, rms
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp, model_of
from analysis.reading.tables import Integers, PoseTable
from rigs.effects import Backlash, Effect, healthy_size, size_field
from rigs.load import load
from rigs.rig import Rig

GROUPS = 20
"""Neighbourhoods of joint space, dealt to the folds whole."""
DEPTH = 24
"""Most names; what pays ends the search well before."""
ROUNDS = 3
"""With noise that is each pose's own; one more follows with noise that neighbours share."""
REACH_DEG = (2.5, 5.0, 10.0)
SHARES = (0.0, 0.3, 0.6, 0.8, 0.9, 0.95)
"""How far in joint space what no effect explains is alike, and how much of it: the likeliest is taken."""
SAME_RAD = 3e-4
"""Joints that differ by less, each, are the same: the steps of what the robot reports are a third of that."""
MEDIAN_APART = 1.5382 * np.sqrt(2)
"""Median distance of two visits, in standard deviations of one coordinate of one visit."""
FAR = 10.0
"""Median distances from which on two visits are no repeat of anything."""


@dataclass(frozen=True)
class Repeats:
    """Visits to the same joints. sd_mm: of one coordinate of one visit; apart_mm (n,): distance of each pair; ways
    (n, 6): whether each joint came from the same side (1), from opposite ones (-1), or stood (0), by the rows.
    """

    sd_mm: float
    apart_mm: Array
    ways: Array


def repeats(table: PoseTable) -> Repeats:
    """Pairs of visits to the same joints, their spread by the median: a few pairs are a millimetre apart."""
    pairs = cKDTree(table.q).query_pairs(SAME_RAD, p=np.inf, output_type="ndarray")
    apart = np.linalg.norm(table.xyz_mm[pairs[:, 0]] - table.xyz_mm[pairs[:, 1]], axis=1)
    came = np.diff(table.q, axis=0, prepend=table.q[:1])
    came[np.abs(came) < 10 * SAME_RAD] = 0.0
    ways = np.sign(came[pairs[:, 0]]) * np.sign(came[pairs[:, 1]])
    return Repeats(float(np.median(apart)) / MEDIAN_APART, apart, ways)


def told(again: Repeats) -> list[str]:
    """Repeats in words: how far apart, and whether coming from the other side makes it more."""
    typical = np.median(again.apart_mm)
    near = again.apart_mm < FAR * typical
    lines = [
        f"  {len(near)} pairs of visits to the same joints, median {typical:.3f} mm apart ({np.count_nonzero(~near)} "
        f"more than {FAR:.0f} times that and left out here): {again.sd_mm:.3f} mm a coordinate of one visit"
    ]
    for axis in range(6):
        pairs = [again.apart_mm[near & (again.ways[:, axis] == way)] for way in (-1, 1)]
        words = [f"{np.median(one):.3f} mm ({len(one)} pairs)" if len(one) else "no pair" for one in pairs]
        lines.append(f"  joint {axis + 1} from opposite sides {words[0]}, from the same {words[1]}")
    return lines


def folds_of(q: Array, folds: int) -> Integers:
    """The fold of each pose: neighbourhoods of joint space, dealt whole, the largest first to the smallest fold."""
    _, group = kmeans2(q, GROUPS, minit="++", rng=np.random.default_rng(0))
    fold = np.zeros(len(q), dtype=np.intp)
    filled = np.zeros(folds)
    for number in np.argsort(-np.bincount(group, minlength=GROUPS)):
        k = int(np.argmin(filled))
        fold[group == number] = k
        filled[k] += np.count_nonzero(group == number)
    return fold


@dataclass(frozen=True)
class Diagnosed:
    """Effects named, refined together, and the search that they were found by; noise_mm: what it took for noise."""

    refined: Refined
    linear: Linear
    search: Search
    noise_mm: float
    level: float


def diagnosed(seen: Seen, least_mm: float) -> Diagnosed:
    """Names for what set-ups leave of poses, what they leave in turn taken for the noise."""
    before = fit(seen.model, [seen.one])
    bare = blocks_of([seen], before.setups)[0][0]
    raw = before.residuals[0].ravel()
    left, spent = raw, 9
    for turn in range(ROUNDS + 1):
        noise = max(least_mm, float(np.sqrt(left @ left / (len(left) - spent))))
        block = with_noise(bare, raw, noise)
        if turn == ROUNDS:
            block = alike(bare, raw, left, seen.one.table.q[seen.one.rows], least_mm)
        linear = Linear([block], before.setups)
        search = Search(Dictionary(linear, candidates_for(linear)), depth=DEPTH)
        found = search.best(QUIET)
        begin = [search.start(k, size) for k, size in zip(found.chosen, found.sizes, strict=True)]
        refined = refine(linear, search.background(found.level), begin)
        now = Diagnosed(refined, linear, search, noise, found.level)
        left, spent = residual(seen, refined.effects, refined.setups).ravel(), 9 + len(refined.unknowns)
    return now


def alike(block: Block, raw: Array, left: Array, q: Array, least_mm: float) -> Block:
    """A block of poses with noise that neighbours in joint space share, as likely as names left (N,) mm make it."""
    errors = left.reshape(-1, 3)
    best: tuple[float, float, float, Array, Array] | None = None
    for reach in np.radians(REACH_DEG):
        power, vectors = np.linalg.eigh(np.exp(-cdist(q, q, "sqeuclidean") / (2 * reach**2)))
        power = np.maximum(power, 0.0)
        energy = ((vectors.T @ errors) ** 2).sum(axis=1)
        for share in SHARES:
            spread = 1 - share + share * power
            variance = max(least_mm**2, float((energy / spread).sum()) / errors.size)
            cost = 3 * float(np.log(spread).sum()) + errors.size * float(np.log(variance))
            cost += float((energy / spread).sum()) / variance
            if best is None or cost < best[0]:
                best = (cost, variance, share, power, vectors)
    assert best is not None
    _, variance, share, power, vectors = best
    seen = share * power > 1e-3 * (1 - share)
    size = np.sqrt(share * power[seen] / (1 - share))
    sd = np.full(len(raw), np.sqrt(variance * (1 - share)))
    other = replace(
        block, sd_mm=sd, span=np.asarray(np.kron(vectors[:, seen], np.eye(3)), dtype=float), size=np.repeat(size, 3)
    )
    return replace(other, y=other.white(raw))


def with_noise(block: Block, raw: Array, sd_mm: float) -> Block:
    """A block of poses whose readings raw (N,) mm have one noise."""
    size = block.size * block.sd_mm[0] / sd_mm
    other = replace(block, sd_mm=np.full(len(raw), sd_mm), size=size)
    return replace(other, y=other.white(raw))


def residual(seen: Seen, effects: Sequence[Effect], setups: dict[str, SetUp]) -> Array:
    """Measured less predicted (m, 3) mm, with effects in the model."""
    model = replace(seen.model, effects=(*seen.model.effects, *effects))
    return residuals_of(model, [seen.one], setups)[0]


def part(seen: Seen, keep: Array) -> Seen:
    """Some of the readings; the path, so where each pose was approached from, stays whole."""
    return replace(seen, one=replace(seen.one, rows=seen.one.rows[keep], values=seen.one.values[keep]))


def sized(found: Refined) -> list[tuple[str, float, float, str]]:
    """Name, size and its standard uncertainty, unit; of a wave with its order."""
    told = []
    for k, effect in enumerate(found.effects):
        field = size_field(effect)
        order = f", order {effect.order:.2f}" if hasattr(effect, "order") else ""
        unit = "mm" if getattr(effect, "field", "") in ("a", "d") else "°"
        if field != "delta":
            unit = {"deg_per_Nm": "°/Nm", "mm_per_Nm": "mm/Nm"}.get(field, field.rpartition("_")[2].replace("deg", "°"))
        told.append((name_of(effect), float(getattr(effect, field)), found.sd(k)[field], unit + order))
    return told


def plays(found: Diagnosed) -> str:
    """The width that each joint's play would have beside the names, and the most evidence that any has."""
    search = found.search.beside(found.refined.left, found.refined.tangents)
    basis, _ = np.linalg.qr(found.refined.tangents)
    gains = search.table(found.level).gains(())
    best = max(float(gains[k]) for k, name in enumerate(search.names) if name.startswith("backlash"))
    widths = []
    for axis in range(1, 7):
        k = search.names.index(f"backlash {axis}")
        column = search.dictionary.G[:, search.dictionary.main[k][0]]
        column = column - basis @ (basis.T @ column)
        energy = float(column @ column)
        healthy = healthy_size(Backlash(axis=axis))
        if energy > 1.0:
            value, sd = healthy * float(column @ search.y) / energy, healthy / np.sqrt(energy)
            widths.append(f"{axis}: {value:+.4f} ± {2 * sd:.4f}°")
        else:
            widths.append(f"{axis}: not seen")
    return f"  play beside the names {', '.join(widths)}; evidence at most {best:.1f}, its price {search.price:.1f}"


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("data", type=Path, help="the folder of series_b.csv and series_d.csv")
    options.add_argument("--series", default="b,d", help="which of them (default b,d)")
    options.add_argument("--folds", type=int, default=5, help="parts that the neighbourhoods are dealt to (default 5)")
    options.add_argument("--only", type=int, default=0, help="the first so many folds alone, and no whole series")
    words = options.parse_args()
    rig = load("ur10")[0]
    all_series = {series: read(words.data / f"series_{series}.csv") for series in words.series.split(",")}
    for series, table in all_series.items():
        judged(rig, table, series, words.folds, words.only)
        if not words.only:
            whole(rig, table, series, {name: other for name, other in all_series.items() if name != series})
    return 0


def judged(rig: Rig, table: PoseTable, series: str, folds: int, only: int) -> None:
    """Every fold of a series, told line by line."""
    again = repeats(table)
    print(f"series {series.upper()}: {len(table.q)} poses", *told(again), sep="\n", flush=True)
    seen = see(model_of(rig), table, f"series {series}")
    fold = folds_of(table.q, folds)
    rows: list[tuple[int, float, float, float]] = []
    names: Counter[str] = Counter()
    for k in range(only or folds):
        begin = time.perf_counter()
        used, left_out = part(seen, fold != k), part(seen, fold == k)
        plain = calibrate(rig, [used.one], [left_out.one], FIT)
        middle = time.perf_counter()
        found = diagnosed(used, again.sd_mm)
        now = found.refined
        after = rms([residual(left_out, now.effects, now.setups)])
        rows.append((len(left_out.one.rows), plain.before_mm[1], plain.after_mm[1], after))
        names.update(map(name_of, now.effects))
        seconds = time.perf_counter() - middle, middle - begin
        print(
            f"  fold {k + 1}, {rows[-1][0]} poses left out: nominal {rows[-1][1]:.3f}, 24 DH parameters "
            f"{rows[-1][2]:.3f}, diagnosed {after:.3f} mm rms; {len(now.effects)} names, {len(now.unknowns)} numbers; "
            f"used {plain.before_mm[0]:.3f}, {plain.after_mm[0]:.3f}, "
            f"{rms([residual(used, now.effects, now.setups)]):.3f}; {seconds[0]:.0f} s (DH {seconds[1]:.0f} s)",
            flush=True,
        )
    weight = np.array([row[0] for row in rows])
    pooled = np.sqrt((weight[:, None] * np.array([row[1:] for row in rows]) ** 2).sum(axis=0) / weight.sum())
    print(f"  all folds: nominal {pooled[0]:.3f}, 24 DH parameters {pooled[1]:.3f}, diagnosed {pooled[2]:.3f} mm rms")
    print(f"  named in folds: {', '.join(f'{name} {n}' for name, n in names.most_common())}")
    plain_play = sorted(name for name in names if name.startswith("backlash"))
    print(f"  backlash: {', '.join(plain_play) if plain_play else 'none named in any fold'}")


def whole(rig: Rig, table: PoseTable, series: str, others: dict[str, PoseTable]) -> None:
    """Names and sizes from a whole series; the frozen models on the other series, set-up fitted: months apart."""
    begin = time.perf_counter()
    seen = see(model_of(rig), table, f"series {series}")
    found = diagnosed(seen, repeats(table).sd_mm)
    after = rms([residual(seen, found.refined.effects, found.refined.setups)])
    print(f"  of the whole series, {after:.3f} mm left, {time.perf_counter() - begin:.0f} s:")
    for name, value, sd, unit in sized(found.refined):
        print(f"    {name}: {value:+.3g} ± {2 * sd:.1g} {unit}")
    print(plays(found))
    plain = calibrate(rig, [seen.one], [], FIT).after.model.effects
    for name, other in others.items():
        there = see(model_of(rig), other, f"series {name}").one
        figures = [fit(model_of(rig, effects), [there]).rms_mm for effects in ((), plain, found.refined.effects)]
        print(
            f"  frozen, on series {name.upper()}, set-up fitted: nominal {figures[0]:.3f}, 24 DH parameters "
            f"{figures[1]:.3f}, diagnosed {figures[2]:.3f} mm rms",
            flush=True,
        )


if __name__ == "__main__":
    sys.exit(main())
