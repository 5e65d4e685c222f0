// A vehicle from its settings, with the bits of ca_ros.vehicle: the control allocation matrix and the bounds.
import {bodyOf} from './flight.js';
import {check, FIELDS, insist, readSettings} from './settings.js';

export const AXES = FIELDS['allocation.axes'].choices;
export const ACCELERATION = 2000; // of rotors without a rate in the file [rad/s^2]
const HEALTH_MIN = 1e-9, ROTORS_MAX = 32, APART_MAX = 2, WEIGHTS_MAX = 1e4, PREFERRED_MAX = 100, SEGMENTS_MAX = 256;

/** Why there is no page for vehicles whose rotors tilt. */
export const TILTING = 'the set of their wrenches has curved walls, which this page cannot draw; ca_ros audit and ' +
  'ca_ros attainable take them';

const expect = (sound, name, expected) => insist(sound, `${name}: expected ${expected}`);

/** Return x, y and z of each of a flat list. */
function triples(name, value) {
  const list = [value].flat();
  expect(list.length && list.length % 3 === 0, name, `x, y, z per rotor, got ${list.length} numbers`);
  return Array.from({length: list.length / 3}, (_, i) => list.slice(3 * i, 3 * i + 3));
}

function positions(get) {
  const [count, radius, angle, height] = ['count', 'radius', 'first_angle', 'height']
    .map((name) => get(`rotors.ring.${name}`));
  const name = 'rotors.positions', given = get(name) !== 0;
  expect(!(given && count), name, 'either positions or rotors.ring, got both');
  expect(given || count, name, 'x, y, z of each rotor [m], or rotors.ring');
  expect(count || !(radius || angle || height), 'rotors.ring.count', 'the number of rotors on the ring');
  expect(!count || radius, 'rotors.ring.radius', 'the radius of the ring [m]');
  expect(count <= ROTORS_MAX, name, `up to ${ROTORS_MAX} rotors, got ${count}`);
  if (!count) return triples(name, get(name));
  return Array.from({length: count}, (_, i) => {
    const [x, y] = direction(angle, i, count);
    return [radius * x + 0, radius * y + 0, height + 0];
  });
}

/** Return cosine and sine of the angle of rotor i of n on a ring, as ca_ros.vehicle.geometry. */
function direction(first, i, n) {
  const quarter = 90 * n, turn = 360 * i, before = Math.round(first / 90), whole = Math.floor(turn / quarter);
  let rest = (first - 90 * before) * n + (turn - quarter * whole);
  const more = Math.round(rest / quarter);
  rest -= more * quarter;
  const size = Math.abs(rest), c = Math.cos(2 * Math.PI * (size / (360 * n)));
  let s = 12 * size === 360 * n ? 0.5 : 8 * size === 360 * n ? c : Math.sin(2 * Math.PI * (size / (360 * n)));
  if (rest < 0) s = -s;
  return [[c, s], [-s, c], [-c, -s], [s, -c]][(((before + whole + more) % 4) + 4) % 4];
}

/** Return two limits, as ca_ros.problem.prioritization.airmode_limits. */
function airmodeLimits(name, given) {
  const [first, second = first] = [given].flat();
  expect(second <= first, name, `a limit for yaw up to that for roll and pitch, got ${[given]}`);
  return [first, second];
}

/** Return the groups of an order, words of axes, without the axes that are not commanded. */
export function groups(name, order, axes) {
  const listed = [order].flat().map((group) => group.split(/\s+/).filter(Boolean)), flat = listed.flat();
  const sound = new Set(flat).size === flat.length && listed.every((group) => group.length) &&
    axes.every((axis) => flat.includes(axis)) && flat.every((axis) => AXES.includes(axis));
  expect(sound, name, `groups that name each of ${axes.join(', ')} once, got ${order}`);
  return listed.map((group) => group.filter((axis) => axes.includes(axis)).join(' ')).filter(Boolean);
}

