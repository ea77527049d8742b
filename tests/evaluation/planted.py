"""Planted and recovered: each test's figures measured many times from closed forms with noise, beside what was planted.

Nothing here uses the simulator. Run as a script (`scripts/planted`) it prints, for every figure, in how many fresh
seeds the planted value lay within 2 u.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from analysis.kinematics.arm import Arm, forward
from analysis.model.circle import CircleFrame
from analysis.reading.lap import Lap
from analysis.reading.tables import PoseTable, RadialTable, RepeatabilityTable
from analysis.reporting.quantity import Quantity
from analysis.tests import circularity, pair, pose, radial, repeatability, roll, standards, yaw

FRESH = 50_000
"""First seed of the script; the tests hold others."""
RADIUS, BASELINE, SPEED = 70.0, 50.0, 25.0 / 70.0
FRAME = CircleFrame(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0]), RADIUS)
U_GAUGE, U_BASELINE, U_LAG = 0.0005, 0.02, 2e-3
BALL = np.array([0.8, -0.5, 0.3])
FINE = np.linspace(0, 2 * np.pi, 36001)[:-1]

Figures = Mapping[str, Quantity]
Case = tuple[dict[str, float], Callable[[np.random.Generator], Figures]]


def within(case: Case, seeds: Iterable[int]) -> dict[str, int]:
    """In how many of the seeds each figure lay within two of its uncertainties from the planted."""
    truth, measure = case
    hits: Counter[str] = Counter()
    for seed in seeds:
        figures = measure(np.random.default_rng(seed))
        assert figures.keys() == truth.keys(), figures.keys() ^ truth.keys()
        hits.update({name: int(_hit(name, figure, truth[name])) for name, figure in figures.items()})
    return dict(hits)


def _hit(name: str, figure: Quantity, truth: float) -> bool:
    off = figure.value - truth
    if name.endswith("_at_deg"):
        off = (off + 180) % 360 - 180
    return abs(off) <= 2 * figure.u


# --- circle: what the robot does wrong, as smooth functions of phi with jumps where a joint turns


def wrong_angle(phi: np.ndarray, sense: float) -> np.ndarray:
    """Orientation error (n,) rad: harmonics and, of a backlash, jumps about 105° and 237° that change sign
    with sense (over some degrees: a joint crosses its play slowly where it turns)."""
    turn = np.degrees(phi) % 360
    play = 0.5 * (np.tanh((turn - 105) / 1.5) - np.tanh((turn - 237) / 1.5) - 1)
    play *= 1 + 0.3 * np.cos(phi - np.radians(170))  # so that there is one place where it shows most
    rough = 0.15 * np.sin(2 * phi + 0.4) + 0.05 * np.sin(7 * phi) + 0.08 * sense * play
    return np.asarray(np.radians(rough))


def wrong_distance(phi: np.ndarray, sense: float) -> np.ndarray:
    """Radial error (n,) mm."""
    return np.asarray(0.03 * np.sin(3 * phi) + 0.02 * np.cos(2 * phi + 1) + 0.01 * sense * np.sin(phi + 0.3) ** 2)


def circle_readings(phi: np.ndarray, sense: float, test: str) -> np.ndarray:
    """(n, 2) mm: the ball link's geometry in the plane, by its own formula, plus what is wrong."""
    x, y = RADIUS * np.cos(phi) - BALL[0], RADIUS * np.sin(phi) - BALL[1]
    along_z = x * np.cos(phi) + y * np.sin(phi)
    along_e = BALL[2] if test == "roll" else y * np.cos(phi) - x * np.sin(phi)
    # acw tangent is -y_T times … : l·y_T = (B - P)·y_T with y_T = z_T × x_T, z_T = -r, x_T = n.
    angle = np.arctan2(along_e if test == "roll" else -along_e * _HAND, along_z) + wrong_angle(phi, sense)
    distance = np.hypot(x, y) + wrong_distance(phi, sense) - RADIUS
    half = np.tan(angle) * BASELINE / 2
    return np.stack([distance - half, distance + half], axis=1)


