"""The figures of the newest runs and their limits for Prometheus, beside what the daemon counts."""

from __future__ import annotations

from collections.abc import Iterable

from analysis.window.shelf import Shown
from daq.service.exposition import Labels, Metric, render
from rigs.schema.limits import Standing

_STANDINGS: tuple[Standing, ...] = ("pass", "watch", "fail")


def metrics_of(runs: Iterable[Shown], *, daemon_is_up: bool) -> str:
    """Return whether the daemon answers, and the leading figures and those with a limit of the newest run of each rig,
    test and direction.

    runs: the newest first.
    """
    newest: dict[tuple[str, ...], Shown] = {}
    for run in runs:
        if run.figures and run.record is not None:
            newest.setdefault((run.record.rig, run.record.test, run.record.direction), run)
    shown = []
    for run in newest.values():
        for figure in run.figures:
            if figure.limit or figure in run.leading:
                record = run.record
                assert record is not None  # noqa: S101 - of runs with figures
                labels = {"rig": record.rig, "test": record.test, "direction": record.direction, "figure": figure.name}
                shown.append((labels, figure))
    values = tuple((labels, figure.value.value) for labels, figure in shown)
    u = tuple((labels, figure.value.u) for labels, figure in shown)
    limits = tuple(
        ({**labels, "bound": name}, bound)
        for labels, figure in shown
        if figure.limit
        for name, bound in (("watch", figure.limit.watch), ("fail", figure.limit.fail))
        if bound is not None
    )
    standings = tuple(
        ({**labels, "standing": name}, float(figure.standing == name))
        for labels, figure in shown
        if figure.standing
        for name in _STANDINGS
    )
    metrics: tuple[tuple[str, str, tuple[tuple[Labels, float], ...]], ...] = (
        ("rig_up", "1 where rigd answers, 0 where it does not.", (({}, float(daemon_is_up)),)),
        ("rig_figure", "Figure of the newest run of each test, in the unit of its name.", values),
        ("rig_figure_uncertainty", "Its standard uncertainty.", u),
        ("rig_figure_limit", "Limits of the rig file: from watch on, and beyond fail.", limits),
        ("rig_figure_standing", "1 for how the figure stands against its limits.", standings),
    )
    return render([Metric(name, "gauge", help_text, samples) for name, help_text, samples in metrics])
