"""A ball on the tool, seated in sockets that are fixed in the world: where both are, from the poses of the tool."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.kinematics.arm import Array, Integers


def socket_design(T: Array, socket: Integers, sockets: int) -> Array:
    """Return the slopes (3 n, 3 + 3 s) of the ball's place from its socket by its place on the tool and by the places
    of so many sockets, at tool poses T (n, 4, 4) mm; socket (n,): the number of each, from 0."""
    design = np.zeros((len(T), 3, 3 + 3 * sockets))
    design[:, :, :3] = T[:, :3, :3]
    for axis in range(3):
        design[np.arange(len(T)), axis, 3 + 3 * socket + axis] = -1.0
    return design.reshape(3 * len(T), -1)


def left_in_sockets(T: Array, names: NDArray[np.str_]) -> Array:
    """Return how far (n, 3) mm the ball is from its socket at tool poses T (n, 4, 4) mm, with the ball's place on the
    tool and those of the sockets, named (n,), fitted."""
    sockets, socket = np.unique(names, return_inverse=True)
    design, seen = socket_design(T, socket.ravel(), len(sockets)), -T[:, :3, 3].ravel()
    residual: Array = (design @ np.linalg.lstsq(design, seen)[0] - seen).reshape(-1, 3)
    return residual
