"""Effects: why link side = reported + effect. Names, parameters and signs of the shared vocabulary.

Each class is one effect and is served by the file of the same name in `analysis/effects/`. A parameter's unit is
in its name; its bounds, and the size that a healthy arm shows anyway, are its field's. Sizes scale an effect and
are zero for none; shapes say how it looks and need a size to be seen.
"""

from __future__ import annotations

import datetime as dt
import math
from typing import Annotated, Any, Literal, get_args

from pydantic import Field

from rigs.base import Axis, Part

Gauge = Literal["g1", "g2"]


def _size(bound: float, healthy: float, *, least: float | None = None) -> Any:
    """A size: between -bound (or least) and bound, zero is none; `healthy` is its spread over good arms."""
    return Field(default=0.0, ge=-bound if least is None else least, le=bound, json_schema_extra={"healthy": healthy})


def _shape(low: float, high: float, default: float) -> Any:
    return Field(default=default, ge=low, le=high)


class Found(Part):
    """Where an effect of a rig file came from: when, from which runs, how sure, and the gap that it closed."""

    date: dt.date
    runs: tuple[str, ...]
    sd: dict[str, float] = Field(default_factory=dict)
    """Standard uncertainty of each fitted parameter, in its own unit."""
    gap_um: tuple[float, float] | None = None
    """Root mean square of what was unexplained, before and after, in µm of the readings."""
    correlation: dict[str, float] = Field(default_factory=dict)
    """Of the size with those of other effects that came from the same fit, by their names."""
    together: tuple[str, ...] = ()
    """Effects of the same fit that look like this one: only what they make up together is known."""
    joints_deg: tuple[tuple[float, float], ...] | None = Field(default=None, min_length=6, max_length=6)
    """The lowest and the highest angle of each joint in those runs."""


class _Effect(Part):
    found: Found | None = None


class JointOffset(_Effect):
    """The datum location error: link = reported + offset."""

    effect: Literal["joint_offset"] = "joint_offset"
    axis: Axis
    offset_deg: float = _size(5, 0.02)


class LinkGeometry(_Effect):
    """A wrong link constant: `field` of `axis` is `delta` (mm or degrees) more than the rig file says."""

    effect: Literal["link_geometry"] = "link_geometry"
    axis: Axis
    field: Literal["a", "alpha", "d", "beta"]
    delta: float = Field(default=0.0, ge=-50, le=50)

    @property
    def healthy(self) -> float:
        """0.2 mm for lengths, 0.02° for angles."""
        return 0.2 if self.field in ("a", "d") else 0.02


class Backlash(_Effect):
    """A play of `width_deg`: the link lags, -w/2 while q rises, +w/2 while it falls, and crosses it at a reversal.

    transit: how gradual the crossing is, 0 sharp, 1 spread over twice the play; preload: share of the play in which
    gravity holds the flank.
    """

    effect: Literal["backlash"] = "backlash"
    axis: Axis
    width_deg: float = _size(2, 0.01, least=0.0)
    transit: float = _shape(0, 1, 0.0)
    preload: float = _shape(0, 1, 0.0)


class TransmissionError(_Effect):
    """Gear error `amplitude sin(order q + phase)`, `order` in cycles a turn; `third` of it at three times the order."""

    effect: Literal["transmission_error"] = "transmission_error"
    axis: Axis
    order: float = Field(gt=0, le=1000)
    amplitude_deg: float = _size(2, 0.005, least=0.0)
    phase_deg: float = _shape(-360, 360, 0.0)
    third: float = _shape(-1, 1, 0.0)


class Compliance(_Effect):
    """Twist of a joint under gravity: torque times `deg_per_Nm`; `payload_kg` hangs at the flange beside the links."""

    effect: Literal["compliance"] = "compliance"
    axis: Axis
    deg_per_Nm: float = _size(0.05, 5e-5, least=0.0)
    payload_kg: float = _shape(0, 500, 0.0)

    @property
    def healthy(self) -> float:
        """5e-5 °/Nm on axes 1 to 3, 3e-4 on the wrist."""
        return 5e-5 if self.axis <= 3 else 3e-4


class LinkBending(_Effect):
    """The link after `axis` bends under gravity: its end moves by `mm_per_Nm` times the torque, the joint does not."""

    effect: Literal["link_bending"] = "link_bending"
    axis: Axis
    mm_per_Nm: float = _size(0.05, 1e-4, least=0.0)


class ReversalSpike(_Effect):
    """Wind-up at each reversal, `amplitude_deg` against the new direction, that relaxes within `decay_s`; `slow` of it
    takes four times as long, and it needs `rise` of that time to wind up."""

    effect: Literal["reversal_spike"] = "reversal_spike"
    axis: Axis
    amplitude_deg: float = _size(1, 0.005)
    decay_s: float = _shape(0.02, 10, 0.3)
    slow: float = _shape(0, 1, 0.0)
    rise: float = _shape(0, 1, 0.0)


class WristCoupling(_Effect):
    """Motion of one wrist axis leaks into another: link[to] gains `ratio` times q[from]."""

    effect: Literal["wrist_coupling"] = "wrist_coupling"
    from_axis: Axis
    to_axis: Axis
    ratio: float = _size(0.1, 1e-4)


