"""Conversion of the status of a daemon to Prometheus metrics.

All kinds of faults are present initially, because a rate requires an initial value.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from daq.acquisition.host_clock import HOST
from daq.protocol.conversation import FaultKind
from daq.service.exposition import Labels, Metric, render

Status = Mapping[str, Any]
_RETENTION = {
    "runs": ("rig_runs", "gauge", "Runs of this rig on the disk."),
    "bytes": ("rig_runs_bytes", "gauge", "Bytes of these runs."),
    "over_bytes": ("rig_retention_over_bytes", "gauge", "Bytes above the limit that cannot be deleted."),
    "deleted": ("rig_retention_deleted_runs_total", "counter", "Runs deleted since the daemon started."),
    "deleted_bytes": ("rig_retention_deleted_bytes_total", "counter", "Bytes of the deleted runs."),
}
_AUTOMATIC = {"started": "Runs started by the robot.", "refused": "Runs requested by the robot that did not start."}
_CLOCKS = {
    "offset_s": (
        "rig_clock_offset_seconds",
        "Host's monotonic clock minus the instrument's clock, from the earliest messages.",
    ),
    "drift_ppm": ("rig_clock_drift_ppm", "Drift of the host's clock relative to the instrument's clock, in ppm."),
    "late_s": (
        "rig_clock_late_seconds",
        "Delay of the latest message of ten seconds relative to the earliest, by both clocks.",
    ),
}


def metrics_text(status: Status) -> str:
    rig = {"rig": status["rig"]}
    return render(
        Metric(
            metric.name, metric.kind, metric.help, tuple(({**rig, **labels}, value) for labels, value in metric.values)
        )
        for metric in _all(status)
    )


def _all(status: Status) -> Iterator[Metric]:
    yield from _streams(status["streams"], status[HOST])
    for key, (name, words) in _CLOCKS.items():
        values = (({"stream": s}, clock[key]) for s, clock in status["clocks"].items() if clock[key] is not None)
        yield Metric(name, "gauge", words, tuple(values))
    yield _single("rig_recording", "1 while a run is being recorded.", float(status["recording"] is not None))
    if status["recording"] is not None:
        about = {"name": status["recording"], "test": status["test"], "direction": status["direction"] or ""}
        run = {**about, "run": status["run"]}
        yield Metric("rig_recording_info", "gauge", "The run that is being recorded.", ((run, 1.0),))
        yield _single("rig_recording_seconds", "Duration of the current recording.", status["seconds"])
    if (automatic := status["automatic"]) is not None:
        is_recorded = float(bool(automatic["recording"]))
        yield _single("rig_automatic_recording", "1 while an automatic run is being recorded.", is_recorded)
        for key, words in _AUTOMATIC.items():
            yield Metric(f"rig_automatic_{key}_total", "counter", words, (({}, automatic[key]),))
    disk = status["disk"]
    yield _single(
        "rig_disk_free_bytes", "Free space for this user on the disk of the runs.", disk and disk["free_bytes"]
    )
    yield _single("rig_disk_size_bytes", "Size of the disk of the runs.", disk and disk["size_bytes"])
    for key, (name, kind, words) in _RETENTION.items() if status["retention"] else ():
        yield Metric(name, "counter" if kind == "counter" else "gauge", words, (({}, status["retention"][key]),))


def _streams(streams: Mapping[str, Any], host: Mapping[str, int]) -> Iterator[Metric]:
    def each(key: str) -> tuple[tuple[Labels, float], ...]:
        return tuple(({"stream": name}, float(stream[key])) for name, stream in streams.items())

    yield Metric("rig_connected", "gauge", "1 while the connection is open.", each("connected"))
    yield Metric("rig_rate_hertz", "gauge", "Samples per second, in the last seconds.", each("rate_hz"))
    yield Metric("rig_queue_items", "gauge", "Samples and faults waiting for the writer.", each("waiting"))
    samples = tuple(({"stream": name}, s["counters"].get("samples", 0)) for name, s in streams.items())
    yield Metric("rig_samples_total", "counter", "Samples since the daemon started.", samples)
    faults = tuple(
        ({"stream": name, "kind": str(kind)}, stream["counters"].get(kind, 0))
        for name, stream in streams.items()
        for kind in FaultKind
        if kind is not FaultKind.CLOCK
    )
    of_host = (FaultKind.CLOCK, FaultKind.STALLED)
    faults += tuple(({"stream": HOST, "kind": str(kind)}, host.get(kind, 0)) for kind in of_host)
    yield Metric("rig_faults_total", "counter", "Faults since the daemon started, including `dropped` samples.", faults)
    ages = tuple(
        ({"stream": name, "column": column}, age_s)
        for name, stream in streams.items()
        for column, age_s in stream["age_s"].items()
    )
    yield Metric("rig_reading_age_seconds", "gauge", "Age of the last good value; absent before the first value.", ages)


def _single(name: str, words: str, value: float | None) -> Metric:
    return Metric(name, "gauge", words, () if value is None else (({}, value),))
