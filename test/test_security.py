"""The policy of SROS2: its format, and that it allows what the nodes have and nothing else."""

import re
import shlex
import signal
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest

from ca_ros.bringup.options import REPLACEMENTS
from ca_ros.testing import executable
from strategies import length

ROOT = Path(__file__).resolve().parent.parent
POLICY = ROOT / 'security' / 'policy.xml'
GUIDE = ROOT / 'docs' / 'security.md'

# The format is that of policy.xsd in ros2/sros2, version 0.2.0: children and attributes.
CHILDREN = {
    'policy': {'enclaves'}, 'enclaves': {'enclave'}, 'enclave': {'profiles'},
    'profiles': {'profile'}, 'profile': {'topics', 'services'}, 'topics': {'topic'},
    'services': {'service'}, 'topic': set(), 'service': set()}
ATTRIBUTES = {
    'policy': {'version'}, 'enclave': {'path'}, 'profile': {'ns', 'node'},
    'topics': {'publish', 'subscribe'}, 'services': {'request', 'reply'}}
NAME = re.compile('(~/|/)?[a-z_]+(/[a-z_]+)*')


def test_the_policy_has_the_format_of_sros2():
    policy = ElementTree.parse(POLICY).getroot()
    assert policy.tag == 'policy'
    assert policy.attrib == {'version': '0.2.0'}
    for element in policy.iter():
        assert {child.tag for child in element} <= CHILDREN[element.tag]
        assert bool(len(element)) == bool(CHILDREN[element.tag]), element.tag
        assert set(element.attrib) <= ATTRIBUTES.get(element.tag, set())
        if element.tag in ('topics', 'services'):
            assert list(element.attrib.values()) == ['ALLOW']
        elif element.tag in ('topic', 'service'):
            assert NAME.fullmatch(element.text), element.text
        else:
            assert set(element.attrib) == ATTRIBUTES.get(element.tag, set())


def allowed(policy):
    """Return what each node may do: sets of full names by node and kind, and its enclave."""
    permissions = {}
    for enclave in policy.iter('enclave'):
        for profile in enclave.iter('profile'):
            namespace, node = profile.get('ns'), profile.get('node')
            own = permissions[namespace, node] = {
                'enclave': enclave.get('path'), 'publish': set(), 'subscribe': set(),
                'reply': set(), 'request': set()}
            for group in profile:
                [kind] = group.attrib
                own[kind] |= {full(item.text, namespace, node) for item in group}
    return permissions


def full(name, namespace, node):
    """Return the full name of a topic or service, by the rules of SROS2."""
    prefix = namespace.rstrip('/')
    if name.startswith('~'):
        return f'{prefix}/{node}{name[1:]}'
    return name if name.startswith('/') else f'{prefix}/{name}'


def live(node, known):
    """Return the same of the running nodes."""
    found = {}
    for name, namespace, enclave in node.get_node_names_and_namespaces_with_enclaves():
        if (namespace, name) in known:
            found[namespace, name] = {'enclave': enclave} | {
                kind: {topic for topic, _ in ask(name, namespace)} for kind, ask in (
                    ('publish', node.get_publisher_names_and_types_by_node),
                    ('subscribe', node.get_subscriber_names_and_types_by_node),
                    ('reply', node.get_service_names_and_types_by_node),
                    ('request', node.get_client_names_and_types_by_node))}
    return found


def test_the_guide_makes_every_enclave():
    [names] = re.findall('^for node in (.*); do$', GUIDE.read_text(), re.MULTILINE)
    enclaves = ElementTree.parse(POLICY).iter('enclave')
    assert sorted(f'/{name}' for name in names.split()) == sorted(e.get('path') for e in enclaves)


@pytest.mark.parametrize('namespace', length(['/uav1'], ['/', '/uav1']))
def test_the_policy_allows_what_the_nodes_have_and_nothing_else(graph, tmp_path, namespace):
    text = POLICY.read_text(encoding='utf-8')
    if namespace != '/':
        # As the guide has it.
        [command] = re.findall('^(sed .*) > policy.xml$', GUIDE.read_text(), re.MULTILINE)
        text = subprocess.run(
            shlex.split(command), cwd=ROOT, capture_output=True, text=True, check=True).stdout
    pytest.importorskip('visualization_msgs', reason='the viewer needs visualization_msgs')
    permissions = allowed(ElementTree.fromstring(text))
    assert {key[0] for key in permissions} == {namespace}
    # As programs of one's own, the nodes are asked more.
    foreign = [
        word for option, name in REPLACEMENTS.items()
        for word in (f'--{option}', shlex.join(executable(name)))]
    place = '-p', 'detector.imu_position:=[0.0, 0.0, 0.0]'
    bringup = graph.start(
        'bringup', '--duration', '1e6', '--fail', '1@1e5', '--view', *foreign,
        '--namespace', namespace, '--out', str(tmp_path), '--ros-args',
        '-p', 'simulator.publish_clock:=true', '-p', 'simulator.real_time_factor:=0.1',
        '-p', 'rotors.thrust_curve.pwm:=[1000.0, 2000.0]', '-p', 'rotors.speed_max_per_volt:=30.0',
        '-p', 'rotors.tilt_axes:=[1.0, 0.0, 0.0]', '-p', 'rotors.tilt_max:=0.3', *place)
    graph.start(
        'monitor', '--vehicle', 'hexarotor_tilting', '--ros-args', '-r', f'__ns:={namespace}',
        *place, '--enclave', f'{namespace.rstrip("/")}/monitor')
    seen = {}

    def agree():
        seen.update(live(graph.node, permissions))
        for node, has in seen.items():
            for kind in ('publish', 'subscribe', 'reply', 'request'):
                # What a node has does not go away: there is nothing to wait for.
                missing = has[kind] - permissions[node][kind]
                assert not missing, f'{node}: {POLICY.name} lacks {kind} {missing}'
        return seen == permissions

    try:
        graph.spin_until(agree, 'the policy and the nodes agree')
    except AssertionError as error:
        graph.end(bringup, signal.SIGTERM)
        raise AssertionError(f'{error}; seen {seen}, allowed {permissions}') from None
    bringup.terminate()
    out, err = graph.outlive(bringup)
    assert bringup.returncode == 143, out + err
