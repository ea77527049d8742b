"""Which names explain the residual: closed-form evidence over all candidates, names added, dropped and swapped.

Effects are linear here, shapes with them; `refine` follows on the simulator.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.diagnose.evidence import DETECTABLE, LARGEST, WIDE, Background, Dictionary
from analysis.kinematics.arm import Array
from rigs.effects import Effect, healthy_size, one_sided, size_field

PRICE = 3.0
"""Log odds that a name must win beside the number of names there are: 20 to 1."""
DEPTH = 4
"""Most names that are looked for at once."""
USUAL = 0.1
"""Level of the background, in detection limits, up to which all are as likely."""
DOUBT = 6.0
"""Log odds for each time that a level doubles from there."""
QUIET = (0.05, 0.1, 0.2)
RICH = (0.4, 0.8, 1.6, 3.2, 6.4, 12.8, 25.6, 100.0)
"""Levels that are tried: those of an arm with little of everything, and those beyond."""
_OWN_SHARE = 1e-3
_NOTHING = 1e-4
"""Square of sigmas of a healthy size below which a candidate does nothing."""


@dataclass(frozen=True)
class Found:
    """Candidates chosen, by number, with their main coefficients in healthy sizes; score: log density of the residual,
    prices paid; level of the background."""

    chosen: tuple[int, ...]
    sizes: tuple[Array, ...]
    score: float
    level: float


class Search:
    """The names that explain y (N,), on one dictionary; y: of its own linearisation where none is given.

    Products of columns are what evidence is made of: h (p,) with y, yy of y with itself, Kb (b, p) of the background's
    with all, `own` of each group's within a candidate. Where columns are free beside the names, `off` (q, p) is what
    they take: off_i'off_j of the product of columns i and j.
    """

    def __init__(self, dictionary: Dictionary, y: Array | None = None, depth: int = DEPTH) -> None:
        y = dictionary.y if y is None else y
        self.dictionary, self.y, self.depth = dictionary, y, depth
        self.testable: NDArray[np.bool_] = (dictionary.own >= _OWN_SHARE) & (LARGEST * dictionary.sigma >= DETECTABLE)
        self.names = [candidate.name for candidate in dictionary.candidates]
        self.price = PRICE + float(np.log(len(set(self.names))))
        G = dictionary.G
        self.behind = self._background_columns()
        self.groups = _groups(dictionary)
        self.Kb = G[:, self.behind].T @ G
        self.own = [_within(G, cols) for _, cols, _, _ in self.groups]
        self.off = np.empty((0, G.shape[1]))
        self.h = G.T @ y
        self.yy = float(y @ y)

    def background(self, level: float) -> Background:
        """Noise and a healthy arm's share of every effect, at one level."""
        return Background(self.dictionary.G[:, self.behind] * self.shares(level))

    def shares(self, level: float) -> Array:
        """Standard deviations of the background's columns."""
        shares: Array = self.dictionary.background(level)[self.behind] * np.sqrt(_thinned(self))
        return shares

    def _background_columns(self) -> Array:
        """Columns that make the background: main ones, of many forms of a name every so many."""
        kept, seen = [], dict.fromkeys(self.names, 0)
        for k, name in enumerate(self.names):
            if not seen[name] % self.dictionary.candidates[k].effect.STANDS_FOR:
                kept += list(self.dictionary.main[k])
            seen[name] += 1
        return np.array(sorted(set(kept)))

    @property
    def not_testable(self) -> tuple[str, ...]:
        """Names that no plausible size would show."""
        seen = {name for name, testable in zip(self.names, self.testable, strict=True) if testable}
        return tuple(dict.fromkeys(name for name in self.names if name not in seen))

    def beside(self, left: Array, free: Array) -> Search:
        """The same search for what is left (N,) of the residual, where the columns `free` (N, q) are free too."""
        other = copy(self)
        basis, _ = np.linalg.qr(free)
        G = self.dictionary.G
        other.y, other.off = left, basis.T @ G
        other.Kb = self.Kb - other.off[:, self.behind].T @ other.off
        other.h = G.T @ left - other.off.T @ (basis.T @ left)
        other.yy = float(left @ left)
        return other

    def table(self, level: float) -> Table:
        """Products under one background level."""
        return Table(self, level)

    def start(self, k: int, size: Array) -> Effect:
        """A candidate as an effect of a size given by its main coefficients, in healthy sizes."""
        effect: Any = self.dictionary.candidates[k].effect
        field, healthy = size_field(effect), healthy_size(effect)
        if len(size) == 2:
            phase = float(np.degrees(np.arctan2(size[1], size[0])))
            return effect.model_copy(update={field: float(np.hypot(*size)) * healthy, "phase_deg": phase})  # type: ignore[no-any-return]
        return effect.model_copy(update={field: float(size[0]) * healthy})  # type: ignore[no-any-return]

    def best(self, levels: Sequence[float]) -> Found:
        """The best set of names over background levels."""
        return max((self.at(level) for level in levels), key=lambda one: one.score)

    def at(self, level: float) -> Found:
        """The best set of names where the background has one level."""
        return Table(self, level).explained()


