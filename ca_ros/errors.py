"""The base class of the package's errors."""


class CaRosError(Exception):
    """An error with a message of one line.

    Wrong arguments of functions raise a `ValueError`.  Wrong parameters raise a `ParameterError`,
    which is both.
    """
