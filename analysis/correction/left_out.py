"""What a correction leaves out, at each target: effects that no target can make up for still move the arm.

Each target is driven to from either side and early and late in a shift, as nobody knows how a program will come there.
What an effect does then, root mean square, is its share of the uncertainty of the place: half the play of a joint, what
is left of a spike on arrival, growth that comes with warming up.
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
"""So far every joint comes from the side: further than any play."""
_SWING_S, _STEPS = 0.1, 20
"""How long a joint takes from the turn to the target, at some 20 degrees a second, and samples of that."""
_REST_S = 1.0
_LATE_S = 1e6
"""Beyond the time constants of all that warms up."""


def left_out_mm(rig: Rig, effects: Sequence[Effect], q: Array) -> Array:
    """Root mean square (n, e) mm of what each effect that is not corrected does to the places of joint angles q (n, 6)
    rad."""
    nothing = model_of(rig, ())
    squares = np.zeros((len(q), len(effects)))
    for path in (_driven(q, side, begin_s) for side in (1.0, -1.0) for begin_s in (0.0, _LATE_S)):
        places = _places(nothing, path)
        for k, effect in enumerate(effects):
            squares[:, k] += ((_places(model_of(rig, (effect,)), path) - places) ** 2).sum(axis=1) / 4
    return np.sqrt(squares)


def _places(model: Model, path: Path) -> Array:
    places: Array = moved(model, path).T[path.rows, :3, 3]
    return places


def _driven(q: Array, side: float, begin_s: float) -> Path:
    """From each target to a side, back to it and on, so that nothing turns at the target, a rest before the next."""
    along = np.concatenate([np.linspace(0, -1, _STEPS, endpoint=False), np.linspace(-1, 1, 2 * _STEPS + 1)])
    swings = q[:, None, :] + side * _SWING_RAD * along[:, None]
    one = np.arange(len(along)) * (_SWING_S / _STEPS)
    starts = begin_s + np.arange(len(q)) * (one[-1] + _REST_S)
    rows = np.arange(len(q)) * len(one) + 2 * _STEPS
    return Path(Motion((starts[:, None] + one).ravel(), swings.reshape(-1, 6)), rows)
