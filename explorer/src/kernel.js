// The kernel in WebAssembly: one vehicle at a time.
import wasm from 'kernel.wasm';
import {AXES, bounds} from './vehicle.js';

const ROTORS = 32, INTS = ['rotors', 'axes', 'axis', 'policy', 'order', 'group', 'deviation', 'kept', 'facets', 'status',
  'saturation', 'limit', 'corners', 'impaired', 'blocked', 'airmode_blocks', 'cause', 'segments'];
const POLICIES = {prioritize: 1, scale: 2, reject: 4}, DEVIATIONS = ['prevent', 'avoid', 'allow'];
export const STATUS = ['EXACT', 'PRIORITIZED', 'SCALED', 'INEXACT', 'REJECTED', 'INVALID', 'RATE_LIMITED'];
export const METHODS = {exact: 0, pseudo_inverse: 1, fixed_pseudo_inverse: 2};

export async function loadKernel() {
  const {instance} = await WebAssembly.instantiate(wasm, {});
  const {exports} = instance, buffer = exports.memory.buffer;
  // Variables of C by name.
  const c = new Proxy({}, {get: (cache, name) => (cache[name] ??= new (INTS.includes(name) ? Int32Array : Float64Array)(
    buffer, exports[name].value))});

  /** Prepare a vehicle with rotor health; returns which axes are left, and their ranges. */
  function prepare(vehicle, health, {policy, order, deviation, airmode = [1, 1, 1, 1], elapsed = 0}) {
    const {n, axes} = vehicle, now = bounds(vehicle, health), groups = order.map((group) => group.split(' '));
    c.rotors[0] = n;
    c.axes[0] = axes.length;
    axes.forEach((axis, k) => {
      c.axis[k] = AXES.indexOf(axis);
      c.gamma.set(vehicle.gamma[k], k * ROTORS);
    });
    for (const [name, values] of Object.entries({
      lower: now.lower, upper: now.upper,
      weight: vehicle.weight, preferred: vehicle.preferred, forward: now.forward, reverse: now.reverse,
      speed_min: now.speedMin, speed_max: now.speedMax, reference: vehicle.reference, slack: [vehicle.slack],
      unit: [vehicle.forward[0]], segments: [vehicle.curve.length], levels: vehicle.curve.map((s) => s.level),
      segment: vehicle.curve.flatMap((s) => [s.start, ...s.abc]), airmode, elapsed: [elapsed], acceleration: vehicle.acceleration, deceleration: vehicle.deceleration,
      impaired: health.map((h) => Number(h < 1)), policy: [POLICIES[policy]], deviation: [DEVIATIONS.indexOf(deviation)],
      order: groups.flat().map((axis) => axes.indexOf(axis)), group: groups.flatMap((group, i) => group.map(() => i)),
    })) c[name].set(values);
    const fault = exports.prepare_vehicle();
    const kept = axes.filter((_, k) => c.kept[k]);
    return {
      fault, kept, lost: axes.filter((_, k) => !c.kept[k]), facets: 2 * c.facets[0],
      center: [...c.center.subarray(0, axes.length)], extent: [...c.extent.subarray(0, axes.length)], ...now,
      lower: [...c.lower.subarray(0, n)], upper: [...c.upper.subarray(0, n)],
    };
  }

  function allocate(vehicle, demand, method = 'exact') {
    c.demand.set(demand);
    exports.allocate(METHODS[method]);
    const list = (name, size) => [...c[name].subarray(0, size)];
    const {n} = vehicle, m = demand.length;
    return {
      status: STATUS[c.status[0]], level: c.level[0], margin: c.margin[0], thrusts: list('thrusts', n),
      speeds: list('speeds', n), wrench: list('wrench', m), saturation: list('saturation', n), limit: list('limit', n),
      served: list('served', m), cause: list('cause', n), airmodeBlocks: list('airmode_blocks', m),
      blocked: Array.from({length: m}, (_, k) => [...c.blocked.subarray(k * ROTORS, k * ROTORS + n)]),
    };
  }

  /** Polygons of the attainable set over two or three rows, the other axes at `base`. */
  function section(base, shown) {
    c.base.set(base);
    const count = exports.section(shown[0], shown[1], shown[2] ?? -1);
    if (count < 0) return null;
    const polygons = [];
    for (let f = 0, at = 0; f < count; at += c.corners[f++]) {
      polygons.push(Array.from({length: c.corners[f]}, (_, i) => [...c.points.subarray(3 * (at + i), 3 * (at + i) + 3)]));
    }
    return polygons;
  }
  return {prepare, allocate, section};
}