class Table:
    """Products of columns under one background level."""

    def __init__(self, search: Search, level: float) -> None:
        from scipy.linalg import solve_triangular  # noqa: PLC0415 - slow to import

        self.search, self.level = search, level
        behind = search.behind
        share = search.shares(level)
        gram = search.Kb[:, behind] * np.outer(share, share)
        L = np.linalg.cholesky(np.eye(len(share)) + gram)
        W = solve_triangular(L, share[:, None] * search.Kb, lower=True, check_finite=False)
        w = solve_triangular(L, share * search.h[behind], lower=True, check_finite=False)
        self.h = search.h - W.T @ w
        self._off = np.concatenate([search.off, W])
        self.null = -0.5 * (search.yy - float(w @ w)) - float(np.log(np.diag(L)).sum()) - _doubt(level)
        self._with: dict[int, Array] = {}
        self._blocks = [
            own - _within(self._off, cols) for own, (_, cols, _, _) in zip(search.own, search.groups, strict=True)
        ]

    def explained(self) -> Found:
        """Names added while one pays, each time dropped and swapped where that is better."""
        chosen: tuple[int, ...] = ()
        score = self.null
        for _ in range(self.search.depth):
            gains = self.gains(chosen)
            k = int(np.argmax(gains))
            if gains[k] < self.search.price:
                break
            chosen = (*chosen, k)
            chosen, score = self._mended(chosen, self.score(chosen))
        return Found(chosen, tuple(self.sizes(chosen)), score, self.level)

    def _mended(self, chosen: tuple[int, ...], score: float) -> tuple[tuple[int, ...], float]:
        """Names dropped that no longer pay, and each swapped for a better one, until nothing improves."""
        for _ in range(4):
            moves = [(score, chosen)]
            for place in range(len(chosen)):
                rest = chosen[:place] + chosen[place + 1 :]
                moves.append((self.score(rest), rest))
                k = int(np.argmax(self.gains(rest)))
                if k != chosen[place]:
                    moves.append((self.score((*rest, k)), (*rest, k)))
            best = max(moves)
            if best[1] == chosen:
                break
            score, chosen = best
        return chosen, score

    def gains(self, chosen: Sequence[int]) -> Array:
        """Evidence that each candidate adds to those chosen; -inf for one that cannot be named now."""
        search = self.search
        gains = np.full(len(search.names), -np.inf)
        h, drop = self._without(chosen)
        for (members, cols, mains, shares), block in zip(search.groups, self._blocks, strict=True):
            A = block if drop is None else block - drop(cols)
            b = h[cols]
            precision, x = _precision(A, b, mains, shares)
            H = A + precision
            t2 = (b * np.linalg.solve(H, b[:, :, None])[:, :, 0]).sum(axis=1)
            occam = np.linalg.slogdet(H)[1] - np.linalg.slogdet(precision)[1]
            seen = A[:, 0, 0] > _NOTHING
            gains[members] = np.where(seen, 0.5 * (t2 - occam), -np.inf)
            if mains == 1:
                for place in np.flatnonzero(x[:, 0] <= 0):
                    if one_sided(search.dictionary.candidates[members[place]].effect):
                        gains[members[place]] = -np.inf
        gains[~search.testable] = -np.inf
        taken = {search.names[k] for k in chosen}
        gains[[name in taken for name in search.names]] = -np.inf
        return gains

    def score(self, chosen: Sequence[int]) -> float:
        """Log density of y with some names, prices paid."""
        if not chosen:
            return self.null
        H, block, b, _ = self._normal(chosen)
        fit = float(b @ np.linalg.solve(H, b))
        occam = np.linalg.slogdet(H)[1] - np.linalg.slogdet(block)[1]
        return self.null + 0.5 * float(fit - occam) - self.search.price * len(chosen)

    def sizes(self, chosen: Sequence[int]) -> list[Array]:
        """Main coefficients of each chosen candidate, in healthy sizes."""
        if not chosen:
            return []
        H, _, b, places = self._normal(chosen)
        values: Array = np.asarray(np.linalg.solve(H, b), dtype=float)
        return [values[place][: len(self.search.dictionary.main[k])] for place, k in zip(places, chosen, strict=True)]

    def _cols(self, k: int) -> Array:
        return np.concatenate([self.search.dictionary.main[k], self.search.dictionary.shape[k]]).astype(int)

    def _row(self, column: int) -> Array:
        """Products of one column with all."""
        if column not in self._with:
            G = self.search.dictionary.G
            self._with[column] = G.T @ G[:, column] - self._off.T @ self._off[:, column]
        return self._with[column]

    def _without(self, chosen: Sequence[int]) -> tuple[Array, Callable[[Array], Array] | None]:
        """h, and what to take off a group's products, where the sizes of what is chosen are free."""
        if not chosen:
            return self.h, None
        H, _, b, _ = self._normal(chosen)
        rows = np.stack([self._row(int(c)) for k in chosen for c in self._cols(k)])
        half = np.linalg.solve(np.linalg.cholesky(H), rows)

        def drop(cols: Array) -> Array:
            part = half[:, cols]
            taken: Array = np.einsum("anq,anr->nqr", part, part)
            return taken

        return self.h - rows.T @ np.linalg.solve(H, b), drop

    def _normal(self, chosen: Sequence[int]) -> tuple[Array, Array, Array, list[slice]]:
        """Normal matrix with its prior, the prior, right side, and each candidate's place in them."""
        cols = np.concatenate([self._cols(k) for k in chosen])
        A = np.stack([self._row(int(c))[cols] for c in cols])
        b, prior = self.h[cols], np.zeros_like(A)
        places, begin = [], 0
        for k in chosen:
            own = self._cols(k)
            place = slice(begin, begin + len(own))
            mains = len(self.search.dictionary.main[k])
            shares = np.array([shape.share for shape in self.search.dictionary.candidates[k].shapes])
            precision, _ = _precision(A[None, place, place], b[None, place], mains, shares[None])
            prior[place, place] = precision[0]
            places.append(place)
            begin += len(own)
        return A + prior, prior, b, places