_TANGENT = np.cross([-1.0, 0, 0], [0, 0, 1.0])
"""y_T at phi = 0: z_T × x_T with z_T = -u, x_T = n."""
_HAND = float(_TANGENT[1])


def circle_lap(rng: np.random.Generator, sense: float, test: str, setup: np.random.Generator | None = None) -> Lap:
    """A noisy lap: its rows anywhere, the clock's lag and the baseline drawn (from `setup`, if given) as stated."""
    count, setup = 900, setup or rng
    lag, baseline = setup.normal(0, U_LAG), BASELINE + setup.normal(0, U_BASELINE)
    t = (np.arange(count) + rng.uniform(0, 1, count)) / count * 2 * np.pi / SPEED
    phi = sense * SPEED * t
    g = circle_readings(phi - sense * SPEED * lag, sense, test)
    middle, half = g.mean(axis=1), (g[:, 0] - g[:, 1]) / 2 * baseline / BASELINE
    seen = np.stack([middle + half, middle - half], axis=1) + rng.normal(0, U_GAUGE, g.shape)
    return Lap("acw" if sense > 0 else "cw", FRAME, t, phi, np.zeros((count, 6)), seen)


def _true_angle(test: str, sense: float = 1.0) -> np.ndarray:
    g = circle_readings(FINE, sense, test)
    return np.asarray(np.arctan((g[:, 1] - g[:, 0]) / BASELINE))


def yaw_case() -> Case:
    truth = yaw.plain_figures(FINE, _true_angle("yaw"), RADIUS)
    return truth, lambda rng: yaw.evaluate(circle_lap(rng, 1, "yaw"), BASELINE, U_BASELINE, U_LAG).figures


def roll_case() -> Case:
    truth = roll.plain_figures(FINE, _true_angle("roll"), RADIUS)
    return truth, lambda rng: roll.evaluate(circle_lap(rng, 1, "roll"), BASELINE, U_BASELINE, U_LAG).figures


def circularity_case() -> Case:
    truth = circularity.plain_figures(FINE, circle_readings(FINE, 1, "yaw").mean(axis=1), RADIUS)
    return truth, lambda rng: circularity.evaluate(circle_lap(rng, 1, "yaw"), U_LAG).figures


def pair_case() -> Case:
    angles = [(FINE, _true_angle("yaw", sense)) for sense in (1.0, -1.0)]
    distances = [(FINE, circle_readings(FINE, sense, "yaw").mean(axis=1)) for sense in (1.0, -1.0)]
    truth = pair.plain_figures(angles, distances, RADIUS)

    def measure(rng: np.random.Generator) -> Figures:
        seed = int(rng.integers(2**31))
        acw, cw = (
            yaw.evaluate(circle_lap(rng, sense, "yaw", np.random.default_rng(seed)), BASELINE, U_BASELINE, U_LAG)
            for sense in (1.0, -1.0)
        )
        return pair.pair(acw, cw).figures

    return truth, measure


# --- hemisphere


def hemisphere(visits: int = 1) -> RadialTable:
    """37 targets each 30°, three orientations, without readings."""
    places = [(0.0, 0.0)] + [(polar, azimuth) for polar in (30.0, 60.0, 90.0) for azimuth in range(0, 360, 30)]
    rows = [(k + 1, *place, o) for k, place in enumerate(places) for o in (1, 2, 3) for _ in range(visits)]
    target, polar, azimuth, orientation = (np.array(column) for column in zip(*rows, strict=True))
    zeros = np.zeros(len(rows))
    return RadialTable(
        target, np.radians(polar), np.radians(azimuth), orientation, zeros, np.zeros((len(rows), 6)), zeros
    )


def with_readings(table: RadialTable, g_mm: np.ndarray) -> RadialTable:
    return RadialTable(table.target, table.polar, table.azimuth, table.orientation, table.t_s, table.q, g_mm)


