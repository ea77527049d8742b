"""What is not known, for scripts: JSON has no NaN, and strict readers refuse an answer that holds one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


def for_json(value: Any) -> Any:
    """The same in plain types, null for NaN or infinity."""
    match value:
        case Mapping():
            return {str(key): for_json(one) for key, one in value.items()}
        case list() | tuple():
            return [for_json(one) for one in value]
        case bool() | int() | str() | None:
            return value
    number = float(value)
    return number if math.isfinite(number) else None