/** Return a vehicle: what the kernel and the picture need, and `exact`, which a case can change. */
export function readVehicle(text) {
  const [get, given] = readSettings(text), exact = (name) => get(`allocation.exact.${name}`);
  for (const name of ['tilt_axes', 'gimbal']) {
    const without = [get(`rotors.${name}`)].flat().every((x) => x === 0);
    insist(without, `rotors.${name}: rotors that tilt: ${TILTING}`);
  }
  const com = get('vehicle.center_of_mass');
  const arms = positions(get).map((place) => place.map((x, i) => x - com[i])), n = arms.length;
  expect(n <= ROTORS_MAX, 'rotors.positions', `up to ${ROTORS_MAX} rotors, got ${n}`);
  let directions = triples('rotors.axes', get('rotors.axes')).map(([x, y, z]) => {
    const length = Math.sqrt(x * x + y * y + z * z);
    expect(length > 0, 'rotors.axes', 'axes longer than zero');
    return [x / length, y / length, z / length];
  });
  if (directions.length === 1) directions = Array(n).fill(directions[0]);
  expect(directions.length === n, 'rotors.axes', `3 or ${3 * n} numbers`);
  const words = get('rotors.spins');
  expect(Array.isArray(words) && words.length === n, 'rotors.spins',
    `${n} words, one per rotor, got ${words}`);
  const each = (name) => {
    const list = [get(name)].flat();
    expect(list.length === 1 || list.length === n, name,
      `1 or ${n} numbers, one per rotor, got ${list.length}`);
    return list.length === 1 ? Array(n).fill(list[0]) : list;
  };
  const [forward, torque, backward, rates, slowing, low, high, perVolt] = [
    'thrust_coefficient', 'torque_coefficient', 'thrust_coefficient_reverse', 'acceleration_max',
    'deceleration_max', 'speed_min', 'speed_max', 'speed_max_per_volt'].map((name) => each(`rotors.${name}`));
  const one = 'positive numbers for all rotors, or 0 for all';
  const all = (list, sense) => list.every((x) => x > 0 === sense);
  expect(all(rates, true) || (all(rates, false) && all(slowing, false)), 'rotors.acceleration_max', one);
  expect(all(slowing, true) || all(slowing, false), 'rotors.deceleration_max', one);
  const tooHigh = low.findIndex((speed, i) => speed > high[i]);
  expect(tooHigh < 0, 'rotors.speed_min',
    `up to rotors.speed_max, got ${low[tooHigh]} of rotor ${tooHigh + 1}`);
  const volts = get('rotors.battery_voltage');
  const nominal = volts || Math.max(0, ...perVolt.map((k, i) => (k ? high[i] / k : 0)));
  const throttle = Math.max(...high, ...perVolt.map((k) => 1.5 * nominal * k)); // a full battery
  const full = perVolt.map((k) => (volts && k ? k * volts : Infinity)); // the battery limits the speeds
  const speedMin = low.map((s, i) => Math.max(s, -full[i])),
    speedMax = high.map((s, i) => Math.min(s, full[i]));
  const turns = speedMax.every((s, i) => s > Math.max(speedMin[i], 0));
  expect(!volts || turns, 'rotors.battery_voltage', 'enough to turn the rotors');

  const wanted = [get('allocation.axes')].flat(), axes = AXES.filter((axis) => wanted.includes(axis));
  expect(axes.length && axes.length === wanted.length, 'allocation.axes', `different axes, got ${wanted}`);
  expect(axes.length > 1, 'allocation.axes', 'two axes or more to draw, got one');
  const wrenches = arms.map(([x, y, z], i) => {
    const [a, b, c] = directions[i], k = (words[i] === 'cw' ? 1 : -1) * (torque[i] / forward[i]);
    return [a, b, c, k * a + (y * c - z * b), k * b + (z * a - x * c), k * c + (x * b - y * a)];
  });
  const hover = get('vehicle.mass') * get('vehicle.gravity') - get('vehicle.buoyancy');
  const acceleration = rates.map((a) => a || ACCELERATION);
  const vehicle = {
    name: get('vehicle.name'), n, axes, arms, directions, forward, speedMin, speedMax, acceleration,
    curve: thrustCurve(get, forward, low, high, throttle),
    reverse: backward.map((k, i) => (k > 0 ? k : forward[i])),
    body: bodyOf(get, given, wrenches), levels: get('controller.attitude') === 'level',
    gamma: axes.map((axis) => wrenches.map((wrench) => wrench[AXES.indexOf(axis)])),
    reference: axes.map((axis) => (axis === 'thrust' ? hover : 0)),
    ratesAssumed: all(rates, false), deceleration: slowing.map((d, i) => d || acceleration[i]), health: each('rotors.health'),
    weight: each('allocation.exact.weights'), preferred: each('allocation.exact.preferred'),
    slack: exact('residual_slack'), policy: exact('policy'), deviation: exact('axis_reversal'),
    airmode: airmodeLimits('allocation.exact.airmode_limit', exact('airmode_limit')),
    order: groups('allocation.exact.order', exact('order'), axes),
    given, spins: words, torque,
    source: JSON.stringify({'/**': {ros__parameters: given}}), // what a link has to carry, as YAML
  };
  const {lower: lowerThrusts, upper: upperThrusts} = bounds(vehicle, vehicle.health);
  Object.assign(vehicle, {lowerThrusts, upperThrusts, fullThrusts: bounds(vehicle, Array(n).fill(1)).upper});
  const sizes = Object.values(bounds(vehicle, vehicle.health)).slice(0, 2).flat().map(Math.abs);
  const {weight, preferred} = vehicle, most = PREFERRED_MAX * Math.max(1, ...sizes);
  const even = Math.max(...weight) <= WEIGHTS_MAX * Math.min(...weight);
  expect(even, 'allocation.exact.weights', 'weights up to 1e4 times each other');
  expect(preferred.every((f) => Math.abs(f) <= most), 'allocation.exact.preferred', `thrusts up to ${most}`);
  return vehicle;
}

