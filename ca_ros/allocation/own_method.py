"""Methods of one's own: classes in modules outside of this package, named module:Class."""

import os
import sys
from importlib import import_module
from inspect import signature

from ca_ros.allocation.allocator import Allocator


def own_class(method: str) -> type[Allocator]:
    """Return the class that a method such as ``my_module:MyMethod`` names.

    Raises a ValueError if the import fails, or it is not a complete subclass of `Allocator` that
    can be made from a vehicle alone.

    `method`: a module, which is imported from Python's path or the working directory, and its
    class.
    """
    module, _, name = method.partition(':')
    if os.getcwd() not in sys.path:
        # Python finds modules beside an installed script, but not in the working directory.
        sys.path.append(os.getcwd())
    try:
        found = getattr(import_module(module), name)
    except (Exception, SystemExit) as error:
        # The module may raise anything while it is imported.
        raise ValueError(f'{method}: {error or type(error).__name__}') from error
    if not isinstance(found, type):
        raise ValueError(f'{method}: not a class')
    if not issubclass(found, Allocator):
        raise ValueError(f'{method}: expected a subclass of ca_ros.Allocator')
    if missing := ', '.join(sorted(found.__abstractmethods__)):
        raise ValueError(f'{method}: the class does not define {missing}')
    try:
        signature(found).bind(None)
    except TypeError as error:
        raise ValueError(f'{method}: cannot be made from a vehicle: {error}') from None
    return found
