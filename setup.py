import json
import re
import sys
from copy import copy
from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext

package = 'ca_ros'
# The sources: with colcon's --symlink-install this file is a link in a folder without the others.
root = Path(__file__).resolve().parent
sys.path.insert(0, str(root))

from ca_ros_cli import COMMANDS  # noqa: E402

solvers = ['daqp', 'quadprog']
# Besides osqp, which is needed anyway.
peers = [*solvers, 'clarabel', 'highspy', 'piqp', 'proxsuite']
bag = ['rosbags>=0.11']
# What `ca_ros.testing` needs, besides ROS.
testing = ['psutil>=5.9', 'pytest>=7.4', 'ros-domain-coordinator>=0.12']
mujoco = ['mujoco>=3.2']
# What `ca_ros.studies` and the plot of bringup need, and no node.
studies = ['matplotlib>=3.6', 'pandas>=2.1', 'tqdm>=4.66']
cluster = ['distributed>=2024.1']
# The exact allocator in C; without a compiler the package installs all the same, and uses NumPy.
kernel = f'{package}/kernel'
files = json.loads((root / kernel / 'files.json').read_text(encoding='utf-8'))
commands_max = [('CA_COMMANDS', '1000')]  # as in ca_ros/detection/motor_model.py
kernels = [
    Extension(
        f'{package}.kernel._{name}',
        [f'{kernel}/{file}' for file in [*files[library]['sources'], module]],
        depends=sorted(glob(f'{kernel}/*.h')),
        define_macros=[('CA_MODULE', f'_{name}'), *macros],
        # No fused multiplications: all machines are to give the same bits. No vectors: loops have
        # few turns. No debug information: it has the paths of the machine that builds.
        extra_compile_args=[
            '-std=c99', '-O3', '-fno-tree-loop-vectorize', '-ffp-contract=off', '-g0'],
        optional=True,
    )
    for name, library, module, macros in (
        ('double', 'exact', 'module.c', []),
        # Loops of constant length are faster: vehicles with upright rotors have four axes.
        ('double_4', 'exact', 'module.c', [('CA_M', '4'), ('CA_FIXED_AXES', None)]),
        ('single', 'exact', 'module.c', [('CA_FLOAT', None)]),
        ('detector', 'detector', 'detector_module.c', commands_max),
        ('detector_single', 'detector', 'detector_module.c',
         [('CA_FLOAT', None), *commands_max]),
        ('vectored', 'vectored', 'vectored_module.c', []),
        ('vectored_single', 'vectored', 'vectored_module.c', [('CA_FLOAT', None)]),
    )
]


class BuildKernels(build_ext):
    """Compile the kernels side by side, each in a folder of its own: they share their files."""

    def run(self):
        super().run()
        if not all(Path(self.get_ext_fullpath(each.name)).exists() for each in kernels):
            print(
                f'{package}: the kernel in C was not built, so exact runs in NumPy, more slowly; '
                'to have it, install gcc and the headers of Python (apt: gcc python3-dev)',
                file=sys.stderr,
            )

    def finalize_options(self):
        super().finalize_options()
        self.parallel = self.parallel or len(kernels)

    def build_extension(self, ext):
        one = copy(self)
        one.build_temp = f'{self.build_temp}/{ext.name}'
        build_ext.build_extension(one, ext)


def executables():
    """Write a script for each command, which `ros2 run ca_ros COMMAND` starts; return the files.

    pip leaves data files as they are: the first line finds the Python of the PATH.
    """
    folder = Path('build/executables')
    folder.mkdir(parents=True, exist_ok=True)
    for name in COMMANDS:
        script = folder / name
        script.write_text(
            '#!/usr/bin/env python3\n'
            'import sys\n\n'
            'from ca_ros_cli import main\n\n'
            f'sys.exit(main([{name!r}, *sys.argv[1:]]))\n', encoding='utf-8')
        script.chmod(0o755)
    return [str(folder / name) for name in COMMANDS]


def description():
    """Return README for PyPI: pictures and links within the repository would be dead there."""
    text = (root / 'README.md').read_text(encoding='utf-8').partition('\n## Documentation')[0]
    text = re.sub(r'!\[[^]]*\]\((?!https:)[^)]*\)\n\n', '', text)
    return re.sub(r'\[([^]]*)\]\((?!https:)[^)]*\)', r'\1', text)


