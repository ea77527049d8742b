"""Causes of error outside rig's library, modelled from the physics of parts; each is a function of an arm and its path.

A cause draws its parameters once and keeps them for all runs of a cell: torsion, bearings, cables. Causes with a memory
(friction, a slipped tool) continue from run to run in time. `scale` multiplies the complete cause; 0 removes it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from tests.worlds.unknown.arms import Arm, Array, Deviation, forward, gravity_torque, no_deviation
from tests.worlds.unknown.motion import Motion

ARCMIN = np.radians(1 / 60)


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A cause of error. axis: counted from 1, or 0 for no single axis."""

    kind: ClassVar[str]
    tests: ClassVar[tuple[str, ...]]
    related: ClassVar[tuple[str, ...]] = ()
    """Words in effect names that a metrologist would accept as an answer for this cause on the same axis."""
    axis: int = 0
    scale: float = 1.0

    @classmethod
    def draw(cls, rng: np.random.Generator, arm: Arm) -> Cause:
        raise NotImplementedError

    def deviation(self, arm: Arm, motion: Motion) -> Deviation:
        found = no_deviation(len(motion.t), arm.axes)
        self.deviate(found, arm, motion)
        return found

    def deviate(self, found: Deviation, arm: Arm, motion: Motion) -> None:
        """Write the deviations of this cause into those of a perfect arm."""
        raise NotImplementedError

    def describe(self) -> str:
        """A description with the main size."""
        raise NotImplementedError

    def resized(self, factor: float) -> Cause:
        """Same cause, larger or smaller."""
        return replace(self, scale=self.scale * factor)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def loaded_axis(rng: np.random.Generator, arm: Arm) -> int:
    """A random joint that carries gravity: shoulder or elbow."""
    return int(rng.choice([2, 3] if arm.axes == 6 else [2, 4]))


# --- gears


@dataclass(frozen=True, kw_only=True)
class CubicTorsion(Cause):
    """A strain-wave gear with increasing stiffness: torque = k1 phi + k3 phi^3 (Tuttle and Seering, IEEE Trans.
    Robotics and Automation 12 (1996) 368).

    k1 is that of catalogue sizes 20 to 32 with their housings, 10 to 40 kNm/rad (Harmonic Drive CSF: K1 16 to 67). The
    cubic term carries half of the torque at `half_nm`, near T1 to T2 of the catalogue (7 to 108 Nm).
    """

    kind = "cubic torsion"
    tests = ("pose",)
    related = ("compliance", "torsion", "strain", "stiff")
    k1_nm_rad: float
    half_nm: float

    @classmethod
    def draw(cls, rng: np.random.Generator, arm: Arm) -> CubicTorsion:
        return cls(
            axis=loaded_axis(rng, arm),
            k1_nm_rad=log_uniform(rng, 10e3, 40e3),
            half_nm=log_uniform(rng, 10.0, 50.0),
        )

    def angle(self, torque: Array) -> Array:
        """Solve the cubic for the angle (n,) rad."""
        # k3 phi^3 = k1 phi = half / 2 at the torque of equal terms.
        at_half = self.half_nm / 2 / self.k1_nm_rad
        k3 = self.k1_nm_rad / at_half**2
        p, r = self.k1_nm_rad / k3, torque / k3
        root = np.sqrt(r**2 / 4 + p**3 / 27)
        return np.asarray(np.cbrt(r / 2 + root) + np.cbrt(r / 2 - root))

    def deviate(self, found: Deviation, arm: Arm, motion: Motion) -> None:
        k = self.axis - 1
        found.joint[:, k] = self.scale * self.angle(gravity_torque(arm, motion.q)[:, k])

    def describe(self) -> str:
        return f"axis {self.axis}, k1 {self.k1_nm_rad / 1e3:.0f} kNm/rad, cubic half at {self.half_nm:.0f} Nm"


