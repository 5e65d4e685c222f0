"""The parameters of a node in another process, for tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from rclpy.node import Node

from ca_ros.process.parameters import Call, ParameterClient

Answer = TypeVar('Answer')


class Parameters:
    """The parameters of the node `name`, for the node `client`; `Graph.connect` returns them."""

    def __init__(self, client: Node, name: str, spin_until: Callable[..., None]) -> None:
        self._spin_until, self._client = spin_until, ParameterClient(client, name)

    def get(self, *names: str) -> list[Any]:
        """Return the values of parameters."""
        return self._wait(self._client.get(names))

    def set(self, values: Mapping[str, Any]) -> Any:
        """Set parameters one by one; return the result of each, a SetParametersResult."""
        return self._wait(self._client.set(values))

    def set_atomically(self, values: Mapping[str, Any]) -> Any:
        """Set all parameters or none; return the result, a SetParametersResult."""
        return self._wait(self._client.set_atomically(values))

    def _wait(self, call: Call[Answer]) -> Answer:
        self._spin_until(lambda: call.answer() is not None, f'{call.service}: answered')
        answer = call.answer()
        assert answer is not None
        return answer
