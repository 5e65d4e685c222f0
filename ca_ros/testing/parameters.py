"""The parameters of a node in another process, through its services."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python


class Parameters:
    """The parameters of the node `name`, for the node `client`; `Graph.connect` returns them."""

    def __init__(self, client: Node, name: str, spin_until: Callable[..., None]) -> None:
        self._spin_until = spin_until
        services = {
            GetParameters: 'get_parameters',
            SetParameters: 'set_parameters',
            SetParametersAtomically: 'set_parameters_atomically',
        }
        self._clients = {
            kind: client.create_client(kind, f'{name}/{service}')
            for kind, service in services.items()
        }

    def get(self, *names: str) -> list[Any]:
        """Return the values of parameters."""
        answer = self._call(GetParameters, names=names)
        return [parameter_value_to_python(value) for value in answer.values]

    def set(self, values: Mapping[str, Any]) -> Any:
        """Set parameters one by one; return the result of each, a SetParametersResult."""
        return self._call(SetParameters, parameters=_messages(values)).results

    def set_atomically(self, values: Mapping[str, Any]) -> Any:
        """Set all parameters or none; return the result, a SetParametersResult."""
        return self._call(SetParametersAtomically, parameters=_messages(values)).result

    def _call(self, kind: Any, **fields: Any) -> Any:
        client = self._clients[kind]
        futures: list[Any] = []
        self._spin_until(client.service_is_ready, f'{client.srv_name}: ready')
        # The answer is lost if the node has not yet discovered the client that waits for it.
        self._spin_until(
            lambda: any(future.done() for future in futures),
            f'{client.srv_name}: answered',
            repeat=lambda: futures.append(client.call_async(kind.Request(**fields))),
        )
        return next(future.result() for future in futures if future.done())


def _messages(values: Mapping[str, Any]) -> list[Any]:
    return [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
