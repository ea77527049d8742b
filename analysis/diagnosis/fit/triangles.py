"""Symmetric matrices as their lower triangles, row by row, in half of the memory."""

from __future__ import annotations

import numpy as np

from analysis.robot.kinematics.arm import Array


def lower_triangle(matrix: Array) -> Array:
    """Lower triangle (p (p + 1) / 2,) of a matrix (p, p).

    >>> lower_triangle(np.array([[1.0, 2.0], [2.0, 3.0]]))
    array([1., 2., 3.])
    """
    return np.concatenate([row[: k + 1] for k, row in enumerate(matrix)])


def symmetric(triangle: Array) -> Array:
    """Symmetric matrix (p, p) with a lower triangle.

    >>> symmetric(np.array([1.0, 2.0, 3.0]))
    array([[1., 2.],
           [2., 3.]])
    """
    p = int(np.sqrt(2 * len(triangle)))
    matrix, begin = np.empty((p, p)), 0
    for k in range(p):
        row = triangle[begin : begin + k + 1]
        matrix[k, : k + 1] = matrix[: k + 1, k] = row
        begin += k + 1
    return matrix


def double_triangle(matrix: Array) -> Array:
    """Lower triangle of a symmetric matrix with doubled values off its diagonal: its products with lower triangles are
    sums over all elements of the matrices.

    >>> double_triangle(np.array([[1.0, 2.0], [2.0, 3.0]]))
    array([1., 4., 3.])
    """
    triangle = 2 * lower_triangle(matrix)
    triangle[np.cumsum(np.arange(1, len(matrix) + 1)) - 1] /= 2
    return triangle
