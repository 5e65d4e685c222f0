"""The settings of allocation: the method, and a group of settings for each method."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace

from ca_ros.allocation import (
    ALLOCATORS,
    AllocationProblem,
    Allocator,
    allocator_with,
    method_class,
)
from ca_ros.allocation.exact_settings import ExactSettings
from ca_ros.problem.audit import Audit
from ca_ros.settings import ParameterError, Settings, groups, names_class, setting, table
from ca_ros.vehicle.settings import AxesSettings, VehicleSettings

METHODS = {name: kind.settings_type for name, kind in ALLOCATORS.items()}
"""The class of the settings of each shipped method."""


@dataclass(frozen=True, kw_only=True)
class MethodSettings(Settings):
    """The method, and the settings of each method."""

    method: str = setting(
        'exact', 'allocation method', choices=tuple(ALLOCATORS), own_class=True, mutable=True)
    methods: Mapping[str, Settings] = groups(METHODS)

    def of(self, method: str) -> Settings:
        """Return the settings of a method."""
        return self.methods[group_name(method)]

    @property
    def exact(self) -> ExactSettings:
        """The settings of `exact`."""
        found = self.methods['exact']
        assert isinstance(found, ExactSettings)
        return found


def own_methods(*methods: str) -> dict[str, type[Settings]]:
    """Return the class of the settings of those methods that are ``module:Class``, by group.

    Their modules are imported.  Raises a ParameterError if there is no such class.
    """
    try:
        return {
            group_name(each): method_class(each).settings_type
            for each in methods if names_class(each)
        }
    except ValueError as error:
        raise ParameterError(f'allocation.method: {error}') from None


def group_name(method: str) -> str:
    """Return the group of a method: its name, or the ``Class`` of ``module:Class``."""
    return method.rpartition(':')[2]


@dataclass(frozen=True, kw_only=True)
class AllocationSettings(MethodSettings, AxesSettings):
    """The method, and the axes of the vehicle: ``allocation.*`` of a vehicle."""


@dataclass(frozen=True, kw_only=True)
class AllocatedVehicleSettings(VehicleSettings):
    """A vehicle and its allocation."""

    allocation: AllocationSettings


@contextmanager
def full_names(settings: MethodSettings) -> Iterator[None]:
    """Put the names of the method's settings in full into errors: ``allocation.METHOD.NAME``."""
    try:
        yield
    except ValueError as error:
        names = table(type(settings.of(settings.method)))
        named = any(str(error).startswith((f'{name}:', f'{name}[')) for name in names)
        place = f'allocation.{group_name(settings.method)}.' if named else ''
        raise ParameterError(f'{place}{error}') from None


def check_other_methods(
    settings: MethodSettings, problem: AllocationProblem, present: MethodSettings | None = None
) -> None:
    """Check the settings of methods that are not in use, as far as they differ from the present.

    Without `present`, those that are not the defaults are checked.  Raises a ParameterError if a
    method cannot be made with its settings, although it can with the defaults.
    """
    for method in ALLOCATORS:
        given = settings.of(method)
        if method == settings.method or given == (
                type(given)() if present is None else present.of(method)):
            continue
        try:
            allocator_of(replace(settings, method=method), problem)
        except ParameterError:
            if _can_be_made(ALLOCATORS[method], problem):
                raise


def _can_be_made(kind: type[Allocator], problem: AllocationProblem) -> bool:
    """Tell whether a method can be made for a problem with its default settings."""
    with suppress(ValueError):
        allocator_with(kind, problem, kind.settings_type())
        return True
    return False


def allocator_of(settings: MethodSettings, subject: Audit | AllocationProblem) -> Allocator:
    """Return the allocator that the settings of a file or node describe; see `allocator_with`.

    Raises a ParameterError if a setting is wrong; the message has its full name.
    """
    with full_names(settings):
        kind = method_class(settings.method)
        return allocator_with(kind, subject, settings.of(settings.method))
