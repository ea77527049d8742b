"""Printed parts: closed surfaces, read back from their STL by other lines, with the numbers of the rig file."""

import re
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from analysis.apps.parts.sheet import drawing, purchases, sheet
from analysis.apps.parts.sizes import Bought, PrintedPart, parts_of, remarks_of, seat_of
from analysis.apps.parts.solid import turned
from rigs.arms import load_arm
from rigs.load import load, parse
from rigs.rig import Rig
from tests.support.command_line import errors_of, ran, succeeded
from tests.support.refusals import refused

TOUCH = "{sockets: [A, B, C, D], ball_mm: [30, 0, -90], distances: [{between: [A, B], distance_mm: 120}]}"
TEXT = f"name: so\n{load_arm('so-101').text}\ntests: {{touch: {TOUCH}}}\n"


def rig_with(distance_mm: float = 120.0) -> Rig:
    return parse(TEXT.replace("distance_mm: 120", f"distance_mm: {distance_mm}"), "so.yaml")


def facets(stl: bytes) -> np.ndarray:
    """The triangles (m, 3, 3) of a binary STL, by its published layout."""
    count = int.from_bytes(stl[80:84], "little")
    assert len(stl) == 84 + 50 * count
    return np.array([np.frombuffer(stl, "<f4", 12, 84 + 50 * k)[3:].reshape(3, 3) for k in range(count)])


def edges(triangles: np.ndarray) -> Counter[tuple[tuple[float, ...], ...]]:
    """Number of faces that use each directed edge, between the corners in the file."""
    ways = [(tuple(a.tolist()), tuple(b.tolist())) for t in triangles for a, b in zip(t, t[[1, 2, 0]], strict=True)]
    return Counter(ways)


PARTS = [("touches", rig_with()), ("circle", load("ur10e")[0])]
EACH = [pytest.param(part, id=f"{name}-{part.name}") for name, rig in PARTS for part in parts_of(rig, Bought())]


@pytest.mark.parametrize("part", EACH)
def test_every_edge_has_one_opposite_partner(part):
    ways = edges(facets(part.solid.stl()))
    assert set(ways.values()) == {1}
    assert {(b, a) for a, b in ways} == set(ways)
    assert part.solid.volume_mm3 > 1000


def test_a_turned_cylinder_has_its_volume():
    solid = turned([(0, 10), (5, 10), (5, 0), (0, 0)])
    assert solid.volume_mm3 == pytest.approx(np.pi * 25 * 10, rel=1e-3)
    ring = turned([(5, 10), (5, 0), (3, 0), (3, 10)])
    assert ring.volume_mm3 == pytest.approx(np.pi * 16 * 10, rel=1e-3)


def by_name(rig: Rig, bought: Bought | None = None) -> dict[str, PrintedPart]:
    return {part.name: part for part in parts_of(rig, bought or Bought())}


def rests_at(part: PrintedPart, axis_mm: float, ball_mm: float) -> float:
    """How high a ball's centre stands that is let down along an axis until it meets a face of the part: by its
    corners and edges, which are nearer to the axis than what lies between."""
    corners = facets(part.solid.stl()).reshape(-1, 3)
    triangles = facets(part.solid.stl())
    middles = (triangles + triangles[:, [1, 2, 0]]).reshape(-1, 3) / 2
    points = np.vstack([corners, middles, triangles.mean(axis=1)])
    away = np.hypot(points[:, 0] - axis_mm, points[:, 1])
    near = away < ball_mm / 2
    return float((points[near, 2] + np.sqrt((ball_mm / 2) ** 2 - away[near] ** 2)).max())


def test_the_numbers_are_those_of_the_rig_file():
    parts = by_name(rig_with(97.5))
    assert parts["bar"].numbers["distance of the sockets"] == 97.5
    assert parts["holder"].numbers["ball's centre above the foot"] == 90.0  # ball_mm: [30, 0, -90]
    assert {name: part.count for name, part in parts.items()} == {"holder": 1, "socket": 2, "bar": 1}
    link = by_name(load("ur10e")[0])["link"]
    circle = load("ur10e")[0].tests.circle
    assert link.numbers["ball to ball"] == circle.radius_mm


