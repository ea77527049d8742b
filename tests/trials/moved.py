"""How often `what moved` is right: drawn arms and changes of an independent world, a table with a line for each cause.

New touches are in postures of the reference, drawn at random. `--where anywhere` draws other postures, and `planned`
takes those that the plan chooses. `--plan` counts the touches that name a cause, planned and at random.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from analysis.apps.commission.next_touch import candidates_of, next_posture
from analysis.movement.inference import compare
from tests.support.moved_cell import Case, label, observed
from tests.support.rates import wilson
from tests.support.trial import Trial, main, seeds
from tests.worlds import moved as world

LARGE_DEG = 0.05
"""Size of a zero error from which the share named is also counted alone: below it, four touches with a scatter of 0.05
mm hold too little information about the wrist."""
FIRST_SEED = 20_000
"""First seed of the published tables. These seeds are used only there."""


def share(count: int, total: int) -> str:
    """Share in percent with its interval of 95 % (Wilson)."""
    low, high = wilson(count, total)
    return f"{100 * count / total:.0f} ({100 * low:.0f}–{100 * high:.0f})" if total else "–"


Job = tuple[Namespace, str, int]
"""Options, cause and seed."""


def draw(given: Namespace) -> Iterator[Job]:
    zeros = [f"zero {k}" for k in range(1, given.axes + 1)]
    causes = given.causes or ["nothing", "base", "tool", "socket", *zeros, "tool+zero 3", "base+tool"]
    if given.plan:
        causes = ["base", "tool", *zeros[:5]]
    yield from ((given, cause, seed) for cause in causes for seed in seeds(given))


def judged(job: Job) -> tuple[str, str, bool, list[tuple[int, bool]]]:
    """Cause, the answer, whether a zero is large; or the touches that were needed, planned and twice at random."""
    given, cause, seed = job
    case = Case(world.SIX if given.axes == 6 else world.SEVEN, cause, given.scatter_mm, seed)
    if given.plan:
        ways = [_touches_needed(case, cause, given.touches, planned=planned) for planned in (True, False, False)]
        return cause, "", False, ways
    if given.where == "anywhere":
        new = case.touch((["A", "B"] * given.touches)[: given.touches])
    else:
        new = case.touch_planned(given.touches) if given.where == "planned" else case.touch_again(given.touches)
    is_large = cause.startswith("zero") and bool(np.degrees(np.abs(case.change.zero)).max() >= LARGE_DEG)
    return cause, label(case.named(new)), is_large, []


def report(done: Sequence[tuple[str, str, bool, list[tuple[int, bool]]]]) -> str:
    if done[0][3]:
        return plan([ways for *_, ways in done])
    lines = [f"{'cause':14s} {'named, %':14s} {'from 0.05°':14s} wrong part open nothing other"]
    wrong_total = 0
    for cause in dict.fromkeys(cause for cause, *_ in done):
        own = [(found, is_large) for other, found, is_large, _ in done if other == cause]
        counts = Counter(found for found, _ in own)
        large = [found == cause for found, is_large in own if is_large]
        right = "+".join(sorted(cause.split("+")))
        parts = sum(n for name, n in counts.items() if set(name.split("+")) < set(cause.split("+")))
        nothing = counts["nothing"] * (cause != "nothing")
        wrong = len(own) - counts[right] - parts - nothing - counts["open"] - counts["other"]
        wrong_total += wrong
        others = "".join(f"{n:6d}" for n in (wrong, parts, counts["open"], nothing, counts["other"]))
        shares = f"{share(counts[right], len(own)):14s} {share(sum(large), len(large)):14s}"
        lines.append(f"{cause:14s} {shares}{others}  {dict(counts)}")
    lines.append(f"false cause at 20 to 1: {wrong_total} of {len(done)}, {share(wrong_total, len(done))} %")
    return "\n".join(lines)


def plan(needed: Sequence[list[tuple[int, bool]]]) -> str:
    """How many touches name a cause, planned and twice in random postures of the reference.

    Two random sequences of the same case also differ. How often the second needs at most as many touches as the first
    is the share that a plan without any benefit would reach.
    """
    counts, total = np.array([[count for count, _ in ways] for ways in needed]), len(needed)
    lines = [
        f"named within 4 touches, {way}: {share(int((counts[:, k] <= 4).sum()), total)} % of {total}; mean "
        f"{counts[:, k].mean():.2f}"
        for k, way in enumerate(("planned", "random", "random again"))
    ]
    wrong = sum(is_wrong for ways in needed for _, is_wrong in ways)
    return "\n".join([
        *lines,
        f"planned at most as many as random: {share(int((counts[:, 0] <= counts[:, 1]).sum()), total)} %",
        f"random again at most as many:      {share(int((counts[:, 2] <= counts[:, 1]).sum()), total)} %",
        f"false cause named first: {wrong} of {3 * total}",
    ])  # fmt: skip


def _touches_needed(case: Case, cause: str, most: int, *, planned: bool) -> tuple[int, bool]:
    """Number of touches after which the right cause is named, and whether a false one was named first.

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


TRIAL = Trial(
    draw,
    judged,
    report,
    line=lambda one: "",
    count=60,
    seed=FIRST_SEED,
    options={
        "scatter_mm": (0.05, "scatter of a touch in mm (0.05)"),
        "touches": (4, "new touches; with --plan the most (4)"),
        "axes": (6, "axes of the arm, 6 or 7 (6)"),
        "where": ("again", "postures of the new touches (again)", ("again", "anywhere", "planned")),
        "plan": (False, "count the touches that name a cause"),
        "causes": ([], "causes; joined ones with a plus (all single ones and two pairs)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
