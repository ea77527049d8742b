"""What a correction leaves out at each target: effects that no target can compensate still move the arm.

Each target is approached from either side, and early and late in a shift, because the program's approach is unknown.
The root mean square error of an effect over these is its share of the uncertainty of the position: half the play of a
joint, the rest of a spike on arrival, growth by warming.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.kinematics.arm import Array
from analysis.model.hysteresis import Motion
from analysis.model.predict import Model, Path, model_of, moved
from rigs.effects import Effect
from rigs.rig import Rig

_SWING_RAD = np.radians(2.0)
"""Distance over which every joint approaches from the side. Chosen: wider than any play."""
_SWING_S, _STEPS = 0.1, 20
"""Time from the reversal of a joint to the target, at some 20 degrees per second, and the number of samples in it.
Chosen: a usual speed."""
_REST_S = 1.0
"""Rest before the next target in seconds. Chosen: longer than the decay of a reversal spike."""
_LATE_S = 1e6
"""Time of a late approach, beyond the time constants of all warming."""


def left_out_mm(rig: Rig, effects: Sequence[Effect], q: Array) -> Array:
    """Return the root mean square error (n, e) mm that each effect that is not corrected causes at joint angles q (n,
    6) rad."""
    nothing = model_of(rig, ())
    squares = np.zeros((len(q), len(effects)))
    for path in _approaches(q):
        places = _places(nothing, path)
        for k, effect in enumerate(effects):
            squares[:, k] += ((_places(model_of(rig, (effect,)), path) - places) ** 2).sum(axis=1) / 4
    return np.sqrt(squares)


def apart_mm(model: Model, second: Model, q: Array) -> Array:
    """Return the root mean square distance (n,) mm between the tools of two models at joint angles q (n, 6) rad."""
    squares = [((_places(model, path) - _places(second, path)) ** 2).sum(axis=1) for path in _approaches(q)]
    return np.asarray(np.sqrt(np.mean(squares, axis=0)))


def _approaches(q: Array) -> list[Path]:
    """Return the four ways to come to joint angles q (n, 6) rad: from either side, early and late."""
    return [_driven(q, side, begin_s) for side in (1.0, -1.0) for begin_s in (0.0, _LATE_S)]


def _places(model: Model, path: Path) -> Array:
    places: Array = moved(model, path).T[path.rows, :3, 3]
    return places


def _driven(q: Array, side: float, begin_s: float) -> Path:
    """Return a path that goes from each target to one side, back to it and beyond, so that no joint reverses at the
    target, with a rest before the next."""
    along = np.concatenate([np.linspace(0, -1, _STEPS, endpoint=False), np.linspace(-1, 1, 2 * _STEPS + 1)])
    swings = q[:, None, :] + side * _SWING_RAD * along[:, None]
    swing_s = np.arange(len(along)) * (_SWING_S / _STEPS)
    starts = begin_s + np.arange(len(q)) * (swing_s[-1] + _REST_S)
    rows = np.arange(len(q)) * len(swing_s) + 2 * _STEPS
    return Path(Motion((starts[:, None] + swing_s).ravel(), swings.reshape(-1, q.shape[1])), rows)
