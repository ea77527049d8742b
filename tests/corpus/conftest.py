"""The bench is that of the daemon's tests."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / "daq")]
