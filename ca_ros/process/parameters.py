"""The parameters of a node in another process, through its services."""

from collections.abc import Callable, Iterable, Mapping
from time import monotonic
from typing import Any, Generic, TypeVar

from rcl_interfaces.srv import (
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python

FIRST_PAUSE, LAST_PAUSE = 0.5, 2.0  # pauses between the repetitions of a call [s]

SERVICES = {
    ListParameters: 'list_parameters', GetParameters: 'get_parameters',
    SetParameters: 'set_parameters', SetParametersAtomically: 'set_parameters_atomically',
}

Answer = TypeVar('Answer')


class Call(Generic[Answer]):
    """A call of a service, which is repeated until it is answered; `read` makes the answer.

    DDS loses an answer if the node has not yet discovered the client that waits for it.
    """

    def __init__(self, client: Client, request: Any, read: Callable[[Any], Answer]) -> None:
        self.service: str = client.srv_name
        self._client, self._request, self._read = client, request, read
        self._futures: list[Any] = []
        self._again, self._pause = monotonic(), FIRST_PAUSE

    def ready(self) -> bool:
        """Return whether the service is there."""
        return self._client.service_is_ready()

    def answer(self) -> Answer | None:
        """Return the answer, None before there is one; each call may repeat the request."""
        for future in self._futures:
            if future.done():
                return self._read(future.result())
        if monotonic() >= self._again and self.ready():
            self._futures.append(self._client.call_async(self._request))
            self._again = monotonic() + self._pause
            self._pause = min(2.0 * self._pause, LAST_PAUSE)
        return None


class ParameterClient:
    """Gets and sets the parameters of the node `name`, for the node `node`.

    A client is created for each of `services` at once, for others with the first call.
    """

    def __init__(self, node: Node, name: str, *services: Any) -> None:
        self._node, self._name = node, name
        self._clients: dict[str, Client] = {}
        for kind in services:
            self._client(kind)

    def names(self) -> Call[list[str]]:
        """Ask for the names of all parameters."""
        return self._call(ListParameters, lambda answer: answer.result.names)

    def get(self, names: Iterable[str]) -> Call[list[Any]]:
        """Ask for the values of parameters."""

        def read(answer: Any) -> list[Any]:
            return [*map(parameter_value_to_python, answer.values)]

        return self._call(GetParameters, read, names=list(names))

    def set(self, values: Mapping[str, Any]) -> Call[list[Any]]:
        """Set parameters one by one; the answer has a SetParametersResult of each."""
        messages = _messages(values)
        return self._call(SetParameters, lambda answer: answer.results, parameters=messages)

    def set_atomically(self, values: Mapping[str, Any]) -> Call[Any]:
        """Set all parameters or none; the answer is a SetParametersResult."""
        kind, messages = SetParametersAtomically, _messages(values)
        return self._call(kind, lambda answer: answer.result, parameters=messages)

    def _call(self, kind: Any, read: Callable[[Any], Any], **fields: Any) -> Call[Any]:
        return Call(self._client(kind), kind.Request(**fields), read)

    def _client(self, kind: Any) -> Client:
        service = SERVICES[kind]
        if service not in self._clients:
            self._clients[service] = self._node.create_client(kind, f'{self._name}/{service}')
        return self._clients[service]


def _messages(values: Mapping[str, Any]) -> list[Any]:
    return [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