@dataclass(frozen=True, kw_only=True)
class TorsionHysteresis(Cause):
    """Hysteresis of a strain-wave gear after Bouc and Wen, driven by gravity and by Coulomb friction of the output.

    Torque = stiffness x angle + friction that follows the change of torque, so the angle lags in both directions.
    Hysteresis loss in the catalogue: 1 to 2 arcmin for a sound gear (CSF, by ratio). Half of it applies to each
    direction; a worn gear has twice as much.
    """

    kind = "hysteresis of torsion"
    tests = ("pose", "touch", "circle")
    related = ("compliance", "torsion", "strain", "stiff", "hyster", "backlash")
    half_loss_rad: float
    yield_nm: float
    friction_nm: float
    stiffness_nm_rad: float

    @classmethod
    def draw(cls, rng: np.random.Generator, arm: Arm) -> TorsionHysteresis:
        loss, yields = log_uniform(rng, 0.7, 2.0) * ARCMIN, log_uniform(rng, 10.0, 40.0)
        return cls(
            axis=loaded_axis(rng, arm),
            half_loss_rad=loss,
            yield_nm=yields,
            friction_nm=rng.uniform(0.0, 8.0),
            # The stiffness is limited by the friction, so that more torque never turns the link back.
            stiffness_nm_rad=min(rng.uniform(0.5, 0.9) * yields / loss, 60e3),
        )

    def deviate(self, found: Deviation, arm: Arm, motion: Motion) -> None:
        k = self.axis - 1
        friction = -self.friction_nm * np.tanh(np.gradient(motion.q[:, k]) / 1e-4)
        torque = gravity_torque(arm, motion.q)[:, k] + friction
        found.joint[:, k] = self.scale * self.angle(torque)

    def angle(self, torque: Array) -> Array:
        """Angle (n,) rad for a sequence of torques."""
        return np.asarray(torque / self.stiffness_nm_rad - self.half_loss_rad * self._bouc_wen(torque))

    def _bouc_wen(self, torque: Array) -> Array:
        """Integrate dz = dT / T_y (1 - |z| (0.5 + 0.5 sign(z dT))) in steps of a tenth of T_y."""
        z = np.zeros(len(torque))
        for i in range(1, len(torque)):
            change, now = torque[i] - torque[i - 1], z[i - 1]
            steps = max(1, int(np.ceil(10 * abs(change) / self.yield_nm)))
            step = change / steps / self.yield_nm
            for _ in range(steps):
                now += step * (1 - abs(now) * (0.5 + 0.5 * np.sign(now * step)))
            z[i] = now
        return z

    def describe(self) -> str:
        return f"axis {self.axis}, ±{self.half_loss_rad / ARCMIN:.1f} arcmin, yields at {self.yield_nm:.0f} Nm"


# --- bearings and links


@dataclass(frozen=True, kw_only=True)
class WanderingAxis(Cause):
    """A wandering joint axis: run-out and tilt of its bearing as band-limited random functions of the angle.

    The cage of the rolling elements turns at about 0.4 of the shaft speed, so nothing repeats after a turn. Sizes:
    run-out of crossed-roller bearings of 100 to 200 mm bore, normal class 10 to 25 µm radial and axial (ISO 492). The
    tilt is the axial run-out divided by the raceway diameter; worn bearings have several times more.
    """

    kind = "wandering axis"
    tests = ("pose", "circle")
    related = ("wander", "bearing", "run_out", "runout")
    offset_mm: float
    tilt_rad: float
    waves: Array = field(repr=False)
    """(4, m, 3): order, amplitude (sum of squares 1) and phase of x, y, and tilt about x and y."""

    @classmethod
    def draw(cls, rng: np.random.Generator, arm: Arm) -> WanderingAxis:
        count = 12
        order = rng.uniform(1.5, 9.0, (4, count))
        amplitude = rng.normal(size=(4, count))
        amplitude /= np.linalg.norm(amplitude, axis=1, keepdims=True) / np.sqrt(2)
        return cls(
            axis=int(rng.integers(1, 4)),
            offset_mm=log_uniform(rng, 0.010, 0.030),
            tilt_rad=log_uniform(rng, 1.0e-4, 4.0e-4),
            waves=np.stack([order, amplitude, rng.uniform(0, 2 * np.pi, (4, count))], axis=2),
        )

    def deviate(self, found: Deviation, arm: Arm, motion: Motion) -> None:
        angle = motion.q[:, self.axis - 1]
        order, amplitude, phase = np.moveaxis(self.waves, 2, 0)
        course = (amplitude * np.cos(angle[:, None, None] * order + phase)).sum(axis=2)
        size = self.scale * np.array([self.offset_mm, self.offset_mm, self.tilt_rad, self.tilt_rad])
        found.before[:, self.axis - 1][:, [0, 1, 3, 4]] = size * course

    def describe(self) -> str:
        return f"axis {self.axis}, {1e3 * self.offset_mm:.0f} µm and {1e6 * self.tilt_rad:.0f} µrad rms"