def directions(table: RadialTable) -> np.ndarray:
    s = np.sin(table.polar)
    return np.stack([s * np.cos(table.azimuth), s * np.sin(table.azimuth), np.cos(table.polar)], axis=1)


def true_radial(table: RadialTable) -> np.ndarray:
    """Readings (n,) mm: radius 0.192 too large, pulled to one side, an error of each target and orientation."""
    robot = np.random.default_rng(77).normal(0, 0.12, (100, 4))
    pull = directions(table) @ np.array([0.3, -0.2, 0.1])
    return 0.192 + pull + 0.9 * robot[table.target, 3] + 0.5 * robot[table.target, table.orientation - 1]


def radial_case() -> Case:
    once = hemisphere()
    nothing = radial.evaluate(with_readings(once, true_radial(once)), 400.0, 0.0)
    truth = {name: figure.value for name, figure in nothing.figures.items()}
    scatter, many = 0.005, hemisphere(visits=3)
    x = scatter * np.random.default_rng(3).standard_normal((4000, 37 * 3, 3))
    again = standards.rp(x[..., None])
    truth |= {"rp_mm": float(again.max(axis=1).mean()), "rp_mean_mm": float(again.mean())}

    def measure(rng: np.random.Generator) -> Figures:
        g = true_radial(many) + rng.normal(0, scatter, len(many.g_mm))
        return radial.evaluate(with_readings(many, g), 400.0, 0.0005).figures

    return truth, measure


def radial_one_visit_case() -> Case:
    """Each target with a scatter of its own from the table of real cells, and nothing that shows it."""
    once = hemisphere()
    nothing = radial.evaluate(with_readings(once, true_radial(once)), 400.0, 0.0)
    truth = {name: figure.value for name, figure in nothing.figures.items()}

    def measure(rng: np.random.Generator) -> Figures:
        sd = np.exp(rng.uniform(np.log(0.003), np.log(0.06), 38))[once.target]
        g = true_radial(once) + sd * rng.standard_normal(len(sd)) + rng.normal(0, 0.01)
        return radial.evaluate(with_readings(once, g), 400.0, 0.002, u_link_mm=0.01).figures

    return truth, measure


# --- repeatability: the truth of a range or an s is its expectation for so many readings


def repeatability_table(g: np.ndarray) -> RepeatabilityTable:
    """Of readings (targets, rounds, 2): out, then in."""
    targets, rounds, _ = g.shape
    rows = [(t + 1, side, r + 1) for t in range(targets) for r in range(rounds) for side in ("out", "in")]
    target, approach, round_ = zip(*rows, strict=True)
    zeros = np.zeros(len(rows))
    return RepeatabilityTable(
        np.array(target), np.array(approach), np.array(round_), zeros, np.zeros((len(rows), 6)), g.ravel()
    )


def repeatability_case() -> Case:
    B = np.random.default_rng(8).uniform(0.2, 1.4, 12)
    sd = np.exp(np.random.default_rng(10).uniform(np.log(0.003), np.log(0.06), 12))[:, None, None]
    mean = np.stack([-B / 2, B / 2], axis=1)[:, None, :]
    many = np.swapaxes(mean + sd * np.random.default_rng(9).standard_t(4, (8000, 12, 3, 2)), -1, -2)
    truth = {name: float(values.mean()) for name, values in repeatability.plain_figures(many).items()}
    truth["reversal_mean_mm"] = float(B.mean())

    def measure(rng: np.random.Generator) -> Figures:
        return repeatability.evaluate(repeatability_table(mean + sd * rng.standard_t(4, (12, 3, 2))), 0.0005).figures

    return truth, measure


# --- pose: a UR10 with offsets in its joints, seen by a tracker somewhere


