"""The path of an executable by its name."""

from __future__ import annotations

import os
import shutil
import sysconfig
from pathlib import Path


def executable(name: str) -> Path:
    """Return the path of an executable: of this package, of another ROS package, on the PATH.

    A name with a slash is a path, and not looked for.  Raises a FileNotFoundError without one.
    """
    prefixes = filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep))
    libraries = [Path(prefix, 'lib') for prefix in prefixes]
    places = [
        *(library / 'ca_ros' for library in libraries), Path(sysconfig.get_path('scripts')),
        *(package for library in libraries for package in library.glob('*')),
        os.environ.get('PATH', os.defpath),
    ]
    path = shutil.which(name, path=os.pathsep.join(map(str, places)))
    if path is None:
        raise FileNotFoundError(f"no executable '{name}': is its package installed, or sourced?")
    return Path(path)