@dataclass(frozen=True, kw_only=True)
class OneSidedWarmth(Cause):
    """A link bent by a temperature difference between its sides: curvature = expansion x difference / height of the
    section.

    Aluminium, 23.5e-6 per kelvin, section 100 to 150 mm. The difference of 2 to 8 K builds up within minutes due to the
    sun, a lamp or the motor, and drops whenever a door opens.
    """

    kind = "link bent by warmth on one side"
    tests = ("pose", "touch", "circle")
    related = ("thermal", "warm", "temperature")
    difference_k: float
    height_mm: float
    rise_s: float
    door_s: float
    direction_rad: float

    @classmethod
    def draw(cls, rng: np.random.Generator, arm: Arm) -> OneSidedWarmth:
        return cls(
            axis=loaded_axis(rng, arm),
            difference_k=log_uniform(rng, 2.0, 8.0),
            height_mm=rng.uniform(100.0, 150.0),
            rise_s=log_uniform(rng, 120.0, 900.0),
            door_s=log_uniform(rng, 150.0, 600.0),
            direction_rad=rng.uniform(0, 2 * np.pi),
        )

    def warmth(self, t: Array) -> Array:
        """Temperature difference (n,) K: it rises, and drops by half while the door is open."""
        open_share = 0.5 * (1 + np.tanh(4 * np.sin(2 * np.pi * t / self.door_s)))
        return np.asarray(self.difference_k * (1 - np.exp(-np.maximum(t, 0.0) / self.rise_s)) * (1 - 0.5 * open_share))

    def deviate(self, found: Deviation, arm: Arm, motion: Motion) -> None:
        k = self.axis - 1
        length = max(abs(arm.a[k]), abs(arm.d[k]), 350.0)
        turn = self.scale * 23.5e-6 * self.warmth(motion.t) / self.height_mm * length
        along = np.array([1.0, 0, 0]) if abs(arm.a[k]) > abs(arm.d[k]) else np.array([0, 0, 1.0])
        across = np.roll(along, 1) * np.cos(self.direction_rad) + np.roll(along, 2) * np.sin(self.direction_rad)
        found.after[:, k, 3:] = turn[:, None] * across
        found.after[:, k, :3] = turn[:, None] * length / 2 * np.cross(across, along)

    def describe(self) -> str:
        return f"link {self.axis}, {self.difference_k:.1f} K over {self.height_mm:.0f} mm, rises in {self.rise_s:.0f} s"


