"""The STL of `rig parts`, read by trimesh: closed, volume, size, walls, overhangs, and where a ball sits.

    pip install trimesh rtree scipy      # in an environment of its own beside rig: they are not in the lock
    python tests/trials/printed_parts.py          # of that environment, PYTHONPATH=.

For each part of three sets of things bought: whether it is one closed body, its volume and size, the thinnest wall
between faces that look away from each other, and the faces that no printer lays without supports (steeper than 45°
downwards, above the bed). A ball at the place that the drawing has for it must touch the cone and enter nothing: how
far its surface is off is printed, in mm.
"""

from __future__ import annotations

import io
import sys
from argparse import Namespace
from collections.abc import Iterator
from typing import Any

import numpy as np

from analysis.apps.parts.sizes import Bought, PrintedPart, parts_of
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.declared_tests import Touch
from tests.support.trial import Trial, main

BOUGHT = (Bought(), Bought(25.0, (12.0, 4.0), "M5"), Bought(40.0, (20.0, 5.0), "M5"))
STEEP = np.cos(np.radians(45.0)) + 1e-9
AWAY = -0.5
"""Cosine of the angle between faces of one wall: below it they look away from each other."""


def draw(given: Namespace) -> Iterator[tuple[Bought, PrintedPart]]:
    for bought in BOUGHT:
        yield from ((bought, part) for part in parts_of(_rig(), bought))


def judged(case: tuple[Bought, PrintedPart]) -> str:
    bought, part = case
    return f"ball {bought.ball_mm:g} mm, magnet {bought.magnet_mm}, {bought.screw}: {part.name}: {seen(part)}"


def _rig() -> Rig:
    """The UR10e with a circle of 70 mm, four sockets, and two of them 120 mm apart."""
    rig, _ = load("ur10e")
    distance = {"between": ["A", "B"], "distance_mm": 120.0, "u_mm": 0.05}
    touch = Touch.model_validate({"sockets": list("ABCD"), "ball_mm": [0, 0, 90], "distances": [distance]})
    return rig.model_copy(update={"tests": rig.tests.model_copy(update={"touch": touch})})


def seen(part: PrintedPart) -> str:
    """What trimesh finds of the file of a part."""
    import trimesh  # noqa: PLC0415 - not in the lock

    mesh: Any = trimesh.load(io.BytesIO(part.solid.stl()), file_type="stl")
    closed = mesh.is_watertight and mesh.is_winding_consistent and mesh.is_volume and mesh.body_count == 1
    points, faces = trimesh.sample.sample_surface(mesh, 20_000, seed=1)
    inwards = -mesh.face_normals[faces]
    places, rays, hit = mesh.ray.intersects_location(points + 1e-4 * inwards, inwards, multiple_hits=False)
    wall = (mesh.face_normals[hit] * -inwards[rays]).sum(axis=1) < AWAY
    thinnest = np.linalg.norm(places - points[rays], axis=1)[wall].min()
    centres = mesh.triangles_center
    hangs = (mesh.face_normals[:, 2] < -STEEP) & (centres[:, 2] > mesh.bounds[0, 2] + 1e-3)
    size = " × ".join(f"{extent:.2f}" for extent in mesh.extents)
    off = max(abs(float(mesh.nearest.on_surface([ball])[1][0]) - part.numbers["ball"] / 2) for ball in _balls(part))
    return (
        f"{'closed, one body' if closed else 'NOT CLOSED'}, {mesh.volume / 1000:.2f} cm³ "
        f"({part.solid.volume_mm3 / 1000:.2f} by rig), {size} mm, walls from {thinnest:.2f} mm, "
        f"overhang {mesh.area_faces[hangs].sum():.0f} mm², ball off by {off:.4f} mm"
    )


def _balls(part: PrintedPart) -> list[tuple[float, float, float]]:
    """The centres of the balls by the numbers of the drawing."""
    numbers = part.numbers
    if "ball to ball" in numbers:
        middle, half = numbers["length"] / 2, numbers["ball to ball"] / 2
        return [(0.0, 0.0, middle - half), (0.0, 0.0, middle + half)]
    half = numbers.get("distance of the sockets", 0.0) / 2
    return [(x, 0.0, numbers["ball's centre above the foot"]) for x in (-half, half)]


TRIAL = Trial(
    draw,
    judged,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