setup(
    name=package,
    version=ElementTree.parse(root / 'package.xml').findtext('version'),
    description='Control allocation for multirotors over ROS 2',
    long_description=description(),
    long_description_content_type='text/markdown',
    keywords=[
        'control allocation', 'mixer', 'multirotor', 'quadratic programming', 'robotics', 'ROS 2',
    ],
    classifiers=[
        'Development Status :: 4 - Beta',
        'Framework :: Pytest',
        'Intended Audience :: Developers',
        'Intended Audience :: Science/Research',
        'Operating System :: MacOS',
        'Operating System :: POSIX :: Linux',
        'Programming Language :: C',
        'Programming Language :: Python :: 3',
        *(f'Programming Language :: Python :: 3.{minor}' for minor in range(10, 15)),
        'Topic :: Scientific/Engineering',
        'Typing :: Typed',
    ],
    license='Apache-2.0',
    maintainer='ca_ros maintainers',
    maintainer_email='ca_ros@users.noreply.github.com',
    packages=find_packages(include=[package, f'{package}.*']),
    py_modules=['ca_ros_cli', 'pytest_ca_ros'],
    package_data={
        package: [
            'explorer.html', 'py.typed', 'studies/templates/*',
            'firmware/templates/*', 'kernel/*.[ch]', 'kernel/*.json', 'process/discovery.xml',
        ],
    },
    ext_modules=kernels,
    cmdclass={'build_ext': BuildKernels},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package}']),
        (f'lib/{package}', executables()),
        (f'share/{package}', ['package.xml']),
        (f'share/{package}/config', sorted(glob('config/*.yaml'))),
        (f'share/{package}/config/diagnostics', sorted(glob('config/diagnostics/*.yaml'))),
        (f'share/{package}/config/problems', sorted(glob('config/problems/*.yaml'))),
        (f'share/{package}/config/tilting', sorted(glob('config/tilting/*.yaml'))),
        (f'share/{package}/security', ['security/policy.xml']),
        (f'share/{package}/layouts', sorted(glob('layouts/*'))),
    ],
    zip_safe=False,
    python_requires='>=3.10',
    # The lower bounds are what Ubuntu 24.04 has; osqp is not among its packages.
    install_requires=['numpy>=1.26', 'scipy>=1.11', 'osqp>=1.0', 'PyYAML>=6.0', 'Jinja2>=3.1'],
    extras_require={
        # ROS 2 Jazzy for machines without it. Where ROS is installed, rclpy comes from there:
        # never both in one environment.
        'ros': [
            'ros-rclpy[fastrtps]==7.1.6',
            'ros-std-msgs==5.3.6',
            'ros-geometry-msgs==5.3.6',
            'ros-diagnostic-msgs==5.3.6',
            'ros-nav-msgs==5.3.6',
            'ros-sensor-msgs==5.3.6',
            'ros-std-srvs==5.3.6',
            'ros-visualization-msgs==5.3.6',
        ],
        # Bags of flights, without a ROS installation.
        'bag': bag,
        'solvers': solvers,
        'studies': studies,
        # Studies on a Dask cluster, `--scheduler`.
        'cluster': [*cluster, *studies],
        # Tests of one's own nodes.
        'testing': testing,
        # For examples/mujoco.
        'mujoco': mujoco,
        # The solvers of others in `make benchmark`; all have wheels for CPython 3.10 to 3.14.
        'peers': [*peers, *studies],
        # Tests of the explorer, with the Chromium of the system.
        'browser': ['playwright>=1.40'],
        # Here and not in tests_require, with which colcon would run no test at all. The checkers
        # are held back because each new series may report errors in code that passed before.
        'test': [
            'build',
            'clarabel',
            'colcon-common-extensions',
            'hypothesis',
            'mcap-ros2-support>=0.5.5',
            'mypy~=2.4.1',
            'pytest-cov',
            'pytest-timeout',
            'pytest-xdist',
            'ruff~=0.17.5',
            'types-PyYAML',
            'wheel',
            # For `make docs`.
            'furo>=2024.8.6',
            'myst-parser>=3.0',
            'numpydoc>=1.7',
            'sphinx>=7.2',
            *bag,
            *cluster,
            *mujoco,
            *peers,
            *studies,
            *testing,
        ],
    },
    entry_points={
        'console_scripts': [f'{package} = {package}_cli:main'],
        'pytest11': [f'{package} = pytest_ca_ros'],
    },
)
