"""What users give in place of a file: a pipe, a device, a folder, far too much, or no text."""

import os
import subprocess

import pytest

from ca_ros.__main__ import main
from ca_ros.firmware.command import main as firmware
from ca_ros.input_files import SIZE_MAX, check_file, read_text
from ca_ros.settings import ParameterError
from ca_ros.testing import executable

NUMBERS = '--thrust-coefficient', '1', '--speed-min', '0', '--speed-max', '1'
COMMANDS = {
    'audit': ['audit', '{}'],
    'from-urdf': ['from-urdf', '{}', '--rotors', 'a', '--spins', 'cw', '--torque-coefficient', '1',
                  *NUMBERS],
    'from-px4': ['px4-parameters', 'from-px4', '{}', '--mass', '1', *NUMBERS],
    'fit-thrust': ['fit-thrust', '{}'],
}


@pytest.fixture(params=['pipe', 'device', 'large', 'binary'])
def wrong(request, tmp_path):
    """Return a path, and the fault that is named."""
    path = tmp_path / 'given.csv'
    if request.param == 'pipe':
        os.mkfifo(path)
        return path, 'expected a file, got a folder, a pipe or a device'
    if request.param == 'device':
        path.symlink_to('/dev/zero')
        return path, 'expected a file, got a folder, a pipe or a device'
    if request.param == 'large':
        with path.open('wb') as file:
            # It takes no room on the disk.
            file.truncate(100_000_000)
        return path, '100 MB: expected at most'
    path.write_bytes(b'\xff\xfe\x00')
    return path, 'not readable text'


@pytest.mark.parametrize('command', COMMANDS)
@pytest.mark.timeout(60)
def test_one_line_tells_what_is_wrong_with_a_file(wrong, command, capsys):
    path, fault = wrong
    assert main([word.format(path) for word in COMMANDS[command]]) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert str(path) in line
    assert fault in line


@pytest.mark.parametrize('wrong', ['pipe', 'large'], indirect=True)
def test_so_do_firmware_trajectories_and_nodes(wrong, tmp_path, capsys):
    path, fault = wrong
    assert firmware(['--vehicle', str(path), '--out', str(tmp_path / 'out')]) == 1
    assert fault in capsys.readouterr().err
    node = ['monitor', '--ros-args', '--params-file', path]
    for words in (['bringup', '--trajectory', path], node):
        found = subprocess.run(
            [*executable(words[0]), *map(str, words[1:])], capture_output=True, text=True,
            timeout=60)
        [*_, line] = found.stderr.splitlines()
        assert found.returncode in (1, 2)
        assert str(path) in line
        assert fault in line


def test_a_file_of_the_greatest_size_is_read(tmp_path):
    path = tmp_path / 'whole'
    path.write_bytes(b'a' * SIZE_MAX)
    assert len(read_text(path)) == SIZE_MAX
    with pytest.raises(ParameterError, match=r'10 MB: expected at most 1 MB'):
        check_file(path, 1_000_000)
    with pytest.raises(ParameterError, match='missing: No such file'):
        check_file(tmp_path / 'missing')