/** Return the segments of a thrust curve, as ca_ros.vehicle.thrust_curve: start, a, b, c; none: k_f w^2. */
function thrustCurve(get, forward, low, high, throttle) {
  const least = Math.min(...low), top = Math.max(...high), whole = 'rotors.thrust_curve';
  const [polynomial, speeds, thrusts, throttles, pwm] = ['polynomial', 'speeds', 'thrusts', 'throttles', 'pwm']
    .map((kind) => get(`${whole}.${kind}`)).map((value) => value === 0 ? undefined : [value].flat());
  expect(!pwm || new Set(pwm).size > 1, `${whole}.pwm`, 'two different pulse widths');
  expect(!(polynomial && thrusts), `${whole}.polynomial`, 'no thrusts beside it');
  expect(speeds || !(thrusts || throttles), `${whole}.speeds`, 'those of thrusts and throttles');
  const alike = least >= 0 && forward.every((k) => k === forward[0]);
  expect(alike || !(polynomial || thrusts), whole, 'rotors with one thrust_coefficient that do not reverse');
  const curve = polynomial ? polynomialCurve(polynomial, least, throttles ? top : throttle)
    : thrusts ? tableCurve(points(speeds, 'thrusts', thrusts)) : [];
  if (throttles) points(speeds, 'throttles', throttles);
  expect(!speeds || Math.max(...speeds) >= top * (1 - 1e-9), `${whole}.speeds`, `speeds up to speed_max, ${top}`);
  expect(curve.length <= SEGMENTS_MAX, `${whole}.thrusts`, `up to ${SEGMENTS_MAX} numbers`);
  const apart = curve.length ? thrustAt(curve, top) / (forward[0] * top * top) : 1;
  expect(apart >= 1 / APART_MAX && apart <= APART_MAX, whole, 'thrusts in the unit of thrust_coefficient');
  return curve;
}

