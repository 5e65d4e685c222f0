"""The allocator's options from the parameter file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def options_from_parameters(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keyword options of `make_allocator` for the method that the parameters name."""
    prefix = f'allocation.{parameters["allocation.method"]}.'
    return {
        name.removeprefix(prefix): value
        for name, value in parameters.items()
        if name.startswith(prefix)
    }
