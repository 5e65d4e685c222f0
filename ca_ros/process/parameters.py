"""The parameters of a node in another process, through its services."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from time import monotonic
from typing import Any, Generic, TypeVar

from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future

FIRST_PAUSE, LAST_PAUSE = 0.5, 2.0  # pauses between the repetitions of a call [s]

Answer = TypeVar('Answer')


class Call(Generic[Answer]):
    """A call of a service, which is repeated until it is answered; `read` makes the answer.

    DDS loses an answer if the node has not yet discovered the client that waits for it.
    """

    def __init__(
        self, ready: Callable[[], bool], request: Callable[[], Future],
        read: Callable[[Any], Answer],
    ) -> None:
        self.ready, self._request, self._read = ready, request, read
        self._futures: list[Future] = []
        self._again, self._pause = monotonic(), FIRST_PAUSE

    def answer(self) -> Answer | None:
        """Return the answer, None before there is one; each call may repeat the request."""
        for future in self._futures:
            if future.done():
                return self._read(future.result())
        if monotonic() >= self._again and self.ready():
            self._futures.append(self._request())
            self._again = monotonic() + self._pause
            self._pause = min(2.0 * self._pause, LAST_PAUSE)
        return None


class ParameterClient(AsyncParameterClient):
    """Gets and sets the parameters of a node, with calls that are repeated."""

    def names(self) -> Call[list[str]]:
        """Ask for the names of all parameters."""
        return self._call(self.list_parameters, lambda answer: answer.result.names)

    def get(self, names: Iterable[str]) -> Call[list[Any]]:
        """Ask for the values of parameters."""
        request = partial(self.get_parameters, [*names])
        return self._call(request, lambda found: [*map(parameter_value_to_python, found.values)])

    def set(self, values: Mapping[str, Any]) -> Call[list[Any]]:
        """Set parameters one by one; the answer has a SetParametersResult of each."""
        request = partial(self.set_parameters, _parameters(values))
        return self._call(request, lambda answer: answer.results)

    def set_atomically(self, values: Mapping[str, Any]) -> Call[Any]:
        """Set all parameters or none; the answer is a SetParametersResult."""
        request = partial(self.set_parameters_atomically, _parameters(values))
        return self._call(request, lambda answer: answer.result)

    def _call(self, request: Callable[[], Future], read: Callable[[Any], Any]) -> Call[Any]:
        return Call(self.services_are_ready, request, read)


def _parameters(values: Mapping[str, Any]) -> list[Parameter]:
    return [Parameter(name, value=_alike(value)) for name, value in values.items()]


def _alike(value: Any) -> Any:
    """Return a list of floats in place of one of floats and integers, which ROS has not."""
    numbers = isinstance(value, (list, tuple)) and {*map(type, value)} == {float, int}
    return [*map(float, value)] if numbers else value