function polynomialCurve(polynomial, least, throttle) {
  const name = 'rotors.thrust_curve.polynomial';
  expect(polynomial.length === 3, name, 'a, b and c');
  const [a, b, c] = polynomial, first = (a * least + b) * least + c;
  const rises = Math.min(2 * a * least + b, 2 * a * throttle + b) >= 0 && (a || b) &&
    (least > 0 ? first > 0 : c === 0);
  expect(rises, name, 'thrusts that are positive and increase from speed_min to full throttle');
  const curve = [[Math.max(least, 0), a, b, c]];
  return least > 0 ? [[0, first / (least * least), 0, 0], ...curve] : curve;
}

function tableCurve([w, f]) {
  expect((w[0] === 0) === (f[0] === 0), 'rotors.thrust_curve.thrusts', 'a thrust of 0 only at rest');
  return w.slice(1).map((end, i) => {
    const a = (f[i + 1] - f[i]) / (end * end - w[i] * w[i]);
    return [w[i], a, 0, f[i] - a * (w[i] * w[i])];
  });
}

/** Return speeds and values from rest on. */
function points(speeds, kind, values) {
  for (const [name, list] of [['speeds', speeds], [kind, values]]) {
    const rises = list.length > 1 && list[0] >= 0 && list.every((x, i) => !i || x > list[i - 1]);
    expect(rises, `rotors.thrust_curve.${name}`, 'two or more numbers from 0 on that increase');
  }
  expect(speeds.length === values.length, `rotors.thrust_curve.${kind}`, 'one for each speed');
  return speeds[0] > 0 && values[0] > 0 ? [[0, ...speeds], [0, ...values]] : [speeds, values];
}

function thrustAt(curve, speed) {
  const [, a, b, c] = curve.findLast(([start]) => start <= speed);
  return (a * speed + b) * speed + c;
}

/** Return bounds of thrusts and speeds of rotors with some health. */
export function bounds({curve, forward, reverse, speedMin, speedMax}, health) {
  const share = health.map((h) => (h < HEALTH_MIN ? 0 : h));
  const thrust = (speed, i) => {
    if (curve.length) return share[i] * forward[i] / forward[0] * thrustAt(curve, speed);
    return speed < 0 ? -(share[i] * reverse[i] * (speed * speed)) : share[i] * forward[i] * (speed * speed);
  };
  const turning = (speeds) => speeds.map((speed, i) => (share[i] * forward[i] > 0 ? speed : 0 * speed));
  const factor = (coefficients) => coefficients.map((k, i) => (share[i] * k > 0 ? share[i] * k : 1));
  return {
    lower: speedMin.map(thrust), upper: speedMax.map(thrust), forward: factor(forward),
    reverse: factor(reverse),
    speed_min: turning(speedMin), speed_max: turning(speedMax),
  };
}

/** Return what a case sets beside the vehicle, checked: all of it, from what is given. */
export function readCase(vehicle, given, methods) {
  const {axes, n, health, policy, order, deviation, airmode, reference} = vehicle;
  const exact = (name) => FIELDS[`allocation.exact.${name}`];
  const fields = {
    demand: {...FIELDS['vehicle.center_of_mass'], sizes: [axes.length]},
    health: {...FIELDS['rotors.health'], sizes: [n]},
    policy: exact('policy'), order: exact('order'), deviation: exact('axis_reversal'),
    airmode: exact('airmode_limit'),
    elapsed: {...FIELDS['vehicle.buoyancy'], range: 'a time in seconds, at least 0'},
    beside: {words: true, choices: methods, range: `one of ${methods.filter(Boolean).join(', ')}`},
    shown: {words: true, array: true, sizes: [2, 3], choices: axes, range: `of ${axes.join(', ')}`},
  };
  const state = {demand: reference, health, policy, order, deviation, airmode, elapsed: 0, beside: '',
    shown: axes.slice(-3)};
  for (const [name, value] of Object.entries(given)) {
    insist(Object.hasOwn(fields, name), `${name}: no such parameter`);
    state[name] = check(name, value, fields[name]);
  }
  expect(new Set(state.shown).size === state.shown.length, 'shown', `different axes, got ${state.shown}`);
  return {...state, order: groups('order', state.order, axes),
    airmode: airmodeLimits('airmode', state.airmode)};
}