@dataclass(frozen=True, kw_only=True)
class CableDrag(Cause):
    """A hose package that pulls at the wrist once its slack is used up, depending on two wrist joint angles together.

    Torques of 5 to 25 Nm at the wrist (a dress pack of some kilograms on a spring of 50 to 150 N with a lever of 0.1 to
    0.2 m) act on wrist joints of 8 to 16 kNm/rad (Harmonic Drive CSF-17: K1 to K3 10 to 16) and, by the same force over
    the forearm, on the elbow.
    """

    kind = "cable drag"
    tests = ("pose", "touch")
    related = ("cable", "drag", "hose")
    pull_nm: float
    slack_rad: float
    steep_rad: float
    rest: Array
    twist: float
    wrist_nm_rad: float

    @classmethod
    def draw(cls, rng: np.random.Generator, arm: Arm) -> CableDrag:
        first = arm.axes - 3
        middle = (arm.low + arm.high) / 2
        return cls(
            axis=first + 1,
            pull_nm=log_uniform(rng, 5.0, 25.0),
            slack_rad=np.radians(rng.uniform(15.0, 40.0)),
            steep_rad=np.radians(rng.uniform(6.0, 15.0)),
            rest=middle[first:] + rng.uniform(-0.4, 0.4, 3),
            twist=rng.uniform(0.2, 0.5) * rng.choice([-1.0, 1.0]),
            wrist_nm_rad=log_uniform(rng, 8e3, 16e3),
        )

    def pull(self, q: Array) -> Array:
        """Torques (n, 2) Nm on the first two wrist joints."""
        away = q[:, self.axis - 1 :] - self.rest
        bent = np.stack([away[:, 0] + self.twist * away[:, 2], away[:, 1] - 0.5 * self.twist * away[:, 0]], axis=1)
        reach = np.sqrt((bent**2).sum(axis=1))
        tight = self.steep_rad * np.logaddexp(0.0, (reach - self.slack_rad) / self.steep_rad)
        pull = self.pull_nm * np.tanh(tight / np.radians(40.0))
        return np.asarray(-pull[:, None] * bent / np.maximum(reach, 1e-9)[:, None])

    def deviate(self, found: Deviation, arm: Arm, motion: Motion) -> None:
        k, pull = self.axis - 1, self.scale * self.pull(motion.q)
        found.joint[:, k : k + 2] = pull / self.wrist_nm_rad
        found.joint[:, k - 1] = pull[:, 1] / self.wrist_nm_rad / 2

    def describe(self) -> str:
        return f"wrist, up to {self.pull_nm:.0f} Nm beyond {np.degrees(self.slack_rad):.0f}°"


# --- tool, ball link and controller


@dataclass(frozen=True, kw_only=True)
class ToolSlip(Cause):
    """A tool that slips once on its flange by 0.1 to 0.5 mm, for example after a collision or with a loose clamp."""

    kind = "tool slips once"
    tests = ("pose", "touch", "circle")
    related = ("tool", "slip", "moved")
    at_share: float
    jump_mm: Array
    span_s: float

    @classmethod
    def draw(cls, rng: np.random.Generator, arm: Arm) -> ToolSlip:
        way = rng.normal(size=3)
        jump = log_uniform(rng, 0.10, 0.50) * way / np.linalg.norm(way)
        return cls(at_share=rng.uniform(0.3, 0.7), jump_mm=jump, span_s=1.0)

    def deviate(self, found: Deviation, arm: Arm, motion: Motion) -> None:
        found.tool[motion.t > self.at_share * self.span_s] = self.scale * self.jump_mm

    def describe(self) -> str:
        return f"{1e3 * np.linalg.norm(self.jump_mm):.0f} µm after {100 * self.at_share:.0f} % of the time"