def ur10() -> Arm:
    """The nominal UR10 of the data set's README, its standard DH rows moved to Craig's."""
    ninety = np.pi / 2
    return Arm(
        a=np.array([0, 0, -612.0, -572.3, 0, 0]),
        alpha=np.array([0, ninety, 0, 0, ninety, -ninety]),
        beta=np.zeros(6),
        d=np.array([127.3, 0, 0, 163.941, 115.7, 92.2]),
        offset=np.zeros(6),
        coupling=np.eye(6),
        T_world_base=np.eye(4),
        T_flange_tool=np.eye(4),
        limits=np.full((6, 2), np.pi),
        speed=np.ones(6),
    )


def pose_case() -> Case:
    from scipy.spatial.transform import Rotation  # noqa: PLC0415

    rng = np.random.default_rng(11)
    arm, u_mm, u_rad, scatter = ur10(), 0.01, 2e-5, 0.02
    q = rng.uniform(-2, 2, (60, 6))
    wrong = pose.dataclasses.replace(arm, offset=np.array([0, 0.001, -0.0012, 0.002, 0.001, 0]))
    base, tool = np.eye(4), np.eye(4)
    base[:3, :3], base[:3, 3] = Rotation.from_rotvec([0.3, -0.2, 1.0]).as_matrix(), (2000.0, -900.0, -450.0)
    tool[:3, :3], tool[:3, 3] = Rotation.from_rotvec([0.5, 0.1, 0.2]).as_matrix(), (10.0, 20.0, 130.0)
    T = base @ forward(wrong, q) @ tool
    turned = Rotation.from_matrix(T[:, :3, :3])

    def table(rng: np.random.Generator | None) -> PoseTable:
        again = np.repeat(np.arange(60), 3)
        xyz, R = T[again, :3, 3], turned[again]
        if rng is None:
            return PoseTable(q, T[:, :3, 3], turned.as_euler("xyz"))
        xyz = xyz + rng.normal(0, scatter, xyz.shape)
        R = Rotation.from_rotvec(rng.normal(0, u_rad, xyz.shape)) * R
        return PoseTable(q[again], xyz, R.as_euler("xyz"))

    clean = pose.evaluate(table(None), arm, 1e-9, 1e-12)
    groups = clean.position_mm[:, None] + np.random.default_rng(12).normal(0, scatter, (3000, 60, 3, 3))
    turns = np.degrees(clean.rotation[:, None] + np.random.default_rng(13).normal(0, u_rad, (3000, 60, 3, 3)))
    truth = {name: figure.value for name, figure in clean.figures.items()} | {"repeat_mm": scatter}
    for plain, x in ((pose._place_figures, groups), (pose._turn_figures, turns)):
        truth |= {name: float(values.mean()) for name, values in plain(np.swapaxes(x, -1, -2)).items()}
    # The scatter of the visits is an error of the poses too: it adds to the rms of so many lengths.
    lengths = pose._lengths(groups.reshape(3000, -1, 3))
    truth |= {name: float(values.mean()) for name, values in lengths.items()}
    angles = pose._angles(np.radians(turns).reshape(3000, -1, 3))
    truth |= {name: float(values.mean()) for name, values in angles.items()}
    del u_mm
    return truth, lambda rng: pose.evaluate(table(rng), arm, scatter, u_rad).figures


CASES: dict[str, Callable[[], Case]] = {
    "yaw": yaw_case,
    "roll": roll_case,
    "circularity": circularity_case,
    "pair": pair_case,
    "radial, three visits": radial_case,
    "radial, one visit": radial_one_visit_case,
    "repeatability": repeatability_case,
    "pose": pose_case,
}


def main() -> None:
    """`planted.py [SEEDS [CASE…]]`: for every figure, in how many of so many fresh seeds the planted was recovered."""
    count, names = int(sys.argv[1]) if len(sys.argv) > 1 else 100, sys.argv[2:] or list(CASES)
    for name in names:
        for figure, hits in within(CASES[name](), range(FRESH, FRESH + count)).items():
            print(f"{name:22} {figure:28} {hits:4d} of {count}  {100 * hits / count:5.1f} %", flush=True)


if __name__ == "__main__":
    main()