def _doubt(level: float) -> float:
    """Log odds against a healthy arm that shows so much of everything."""
    return DOUBT * max(0.0, float(np.log2(level / USUAL)))


def _thinned(search: Search) -> Array:
    """How many forms each background column stands for."""
    return np.array([float(search.dictionary.candidates[k].effect.STANDS_FOR) for k in _owners(search)])


def _owners(search: Search) -> list[int]:
    owner: dict[int, int] = {}
    for k, cols in enumerate(search.dictionary.main):
        for column in cols:
            owner.setdefault(int(column), k)
    return [owner[int(column)] for column in search.behind]


def _groups(dictionary: Dictionary) -> list[tuple[Array, Array, int, Array]]:
    """Candidates of one form: their numbers (n,), columns (n, q), how many of them are main, shares (n, q - main)."""
    forms: dict[tuple[int, int], list[int]] = {}
    for k in range(len(dictionary.candidates)):
        forms.setdefault((len(dictionary.main[k]), len(dictionary.shape[k])), []).append(k)
    return [
        (
            np.array(members),
            np.stack([np.concatenate([dictionary.main[k], dictionary.shape[k]]).astype(int) for k in members]),
            mains,
            np.array([[shape.share for shape in dictionary.candidates[k].shapes] for k in members]).reshape(
                len(members), shapes
            ),
        )
        for (mains, shapes), members in forms.items()
    ]


def _within(G: Array, cols: Array) -> Array:
    """Products of columns of G (N, p) within each candidate of a group, cols (n, q): (n, q, q)."""
    q = cols.shape[1]
    block = np.empty((len(cols), q, q))
    for i in range(q):
        for j in range(i, q):
            block[:, i, j] = block[:, j, i] = np.einsum("nk,nk->k", G[:, cols[:, i]], G[:, cols[:, j]])
    return block


def _precision(A: Array, b: Array, mains: int, shares: Array) -> tuple[Array, Array]:
    """Prior precision (n, q, q), and the main coefficients (n, mains) alone: wide for these, for shapes a share of
    them."""
    q = A.shape[1]
    own = A[:, :mains, :mains]
    own = own + 1e-9 * np.maximum(np.trace(own, axis1=1, axis2=2), 1.0)[:, None, None] * np.eye(mains)
    x = np.linalg.solve(own, b[:, :mains, None])[:, :, 0]
    t2 = (x * b[:, :mains]).sum(axis=1) / mains
    precision = np.zeros_like(A)
    precision[:, :mains, :mains] = own / (WIDE**2 + t2)[:, None, None]
    size = np.linalg.norm(x, axis=1, keepdims=True)
    for j in range(mains, q):
        precision[:, j, j] = 1 / np.maximum(shares[:, j - mains] * size[:, 0], 1e-3) ** 2
    return precision, x
