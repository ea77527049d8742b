"""Poses of an arm with joint errors, measured by a tracker at a random place, with scattering stops. Lengths are in
mm.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

from analysis.procedures.shared.test_kind import evaluate
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.runs.noise.cell_noise import TRACKER_U_MM
from analysis.runs.tables import PoseTable
from rigs.load import load
from tests.worlds.planted.cells import between, draw_scatter, student
from tests.worlds.planted.circles import Outcome, Size, Truth
from tests.worlds.planted.targets import AGAIN, rp

POSES = 60


@dataclass(frozen=True)
class Visits:
    """Scatter of the visits of a pose: smallest and largest standard deviation of a coordinate and of a rotation
    among the poses, degrees of freedom of the t distribution, and noise of the tracker in mm and rad.
    """

    scatter_mm: tuple[float, float] = (0.020, 0.020)
    scatter_rad: float = 4e-5
    freedom: float = np.inf
    tracker_mm: float = TRACKER_U_MM
    tracker_rad: float = 2e-5


SINGLE: dict[str, Visits] = {
    "alike": Visits(),
    "unlike": Visits(scatter_mm=(0.005, 0.060)),
    "heavy tails": Visits(freedom=4.0),
    "tracker alone": Visits(scatter_mm=(1e-4, 1e-4), scatter_rad=1e-7),
}


def draw_visits(rng: np.random.Generator, kind: str) -> Visits:
    """Draw the scatter, of a single kind or according to the table: rotations of up to 87 µrad, tails from t(4)."""
    if kind != "table":
        return SINGLE[kind]
    return Visits(
        draw_scatter(rng), between(rng, 5e-6, 87e-6), between(rng, 4.0, 30.0), TRACKER_U_MM * rng.uniform(0.5, 1.0)
    )


@dataclass(frozen=True)
class Cell:
    """A cell: q (p, 6) rad; T (p, 4, 4): true tool poses in the tracker frame; flange (p, 4, 4) of the nominal arm;
    sigma_mm (p,) of each pose.
    """

    q: np.ndarray
    T: np.ndarray
    flange: np.ndarray
    sigma_mm: np.ndarray


def draw_cell(rng: np.random.Generator, visits: Visits) -> Cell:
    """A UR10 with joint errors of some hundredths of a degree and length errors of some tenths of a mm."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import

    arm = dataclasses.replace(arm_of(load("ur10-cell")[0].robot), T_world_base=np.eye(4), T_flange_tool=np.eye(4))
    q = rng.uniform(-2, 2, (POSES, 6))
    wrong = dataclasses.replace(
        arm,
        offset=arm.offset + np.radians(between(rng, 0.005, 0.1)) * rng.normal(size=6),
        a=arm.a + rng.normal(0, 0.2, 6),
    )
    base, tool = np.eye(4), np.eye(4)
    base[:3, :3], base[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.normal(0, 2000, 3)
    tool[:3, :3], tool[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.normal(0, 100, 3)
    sigma = np.exp(rng.uniform(*np.log(visits.scatter_mm), POSES))
    return Cell(q, base @ forward(wrong, q) @ tool, forward(arm, q), sigma)


def _rotations(rng: np.random.Generator, visits: Visits, shape: tuple[int, ...]) -> np.ndarray:
    return visits.scatter_rad * student(rng, visits.freedom, shape) + rng.normal(0, visits.tracker_rad, shape)


def _places(rng: np.random.Generator, visits: Visits, sigma_mm: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return scatter (..., p, 3) mm; sigma_mm (p,): of the stops of each pose."""
    return sigma_mm[:, None] * student(rng, visits.freedom, shape) + rng.normal(0, visits.tracker_mm, shape)


# --- truth


def true_errors(cell: Cell) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors (p, 3) mm and (p, 3) rad in the base after base and tool are fitted to noise-free poses, and
    an orthonormal basis (3 p, 9) of the fitted position components.
    """
    from scipy.optimize import least_squares  # noqa: PLC0415 - slow to import
    from scipy.spatial.transform import Rotation  # noqa: PLC0415

    place, rotation = cell.flange[:, :3, 3], cell.flange[:, :3, :3]
    seen = cell.T[:, :3, 3]
    turn, _ = Rotation.align_vectors(seen - seen.mean(axis=0), place - place.mean(axis=0))
    base = turn.as_matrix()

    def left(x: np.ndarray) -> np.ndarray:
        """Residual in the base. x: rotation x[:3] / 1000 mm, base position x[3:6], tool position x[6:]."""
        back = Rotation.from_rotvec(x[:3] / 1000).as_matrix() @ base.T
        return np.asarray(((seen - seen.mean(axis=0)) @ back.T - x[3:6] - place - rotation @ x[6:]).ravel())

    fit = least_squares(left, np.append(np.zeros(3), [*place.mean(axis=0), 0, 0, 0]), x_scale="jac", xtol=1e-14)
    back = Rotation.from_rotvec(fit.x[:3] / 1000) * Rotation.from_matrix(base.T)
    measured = back * Rotation.from_matrix(cell.T[:, :3, :3])
    flange = Rotation.from_matrix(rotation)
    turned = measured * (flange * (flange.inv() * measured).mean()).inv()
    return fit.fun.reshape(-1, 3), turned.as_rotvec(), np.linalg.qr(fit.jac)[0]


def true_figures(rng: np.random.Generator, cell: Cell, visits: Visits, count: int) -> Truth:
    """Expected value of every figure for poses visited `count` times. The standards do not correct
    figures for noise.
    """
    place, turned, basis = true_errors(cell)
    basis = basis.reshape(POSES, 3, -1)
    noise = _places(rng, visits, cell.sigma_mm, (AGAIN, count, POSES, 3))
    taken = np.einsum("mpi,pik->mk", noise.mean(axis=1), basis)  # by the fit, in which all visits have equal weight
    place = place + noise - np.einsum("mk,pik->mpi", taken, basis)[:, None]
    noise = _rotations(rng, visits, (AGAIN, count, POSES, 3))
    turned = np.degrees(turned + noise - noise.mean(axis=(1, 2), keepdims=True))
    length, angle = np.linalg.norm(place, axis=-1), np.linalg.norm(turned, axis=-1)
    every = {
        "rms_mm": np.sqrt((length**2).mean(axis=(1, 2))),
        "mean_mm": length.mean(axis=(1, 2)),
        "max_mm": length.max(axis=(1, 2)),
        "rms_deg": np.sqrt((angle**2).mean(axis=(1, 2))),
        "max_deg": angle.max(axis=(1, 2)),
    }
    if count >= 2:
        away = np.linalg.norm(place.mean(axis=1), axis=-1)
        every |= {"repeat_mm": np.sqrt(place.var(axis=1, ddof=1).mean(axis=(1, 2)))}
        every |= {"ap_mm": away.max(axis=1), "ap_mean_mm": away.mean(axis=1)}
        mean = np.abs(turned.mean(axis=1)).max(axis=1)
        every |= {f"ap_{axis}_deg": mean[:, k] for k, axis in enumerate("abc")}
    if count >= 3:
        each, s = rp(place.swapaxes(1, 2)), turned.std(axis=1, ddof=1).max(axis=1)
        every |= {"rp_mm": each.max(axis=1), "rp_mean_mm": each.mean(axis=1)}
        every |= {f"rp_{axis}_deg": 3 * s[:, k] for k, axis in enumerate("abc")}
    return {name: float(values.mean()) for name, values in every.items()}


# --- case


def pose_case(rng: np.random.Generator, kind: str, size: Size) -> Outcome:
    """Return figures of poses visited once, and again for each additional lap."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import

    visits = draw_visits(rng, kind)
    cell = draw_cell(rng, visits)
    shape = (size.laps, POSES, 3)
    xyz = cell.T[:, :3, 3] + _places(rng, visits, cell.sigma_mm, shape)
    turns = Rotation.from_rotvec(_rotations(rng, visits, shape).reshape(-1, 3))
    seen = turns * Rotation.from_matrix(np.tile(cell.T[:, :3, :3], (size.laps, 1, 1)))
    table = PoseTable(np.tile(cell.q, (size.laps, 1)), xyz.reshape(-1, 3), seen.as_euler("xyz"))
    figures = evaluate(table, load("ur10-cell")[0], 0.0, "planted").figures
    truth = true_figures(rng, cell, visits, size.laps)
    return {f"pose, {size.laps} visit{'s' * (size.laps > 1)}": (dict(figures), truth)}
