"""How often `what moved` is right: drawn arms and changes of an independent world, a table with a line for each cause.

`python -m tests.trials.moved [cases] [scatter_mm] [touches] [axes] [anywhere | planned | plan] ["zero 2+tool"]`. New
touches are in postures of the reference, drawn at random; `anywhere` draws other postures, `planned` takes those that
the plan chooses, and `plan` counts the touches that name a cause, planned and at random. Causes joined by a plus
replace the list of causes.
"""

from __future__ import annotations

import sys
from collections import Counter

import numpy as np

from analysis.apps.commission.next_touch import candidates_of, next_posture
from analysis.movement.inference import compare
from tests.support.moved_cell import Case, label, observed
from tests.worlds import moved as world

LARGE_DEG = 0.05
"""Size of a zero error from which the share named is also counted alone: below it, four touches with a scatter of 0.05
mm hold too little information about the wrist."""
FIRST_SEED = 20_000
"""First seed of the published tables. These seeds are used only there."""


def share(count: int, total: int) -> str:
    """Return a share in percent with its interval of 95 % (Wilson)."""
    if not total:
        return "–"
    z, p = 1.96, count / total
    middle, width = p + z**2 / (2 * total), z * np.sqrt(p * (1 - p) / total + z**2 / (4 * total**2))
    low, high = (abs((middle + sign * width) / (1 + z**2 / total)) for sign in (-1, 1))
    return f"{100 * p:.0f} ({100 * low:.0f}–{100 * high:.0f})"


def main(cases: int, scatter_mm: float, touches: int, axes: int, where: str, joined: list[str]) -> None:
    """Print how often each cause is named, and with which other answers."""
    kind = world.SIX if axes == 6 else world.SEVEN
    zeros = [f"zero {k}" for k in range(1, axes + 1)]
    print(f"{cases} cases a cause, {axes} axes, scatter {scatter_mm} mm, {touches} new touches, reference of 20 to 40")
    print(f"{'cause':14s} {'named, %':14s} {'from 0.05°':14s} wrong part open nothing other")
    total = wrong_total = 0
    for cause in joined or ["nothing", "base", "tool", "socket", *zeros, "tool+zero 3", "base+tool"]:
        counts, large = Counter[str](), Counter[bool]()
        for seed in range(FIRST_SEED, FIRST_SEED + cases):
            case = Case(kind, cause, scatter_mm, seed)
            if where == "anywhere":
                new = case.touch((["A", "B"] * touches)[:touches])
            else:
                new = case.touch_planned(touches) if where == "planned" else case.touch_again(touches)
            found = label(case.named(new))
            counts[found] += 1
            if cause in zeros and np.degrees(np.abs(case.change.zero)).max() >= LARGE_DEG:
                large[found == cause] += 1
        right = "+".join(sorted(cause.split("+")))
        parts = sum(n for name, n in counts.items() if set(name.split("+")) < set(cause.split("+")))
        nothing = counts["nothing"] * (cause != "nothing")
        wrong = cases - counts[right] - parts - nothing - counts["open"] - counts["other"]
        total, wrong_total = total + cases, wrong_total + wrong
        others = "".join(f"{n:6d}" for n in (wrong, parts, counts["open"], nothing, counts["other"]))
        from_large = share(large[True], large.total())
        print(f"{cause:14s} {share(counts[right], cases):14s} {from_large:14s}{others}  {dict(counts)}", flush=True)
    print(f"false cause at 20 to 1: {wrong_total} of {total}, {share(wrong_total, total)} %")


def plan(cases: int, scatter_mm: float, most: int, axes: int) -> None:
    """Print how many touches name a cause, planned and twice in random postures of the reference.

    Two random sequences of the same case also differ. How often the second needs at most as many touches as the first
    is the share that a plan without any benefit would reach.
    """
    kind = world.SIX if axes == 6 else world.SEVEN
    needed = []
    wrong = 0
    causes = ["base", "tool", *(f"zero {k}" for k in range(1, 6))]
    for cause in causes:
        for seed in range(FIRST_SEED, FIRST_SEED + cases):
            case = Case(kind, cause, scatter_mm, seed)
            ways = [_touches_needed(case, cause, most, planned=planned) for planned in (True, False, False)]
            needed.append([count for count, _ in ways])
            wrong += sum(is_wrong for _, is_wrong in ways)
        print(f"{cause:10s} planned and random, mean touches {np.mean(needed[-cases:], axis=0).round(2)}", flush=True)
    counts, total = np.array(needed), len(needed)
    for k, way in enumerate(("planned", "random", "random again")):
        print(f"named within 4 touches, {way}: {share(int((counts[:, k] <= 4).sum()), total)} % of {total}")
    print(f"planned at most as many as random: {share(int((counts[:, 0] <= counts[:, 1]).sum()), total)} %")
    print(f"random again at most as many:      {share(int((counts[:, 2] <= counts[:, 1]).sum()), total)} %")
    print(f"false cause named first: {wrong} of {3 * total}")


def _touches_needed(case: Case, cause: str, most: int, *, planned: bool) -> tuple[int, bool]:
    """Return the number of touches after which the right cause is named, and whether a false one was named first.

    The number is one more than the most if neither is named, or if a false one is.
    """
    candidates = candidates_of(case.reference)
    sockets: list[str] = []
    q = np.empty((0, case.q.shape[1]))
    compared = None
    order = case.rng.permutation(len(case.q))
    for count in range(1, most + 1):
        if planned:
            posture = next_posture(case.reference, candidates, compared)
            assert posture is not None
            row = int(np.abs(case.q - posture.angles).max(axis=1).argmin())
        else:
            row = int(order[count - 1])
        name, near = case.touch([case.sockets[row]], case.q[row : row + 1])
        sockets, q = sockets + name, np.concatenate([q, near])
        compared = compare(case.reference, observed(case.model, sockets, q))
        found = label(compared.identified_cause)
        if found not in ("open", "nothing", "other"):
            return (count, False) if found == cause else (most + 1, True)
    return most + 1, False


if __name__ == "__main__" and {"-h", "--help"} & set(sys.argv):
    print(__doc__)
elif __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word[0].isdigit()]
    defaults = ["60", "0.05", "4", "6"]
    given = [*words, *defaults[len(words) :]]
    numbers = int(given[0]), float(given[1]), int(given[2]), int(given[3])
    if "plan" in sys.argv:
        plan(*numbers)
    else:
        where = next((word for word in sys.argv if word in ("anywhere", "planned")), "again")
        main(*numbers, where, [word for word in sys.argv if "+" in word])