@dataclass(frozen=True, kw_only=True)
class BallStickSlip(Cause):
    """Dry friction in the ball joint of the link: it sticks, bends the end of the link, and partly slips.

    The deflection is a sawtooth over the sliding distance of the cup on the ball (radius 15 mm). Each tooth has a
    random length (1 to 8 mm) and height (20 to 60 µm: a dry ball), and the two gauges see it differently. It reverses
    when the cup turns back.
    """

    kind = "stick-slip in the ball joint"
    tests = ("circle",)
    related = ("stick", "friction", "probe")
    ball_mm = 15.0
    height_mm: float
    tooth_mm: float
    weights: Array
    seed: int

    @classmethod
    def draw(cls, rng: np.random.Generator, arm: Arm) -> BallStickSlip:
        return cls(
            height_mm=log_uniform(rng, 0.020, 0.060),
            tooth_mm=log_uniform(rng, 1.0, 8.0),
            weights=np.array([rng.uniform(0.5, 1.0), -rng.uniform(0.2, 0.8)]),
            seed=int(rng.integers(2**31)),
        )

    def deviate(self, found: Deviation, arm: Arm, motion: Motion) -> None:
        rng = np.random.default_rng([self.seed, int(1e3 * motion.t[0])])
        R = forward(arm, motion.q).flange[:, :3, :3]
        change = np.diff(R, axis=0, prepend=R[:1])
        # |dR| is the square root of two times the angle; the turning direction of the cup is seen from above.
        turned = np.linalg.norm(change, axis=(1, 2)) / np.sqrt(2)
        way = np.sign((np.cross(R, change, axis=1).sum(axis=2))[:, 2])
        found.gauge[:] = (self.scale * self._sawtooth(self.ball_mm * turned * way, rng))[:, None] * self.weights

    def _sawtooth(self, way_mm: Array, rng: np.random.Generator) -> Array:
        """Deflection (n,) mm of the link end after each step of the cup on the ball."""
        bent, now, limit = np.zeros(len(way_mm)), 0.0, self.height_mm
        slope = self.height_mm / self.tooth_mm
        for i, step in enumerate(way_mm):
            parts = max(1, int(np.ceil(4 * abs(step) / self.tooth_mm)))
            for _ in range(parts):
                now += slope * step / parts
                if abs(now) > limit:
                    now, limit = now * rng.uniform(0.1, 0.6), self.height_mm * rng.uniform(0.5, 1.5)
            bent[i] = now
        return bent

    def describe(self) -> str:
        return f"{1e3 * self.height_mm:.0f} µm a tooth of {self.tooth_mm:.1f} mm"


@dataclass(frozen=True, kw_only=True)
class InterpolationError(Cause):
    """A controller that drives a circle as chords and with a delay, while its interface reports the ideal path.

    Chords of 3 to 8 degrees (a chord tolerance of 25 to 170 µm at 70 mm, as in programs from CAM systems) are rounded
    at the corners. Joints cut corners by tau^2 times the acceleration (a symmetric path filter, 10 to 40 ms), which
    differs from any constant time shift.
    """

    kind = "interpolation error"
    tests = ("circle",)
    related = ("servo_lag", "interpol", "follow")
    chord_rad: float
    filter_s: Array
    rounding: float

    @classmethod
    def draw(cls, rng: np.random.Generator, arm: Arm) -> InterpolationError:
        return cls(
            chord_rad=2 * np.pi / int(rng.integers(45, 121)),
            filter_s=np.exp(rng.uniform(np.log(0.010), np.log(0.040), arm.axes)),
            rounding=rng.uniform(0.1, 0.4),
        )

    def deviate(self, found: Deviation, arm: Arm, motion: Motion) -> None:
        if not motion.sense:
            return
        t, q = motion.t, motion.q
        acceleration = np.gradient(np.gradient(q, t, axis=0, edge_order=2), t, axis=0, edge_order=2)
        bend = np.gradient(np.gradient(q, motion.phi, axis=0, edge_order=2), motion.phi, axis=0, edge_order=2)
        part = (motion.phi / self.chord_rad) % 1.0
        sagitta = part * (1 - part) / 2 * (1 - self.rounding * np.cos(2 * np.pi * part))
        # A chord lies inside the arc, and a filter cuts the corner: both are proportional to the second derivative.
        found.joint[:] = self.scale * (self.filter_s**2 * acceleration + self.chord_rad**2 * sagitta[:, None] * bend)

    def describe(self) -> str:
        return f"chords of {np.degrees(self.chord_rad):.1f}°, filters of {1e3 * self.filter_s.max():.0f} ms at most"


CAUSES: tuple[type[Cause], ...] = (
    CubicTorsion,
    TorsionHysteresis,
    WanderingAxis,
    OneSidedWarmth,
    CableDrag,
    ToolSlip,
    BallStickSlip,
    InterpolationError,
)
