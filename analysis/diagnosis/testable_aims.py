"""The aims of a proposal: names that nothing shows yet and pairs that look alike, and how near runs come to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.columns import LARGEST_FAULT
from analysis.diagnosis.form_information import FormInformation
from analysis.diagnosis.form_posterior import DETECTABLE, SEPARABLE
from analysis.diagnosis.judgement import Judgement
from analysis.kinematics.arm import Array

_FAINT = 0.1
"""Share of the goal below which more information does not count: a name that nothing shows must not outweigh all
others. Chosen."""


@dataclass(frozen=True)
class Reached:
    """How near some runs come to each aim: `share` (n,) of the sigmas that make it testable, for `names` first and then
    for `pairs`."""

    names: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]
    share: Array

    def gain_over(self, before: Reached) -> float:
        """Return the information in nats that is gained about all aims, up to where they are testable."""
        then, now = (np.clip(one.share, _FAINT, 1.0) for one in (self, before))
        return float(np.log(then / now).sum())

    def newly(self, before: Reached) -> tuple[int, ...]:
        """Return the indices of the aims that are testable now and were not before."""
        return tuple(np.flatnonzero((self.share >= 1) & (before.share < 1)).tolist())

    def split(self, aims: tuple[int, ...]) -> tuple[tuple[str, ...], tuple[tuple[str, str], ...]]:
        """Return the names and the pairs of some aims."""
        count = len(self.names)
        return (
            tuple(self.names[k] for k in aims if k < count),
            tuple(self.pairs[k - count] for k in aims if k >= count),
        )


class Aims:
    """What a judgement found not to be testable."""

    def __init__(self, forms: FormInformation, judgement: Judgement) -> None:
        self._forms = forms
        self._names = judgement.undetectable
        self._pairs = judgement.pairs
        self._of_name = {name: [one for one in forms.candidates if one.name == name] for name in self._names}
        self._ones = [one for pair in self._pairs for one in pair.candidates]
        self._sizes = np.array([size for pair in self._pairs for size in pair.sizes])

    def reached(self, information: Array) -> Reached:
        """Return how near runs with an information (p, p) come to the aims. The shapes of effects count as known; the
        final judgement fits them."""
        known = self._forms.posterior(information)
        sds = np.array([min(map(known.sd, self._of_name[name])) for name in self._names])
        named = LARGEST_FAULT / (DETECTABLE * sds)
        apart = np.empty(0)
        if self._pairs:
            pairs = np.arange(len(self._ones), dtype=np.int64).reshape(-1, 2)
            apart = known.sigmas_apart(self._ones, self._sizes, pairs) / SEPARABLE
        return Reached(self._names, tuple(pair.names for pair in self._pairs), np.concatenate([named, apart]))
