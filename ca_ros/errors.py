"""The base class of the errors that ca_ros raises besides Python's own."""


class CaRosError(Exception):
    """A fault that a message of one line explains.

    Wrong arguments of a function raise a `ValueError`; parameters that are wrong raise a
    `ParameterError`, which is both.
    """
