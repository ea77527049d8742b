"""The fuzz tests use what the tests of protocols, store and tables share."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / folder) for folder in ("daq/protocol", "daq/store", "tables")]
