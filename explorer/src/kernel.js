// The kernel in WebAssembly: one vehicle at a time.
import wasm from 'kernel.wasm';
import {AXES, bounds} from './vehicle.js';

const ROTORS = 32, POLICIES = {prioritize: 1, scale: 2, reject: 4};
const STATUS = ['EXACT', 'PRIORITIZED', 'SCALED', 'INEXACT', 'REJECTED', 'INVALID', 'RATE_LIMITED'];
const METHODS = ['exact', 'pseudo_inverse', 'fixed_pseudo_inverse', 'pseudo_inverse_of_all_axes'];

const count = (size, make) => Array.from({length: size}, (_, i) => make(i));
export const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);

export async function loadKernel() {
  const {exports} = (await WebAssembly.instantiate(wasm, {env: {atan2: Math.atan2}})).instance;
  const {buffer} = exports.memory;
  // Numbers of C by name: the kernel exports pointers to them.
  const address = (pointer) => new Int32Array(buffer, pointer.value, 1)[0];
  const find = (name) => exports[`int_${name}`] ? new Int32Array(buffer, address(exports[`int_${name}`]))
    : new Float64Array(buffer, address(exports[`ca_real_${name}`]));
  const c = new Proxy({}, {get: (known, name) => (known[name] ??= find(name))});
  const set = (given) => Object.entries(given).forEach(([name, values]) => c[name].set([values].flat(2)));
  const get = (name, size) => [...c[name].subarray(0, size)];
  let rowOf; // by axis its row in the kernel, -1 if it is lost

  /** Prepare a vehicle with rotor health; returns which axes are left, and their ranges. */
  function prepare(vehicle, health, {policy, order, deviation, airmode, elapsed = 0}) {
    const {n, axes, gamma, weight, preferred, slack, curve, acceleration, deceleration, reference} = vehicle;
    const now = bounds(vehicle, health);
    set({
      n, m: axes.length, axis: axes.map((axis) => AXES.indexOf(axis)), gamma, ...now, acceleration,
      deceleration, unit: vehicle.forward[0], segments: curve.length, segment: curve, elapsed,
      policy: POLICIES[policy], airmode,
      slack, weight, preferred, weighted: weight.some((w) => w !== 1) || preferred.some((f) => f !== 0),
      impaired: health.map((h) => h < 1),
    });
    exports.audit();
    const kept = get('axis', c.m[0]).map((place) => AXES[place]),
      rows = kept.map((axis) => axes.indexOf(axis));
    rowOf = axes.map((axis) => kept.indexOf(axis));
    const groups = (policy === 'prioritize' ? order : [kept.join(' ')])
      .map((group) => group.split(' ').filter((axis) => kept.includes(axis))).filter((group) => group.length);
    const keeps = (axis) => deviation === 'prevent' && axis !== 'thrust';
    const half = (lower, upper) => (row) => dot(row, upper.map((most, i) => (most + lower[i]) / 2));
    const center = gamma.map(half(now.lower, now.upper));
    const extent = gamma.map((row) => half(now.lower.map((f) => -f), now.upper)(row.map(Math.abs)) || 1);
    const kernelRows = (list) => rows.map((k) => list[k]);
    set({
      order: groups.flat().map((axis) => kept.indexOf(axis)),
      group: groups.flatMap((group, i) => group.map(() => i)),
      keep_sense: kept.map((axis) => !groups[0].includes(axis) && keeps(axis)),
      thrust: kept.indexOf('thrust'),
      hover: kernelRows(reference),
      leveling: vehicle.levels && kept.includes('force_x') && kept.includes('force_y'),
    });
    const fault = exports.prepare_vehicle(), left = fault ? [] : kept;
    const byAxis = (values, from = 0) => rowOf.map((row) => row < 0 ? 0 : values[from + row]);
    const middle = byAxis(c.middle), facets = count(Math.max(0, c.facets[0]), (f) => {
      const normal = byAxis(c.normal, f * AXES.length);
      return {normal, middle: dot(normal, middle), width: c.width[f]};
    });
    return {fault, kept: left, lost: axes.filter((axis) => !left.includes(axis)), center, extent, facets,
      lower: get('lower', n), upper: get('upper', n)};
  }

  function allocate({n, gamma}, demand, method = 'exact') {
    rowOf.forEach((row, k) => row >= 0 && c.demand.fill(demand[k], row, row + 1));
    set({asked: demand});
    exports.allocate(METHODS.indexOf(method));
    const thrusts = get('thrusts', n);
    return {
      status: STATUS[c.status[0]], level: c.level[0], margin: c.margin[0], thrusts, speeds: get('speeds', n),
      wrench: gamma.map((row) => dot(row, thrusts)), saturation: get('saturation', n), limit: get('limit', n),
      served: rowOf.map((row) => c.served[row]), cause: get('cause', n),
      // 1: alone, 2: only together
      airmodeBlocks: rowOf.map((row) => c.airmode_blocks[row]),
      blocks: rowOf.map((row) => count(n, (i) => c.blocks[row * ROTORS + i])),
    };
  }

  /** Begin a flight of a vehicle with a body, see `bodyOf`. */
  function begin(vehicle, settings, goal, state, step) {
    const {body, ratesAssumed, speedMin, speedMax, n} = vehicle;
    prepare(vehicle, settings.health, settings);
    const idle = speedMin.map((least, i) => Math.min(Math.max(least, 0), speedMax[i]));
    set({...body, goal, state, time_step: step, has_rates: !ratesAssumed, failed: Array(n).fill(0), command: idle});
  }
  const fail = (rotor) => { c.failed[rotor] = 1; };
  const fly = (method, steps, started) => exports.fly(METHODS.indexOf(method), steps, started);
  const flown = (n) => ({
    state: get('state', 13), speeds: get('command', n), thrusts: get('thrusts', n), saturation: get('saturation', n),
    status: STATUS[c.status[0]], margin: c.margin[0],
  });
  return {prepare, allocate, begin, fail, fly, flown};
}
