from dataclasses import replace

from tests.support.soaking import RATES_HZ, Held, accelerated, wrong


def test_minutes_of_recording_in_a_second(tmp_path):
    rows = list(accelerated(tmp_path, minutes=2, times=120, every_s=0.05))
    assert len(rows) > 3 and rows[-1].samples > 0.8 * 120 * sum(RATES_HZ.values())


def test_growth_is_seen():
    rows = [Held(minute, 80 + minute % 3, 12 + minute % 2, 5, minute) for minute in range(60)]
    assert wrong(rows) == []
    assert "memory grew" in wrong([replace(row, rss_mb=80 + row.minutes / 2) for row in rows])[0]
    assert "descriptors grew" in wrong([replace(row, descriptors=12 + int(row.minutes) // 10) for row in rows])[0]
    assert "threads grew" in wrong([replace(row, threads=5 + int(row.minutes) // 10) for row in rows])[0]