@pytest.mark.parametrize("ball_mm", [20.0, 25.4])
def test_ball_in_the_bar_is_at_the_drawn_place(ball_mm):
    bar = by_name(rig_with(), Bought(ball_mm=ball_mm))["bar"]
    for axis in (-60.0, 60.0):
        assert rests_at(bar, axis, ball_mm) == pytest.approx(bar.numbers["ball's centre above the foot"], abs=0.05)
        assert rests_at(bar, axis + 0.5, ball_mm) > rests_at(bar, axis, ball_mm) + 0.2  # it is the lowest place


def test_the_magnet_never_touches_the_ball_and_the_cone_holds_it():
    seat = seat_of(Bought())
    assert seat.centre - 10 - seat.magnet_top == pytest.approx(0.5)
    assert seat.bore < seat.contact < seat.rim
    with refused("parts.impossible"):
        seat_of(Bought(magnet_mm=(20, 5)))
    with refused("parts.impossible"):
        parts_of(rig_with(), Bought(screw="M5"))
    with refused("parts.unknown"):
        parts_of(rig_with(), Bought(screw="M7"))


def test_parts_larger_than_the_bed_are_left_out_and_named():
    rig = rig_with(400)
    assert "bar" not in by_name(rig)
    assert any("sockets is 424" in remark for remark in remarks_of(rig, Bought()))
    assert any("is 400 mm" in remark for remark in remarks_of(load("ur10e")[0], Bought()))
    assert any("30 mm off" in remark for remark in remarks_of(rig, Bought()))


@pytest.mark.parametrize("rig", [rig for _, rig in PARTS], ids=[name for name, _ in PARTS])
def test_all_that_is_bought_costs_less_than_50_euro(rig):
    parts = parts_of(rig, Bought())
    assert sum(purchase.euro for purchase in purchases(parts, Bought())) < 50
    text = sheet(parts, Bought(), rig.name, [])
    assert all(f"`{part.name}.stl`" in text for part in parts)


def test_the_drawing_is_true_to_scale_and_names_each_part():
    parts = parts_of(rig_with(), Bought())
    svg = ElementTree.fromstring(drawing(parts, "so: parts & more"))  # noqa: S314 - our own
    assert svg.get("width") == f"{svg.get('viewBox', '').split()[2]}mm"
    words = [text.text or "" for text in svg.iter("{http://www.w3.org/2000/svg}text")]
    assert {"2 × socket", "1 × bar", "1 × holder"} <= set(words) and any(": 120.00" in word for word in words)


def test_the_picture_of_the_page_is_the_drawing():
    kept = (Path(__file__).parents[4] / "docs" / "images" / "parts.svg").read_text()
    assert kept == drawing(parts_of(rig_with(), Bought()), "so: parts to print, mm")


def test_the_command_writes_them_and_the_line_of_a_measured_bar(tmp_path):
    rig = tmp_path / "so.yaml"
    rig.write_text(TEXT)
    succeeded(f"parts {rig} -o {tmp_path}/parts")
    written = {file.name for file in (tmp_path / "parts").iterdir()}
    assert written == {"holder.stl", "socket.stl", "bar.stl", "parts.svg", "parts.md"}
    again = ran(f"parts {rig} -o {tmp_path}/parts")
    assert again.returncode != 0
    assert "exists already" in again.stderr
    measured = ran(f"parts {rig} --over-balls-mm 139.96 --u-mm 0.03")
    assert measured.stdout.strip() == "distances: [{between: [A, B], distance_mm: 119.96, u_mm: 0.03}]"
    changed = re.sub(r"distances: \[.*\]", measured.stdout.strip(), TEXT)
    assert parse(changed, "so.yaml").tests.touch.distances[0].distance_mm == 119.96
    for bad in (["--magnet-mm", "10"], ["--magnet-mm", "a,b"], ["--over-balls-mm", "15"], []):
        errors_of("parts", str(rig), *bad, exit_code=2)