class ServoLag(_Effect):
    """The link follows the feedback late, where the feedback is the command and not the encoder."""

    effect: Literal["servo_lag"] = "servo_lag"
    axis: Axis
    lag_s: float = _size(0.2, 5e-4)


class ThermalGrowth(_Effect):
    """Every length grows with run time: by `ppm` in the end, with a time constant."""

    effect: Literal["thermal_growth"] = "thermal_growth"
    ppm: float = _size(2000, 20)
    time_constant_s: float = _shape(1, 1e5, 600.0)


class BallForm(_Effect):
    """The ball is not round: `lobes` around it."""

    effect: Literal["ball_form"] = "ball_form"
    lobes: int = Field(ge=2, le=30)
    amplitude_mm: float = _size(0.1, 0.001, least=0.0)
    phase_deg: float = _shape(-360, 360, 0.0)


class GaugeScale(_Effect):
    """A gauge reads too much by this share."""

    effect: Literal["gauge_scale"] = "gauge_scale"
    gauge: Gauge
    relative: float = _size(0.2, 5e-4)


class GaugeBaseline(_Effect):
    """The gauges stand further apart than the rig file says."""

    effect: Literal["gauge_baseline"] = "gauge_baseline"
    delta_mm: float = _size(10, 0.05)


class GaugeInclination(_Effect):
    """A gauge stands askew by this angle and reads 1/cos too much."""

    effect: Literal["gauge_inclination"] = "gauge_inclination"
    gauge: Gauge
    angle_deg: float = _size(30, 0.5, least=0.0)


class GaugeDeadBand(_Effect):
    """A plunger sticks: it follows only after this much."""

    effect: Literal["gauge_dead_band"] = "gauge_dead_band"
    gauge: Gauge
    width_mm: float = _size(0.5, 5e-4, least=0.0)


class GaugeDrift(_Effect):
    """A gauge drifts with time."""

    effect: Literal["gauge_drift"] = "gauge_drift"
    gauge: Gauge
    mm_per_min: float = _size(1, 2e-4)


class GaugeCyclic(_Effect):
    """Interpolation error of a gauge's scale: `amplitude_mm` once each `period_mm`."""

    effect: Literal["gauge_cyclic"] = "gauge_cyclic"
    gauge: Gauge
    period_mm: float = Field(gt=0, le=10)
    amplitude_mm: float = _size(0.1, 2e-4, least=0.0)
    phase_deg: float = _shape(-360, 360, 0.0)


class TimeLag(_Effect):
    """The gauges' stamps are late against the feedback's."""

    effect: Literal["time_lag"] = "time_lag"
    lag_s: float = _size(1, 1e-3)


class ClockRate(_Effect):
    """The gauges' clock runs fast against the feedback's."""

    effect: Literal["clock_rate"] = "clock_rate"
    ppm: float = _size(10000, 20)


class Vibration(_Effect):
    """The link swings."""

    effect: Literal["vibration"] = "vibration"
    frequency_hz: float = Field(gt=0, le=500)
    amplitude_mm: float = _size(1, 0.002, least=0.0)
    phase_deg: float = _shape(-360, 360, 0.0)


Effect = Annotated[
    JointOffset
    | LinkGeometry
    | Backlash
    | TransmissionError
    | Compliance
    | LinkBending
    | ReversalSpike
    | WristCoupling
    | ServoLag
    | ThermalGrowth
    | BallForm
    | GaugeScale
    | GaugeBaseline
    | GaugeInclination
    | GaugeDeadBand
    | GaugeDrift
    | GaugeCyclic
    | TimeLag
    | ClockRate
    | Vibration,
    Field(discriminator="effect"),
]

VOCABULARY: dict[str, type[Part]] = {
    str(get_args(model.model_fields["effect"].annotation)[0]): model for model in get_args(get_args(Effect)[0])
}
"""Every effect by name."""


def size_field(effect: Any) -> str:
    """Name of the parameter that scales an effect and is zero for none."""
    if isinstance(effect, LinkGeometry):
        return "delta"
    for name, field in type(effect).model_fields.items():
        if isinstance(field.json_schema_extra, dict) and "healthy" in field.json_schema_extra:
            return str(name)
    raise TypeError(f"{effect!r} is no effect")


def bounds(effect: Any, field: str) -> tuple[float, float]:
    """Lowest and highest value of a parameter, infinite where it has no bound."""
    metadata = type(effect).model_fields[field].metadata
    low = [float(getattr(m, name)) for m in metadata for name in ("ge", "gt") if hasattr(m, name)]
    high = [float(m.le) for m in metadata if hasattr(m, "le")]
    return max(low, default=-math.inf), min(high, default=math.inf)


def one_sided(effect: Any) -> bool:
    """Whether a size cannot be negative: a width, a softness, an amplitude."""
    return bounds(effect, size_field(effect))[0] == 0


def healthy_size(effect: Any) -> float:
    """What a healthy arm shows of it anyway, in the unit of its size."""
    own = getattr(effect, "healthy", None)
    if own is not None:
        return float(own)
    extra = type(effect).model_fields[size_field(effect)].json_schema_extra
    return float(extra["healthy"])
