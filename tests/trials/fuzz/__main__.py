"""Mutated inputs to both sides of every protocol, and to the readers of rig files, run directories and tables.

No exception but a RigError, nothing that takes long, no growth; and after its inputs each conversation must still do
its work. A failure is shown with its seed and its bytes.
"""

from __future__ import annotations

import faulthandler
import sys
from argparse import Namespace
from collections import defaultdict
from collections.abc import Iterator, Sequence

from tests.support.trial import Trial, main
from tests.trials.fuzz.fuzzing import GROWTH_MB, Block, Outcome, blocks, is_file, run_block, targets


def draw(given: Namespace) -> Iterator[Block]:
    for target in given.only:
        yield from blocks(target, given.seed, given.files if is_file(target) else given.inputs)


def judged(block: Block) -> Outcome:
    faulthandler.enable()
    return run_block(block)


def grown_mb(outcomes: Sequence[Outcome]) -> float:
    """Most memory by which a process grew between two blocks of a target; its first block loads what is needed."""
    by_process = defaultdict(list)
    for outcome in outcomes:
        by_process[outcome.pid].append(outcome.rss_mb)
    return max((rss[-1] - rss[0] for rss in by_process.values()), default=0.0)


def by_target(outcomes: Sequence[Outcome]) -> dict[str, list[Outcome]]:
    names = dict.fromkeys(outcome.block.target for outcome in outcomes)
    return {name: [outcome for outcome in outcomes if outcome.block.target == name] for name in names}


def report(done: Sequence[Outcome]) -> str:
    lines = []
    for target, own in by_target(done).items():
        inputs, seconds = sum(o.inputs for o in own), sum(o.seconds for o in own)
        lines.append(
            f"{target}: {inputs} inputs, {inputs / max(seconds, 1e-9):.0f} a second and core, slowest "
            f"{max(o.slowest_s for o in own):.2f} s, grown {grown_mb(own):.1f} MB, "
            f"{sum(bool(o.failure) for o in own)} wrong"
        )
    return "\n".join(lines)


def is_wrong(done: Sequence[Outcome]) -> bool:
    return any(o.failure for o in done) or any(grown_mb(own) > GROWTH_MB for own in by_target(done).values())


TRIAL = Trial(
    draw, judged, report, line=lambda outcome: outcome.failure, failed=is_wrong,
    options={
        "inputs": (1_000_000, "inputs to each protocol, some 2000 a second and core (1000000)"),
        "files": (20_000, "inputs to each kind of file (20000)"),
        "seed": (1, "of the mutations (1)"),
        "only": (tuple(targets()), "targets (all)", targets()),
    },
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main(TRIAL))
