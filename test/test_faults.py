"""The laws of the fault harness."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ca_ros import ParameterError
from ca_ros.nodes.link_faults import (
    CORRUPTIONS,
    LINK_CORRUPTIONS,
    Fate,
    FaultSettings,
    Link,
    corrupted,
)
from ca_ros.setting_names import check_given
from ca_ros.settings import read, table

SHARES = st.floats(0.0, 1.0)
TIMES = st.floats(0.0, 0.1)
COMMANDS = 'command/motor_speed', 'command/tilt_angle'
TOPICS = st.sampled_from(list(LINK_CORRUPTIONS))
FAULTY = st.builds(
    FaultSettings, topics=TOPICS, seed=st.integers(0, 10**9), drop=SHARES, duplicate=SHARES,
    reorder=SHARES, corrupt=SHARES, delay=TIMES, jitter=TIMES)
NUMBERS = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=8)


# Fates

@given(FAULTY, st.permutations(range(20)))
def test_a_fate_depends_on_seed_topic_and_number_alone(faults, order):
    in_order = [faults.fate(k) for k in range(20)]
    assert {k: faults.fate(k) for k in order} == dict(enumerate(in_order))
    assert [replace(faults).fate(k) for k in range(20)] == in_order


def test_a_fate_is_the_same_on_every_machine():
    # Computed once, so that a seed that was told to someone else means the same to them.
    faults = FaultSettings(topics='command/wrench', seed=7, drop=0.2, reorder=0.2, corrupt=0.3)
    assert [faults.fate(k).kinds for k in range(8)] == GOLDEN


GOLDEN = [['dropped'], ['reordered'], ['dropped'], [], [], [], ['dropped'], ['corrupted']]


@given(FAULTY, SHARES, st.integers(0, 1000))
def test_what_is_lost_at_one_rate_is_lost_at_every_greater_rate(faults, more, k):
    worse = replace(faults, drop=max(faults.drop, more), duplicate=0.0, corrupt=0.0)
    assert faults.fate(k).copies > 0 or worse.fate(k).copies == 0


@pytest.mark.parametrize('kind', ['drop', 'duplicate', 'reorder', 'corrupt'])
@pytest.mark.parametrize('share', [0.0, 0.1, 1.0])
def test_shares_are_kept(kind, share):
    n = 10_000
    faults = FaultSettings(topics='command/wrench', **{kind: share})
    hit = sum(bool(faults.fate(k).kinds) for k in range(n))
    assert abs(hit - n * share) <= 5.0 * math.sqrt(n * share * (1.0 - share))


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.integers(0, 1000))
def test_delays_lie_within_delay_and_jitter(delay, jitter, k):
    faults = FaultSettings(topics='command/wrench', delay=delay, jitter=jitter)
    assert delay <= faults.fate(k).delay <= delay + jitter


# Corruption

@given(NUMBERS, st.sampled_from(CORRUPTIONS), st.floats(0.0, 1.0, exclude_max=True))
def test_a_corruption_changes_one_thing(numbers, corruption, place):
    wrong = corrupted(numbers, corruption, place)
    if corruption == 'frame':
        assert wrong == numbers
    elif corruption == 'length':
        assert abs(len(wrong) - len(numbers)) == 1
    else:
        assert len(wrong) == len(numbers)
        changed = [i for i, (a, b) in enumerate(zip(numbers, wrong, strict=True))
                   if a != b or math.copysign(1.0, a) != math.copysign(1.0, b)]
        assert changed == [int(place * len(numbers))]
        value = abs(wrong[changed[0]])
        assert {'not_a_number': math.isnan(value), 'infinite': value == math.inf,
                'huge': value == 1e12, 'sign': value == abs(numbers[changed[0]])}[corruption]


# Links

FATES = st.builds(Fate, copies=st.integers(0, 2), delay=TIMES, overtaken=st.booleans())


@pytest.mark.slow
@given(st.lists(st.tuples(FATES, TIMES)))
def test_a_link_loses_and_invents_nothing(arrivals):
    link, now, out = Link(), 0.0, []
    for k, (fate, later) in enumerate(arrivals):
        now += later
        link.put(k, fate, now)
        out += link.take(now)
        assert link.due > now
    sent = [k for k, (fate, _) in enumerate(arrivals) for _ in range(fate.copies)]
    assert len(out) + len(link) == len(sent)
    link.put(None, Fate(), now + 1.0)
    out += link.take(math.inf)
    assert len(link) == 0
    assert sorted(k for k in out if k is not None) == sent
    assert out[-1] is None or arrivals[-1][0].overtaken


@given(st.lists(st.tuples(st.integers(0, 2), TIMES)), TIMES)
def test_a_constant_delay_keeps_the_order_and_is_kept(arrivals, delay):
    link, now, put, taken = Link(), 0.0, [], []
    for k, (copies, later) in enumerate(arrivals):
        now += later
        while link.due <= now:
            at = link.due
            taken += [(k, at) for k in link.take(at)]
        link.put(k, Fate(copies, delay), now)
        put += [(k, now + delay)] * copies
    while link.due < math.inf:
        at = link.due
        taken += [(k, at) for k in link.take(at)]
    assert taken == put


def test_what_is_overtaken_comes_after_the_next():
    link = Link()
    for k, overtaken in enumerate([False, True, False, True, True, False]):
        link.put(k, Fate(overtaken=overtaken), 0.0)
    assert link.take(0.0) == [0, 2, 1, 3, 5, 4]


# Parameters

@given(SHARES, SHARES)
def test_a_number_is_for_all_topics_or_one_for_each(share, other):
    assert {faults.drop for faults in FaultSettings(drop=share).links().values()} == {share}
    shares = [share, other, 0.0, 1.0]
    found = [faults.drop for faults in FaultSettings(drop=shares).links().values()]
    assert found == [*shares, other]  # angles as speeds
    both = FaultSettings(topics=[*LINK_CORRUPTIONS], drop=[*shares, 0.5]).links()
    assert [faults.drop for faults in both.values()] == [*shares, 0.5]


def test_a_topic_has_the_corruptions_of_its_type():
    faults = FaultSettings(corrupt=1.0).links()
    assert all(('length' in f.corruptions) == (t in COMMANDS)
               for t, f in faults.items())
    assert all(('frame' in f.corruptions) != ('length' in f.corruptions) for f in faults.values())
    only = FaultSettings(corrupt=1.0, corruptions='length').links()
    assert [only[topic].fate(0).corruption for topic in LINK_CORRUPTIONS] == [
        None, 'length', None, None, 'length']


@pytest.mark.parametrize(('given', 'words'), [
    ({'drop': 1.1}, ('drop', '[0, 1]')), ({'drop': math.nan}, ('drop', 'nan')),
    ({'drop': [0.1, 0.2]}, ('drop', '4', '2')), ({'drop': 'much'}, ('drop', 'much')),
    ({'delay': -0.1}, ('delay', '[0, 60]')), ({'jitter': 1e300}, ('jitter', '60')),
    ({'dorp': 0.1}, ('dorp', 'drop')),
    ({'topics': ['command/pose']}, ('topics[0]', 'command/wrench')), ({'topics': []}, ('topics',)),
    ({'topics': ['command/wrench'] * 2}, ('topics', 'different')),
    ({'corruptions': ['rust']}, ('corruptions[0]', 'huge')), ({'seed': [1.0]}, ('seed',)),
])
def test_wrong_parameters_are_named(given, words):
    with pytest.raises(ParameterError) as raised:  # noqa: PT012
        check_given(given, table(FaultSettings))
        read(FaultSettings, given)
    assert [word for word in words if word not in str(raised.value)] == []
