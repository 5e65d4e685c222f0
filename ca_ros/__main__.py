"""``python -m ca_ros``: the same as the command ``ca_ros``."""

from ca_ros_cli import main

if __name__ == '__main__':
    raise SystemExit(main())
