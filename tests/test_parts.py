"""The files of docs/parts.md, read by the published layout of a binary STL."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

PARTS = Path(__file__).parents[1] / "docs" / "parts"
BALL_MM = 20.0


def facets(name: str) -> np.ndarray:
    stl = (PARTS / f"{name}.stl").read_bytes()
    count = int.from_bytes(stl[80:84], "little")
    assert len(stl) == 84 + 50 * count
    return np.array([np.frombuffer(stl, "<f4", 12, 84 + 50 * k)[3:].reshape(3, 3) for k in range(count)])


@pytest.mark.parametrize("name", ["holder", "socket", "bar", "link"])
def test_every_edge_of_a_part_has_one_opposite_partner(name):
    edges = [(tuple(a), tuple(b)) for t in facets(name).tolist() for a, b in zip(t, [t[1], t[2], t[0]], strict=True)]
    assert set(Counter(edges).values()) == {1}
    assert {(b, a) for a, b in edges} == set(edges)


@pytest.mark.parametrize(
    ("name", "axis_mm", "centre_mm"), [("bar", -50, 20.75), ("bar", 50, 20.75), ("socket", 0, 20.75), ("holder", 0, 60)]
)
def test_ball_rests_where_the_page_states(name, axis_mm, centre_mm):
    """Lower a ball along the axis until it meets a corner or the middle of a face or edge."""
    triangles = facets(name)
    middles = (triangles + triangles[:, [1, 2, 0]]) / 2
    points = np.vstack([triangles.reshape(-1, 3), middles.reshape(-1, 3), triangles.mean(axis=1)])
    away = np.hypot(points[:, 0] - axis_mm, points[:, 1])
    near = away < BALL_MM / 2
    height = (points[near, 2] + np.sqrt((BALL_MM / 2) ** 2 - away[near] ** 2)).max()
    assert height == pytest.approx(centre_mm, abs=0.05)
