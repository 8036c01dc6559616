"""Values of Python as a case file may hold them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ._errors import OptionError


def plain_value(value: Any, where: str) -> Any:
    """``value`` without arrays, tuples and None, as a case file may hold it."""
    if isinstance(value, Mapping):
        return {str(key): plain_value(item, f"{where}.{key}") for key, item in value.items() if item is not None}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain_value(item, where) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        raise OptionError(f"{where} is {value}; give a finite number")
    if hasattr(value, "__fspath__"):
        return value.__fspath__()
    if not isinstance(value, (bool, int, float, str)):
        raise OptionError(f"{where} is a {type(value).__name__}; give a number, a word, or a list of them")
    return value
