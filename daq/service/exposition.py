"""Prometheus text format for metrics (0.0.4, prometheus.io/docs/instrumenting/exposition_formats)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from rigs.text import escape_lines

Labels = Mapping[str, str]


@dataclass(frozen=True)
class Metric:
    """The name contains the unit; that of a counter ends in `_total`."""

    name: str
    kind: Literal["gauge", "counter"]
    help: str
    values: tuple[tuple[Labels, float], ...]


def render(metrics: Iterable[Metric]) -> str:
    lines = []
    for metric in metrics:
        if metric.values:
            lines += [f"# HELP {metric.name} {_escaped(metric.help)}", f"# TYPE {metric.name} {metric.kind}"]
        for labels, value in metric.values:
            quoted = {name: _escaped(text).replace('"', r"\"") for name, text in labels.items()}
            written = ",".join(f'{name}="{text}"' for name, text in quoted.items())
            lines.append(f"{metric.name}{f'{{{written}}}' if written else ''} {_number(value)}")
    return "".join(f"{line}\n" for line in lines)


def _escaped(text: str) -> str:
    return escape_lines(text).replace("\\", r"\\").replace("\n", r"\n")


def _number(value: float) -> str:
    if math.isnan(value):
        return "NaN"
    if math.isinf(value):
        return "+Inf" if value > 0 else "-Inf"
    return repr(value) if isinstance(value, float) and not value.is_integer() else str(int(value))
