// The flights of the page: two vehicles side by side, one behind exact, one behind another method.
import {html, svg} from 'lit-html';
import {live} from 'lit-html/directives/live.js';
import {Quaternion, Vector3} from 'three';
import {Flight, REST, STEP} from './flight.js';
import {Model} from './model.js';
import {Stage} from './stage.js';
import {digits, METHODS} from './words.js';

export const DURATION = 6; // [s]
const FRAME = 16; // steps between two samples of the lines
const OVER = [...REST.slice(0, 6), ...[-Math.sin(40 * Math.PI / 180), Math.cos(40 * Math.PI / 180), 0]
  .map((x) => x * Math.sin(75 * Math.PI / 180)), Math.cos(75 * Math.PI / 180), 0, 0, 0];

/** How a flight can begin: its state, its goal (x, y, z, heading), and rotors that fail, with the step. */
const STARTS = {
  over: {label: 'thrown: tilted by 150°', state: OVER, goal: [0, 0, 0, 0], failing: []},
  lost: {label: 'to a waypoint; rotor 1 fails after 1 s', state: REST, goal: [2, 1, 0, 0], failing: [[0, 1000]]},
  waypoint: {label: 'to a waypoint', state: REST, goal: [2, 1, 0, 0], failing: []},
};
const GRIP = 45; // how near to a rotor a click has to be [pixels]
const ARRIVED = 0.2; // distance from the goal that counts as recovered [m]
const LOWEST = -3.8, FLOOR = -4.5, TARGET = -1.75; // heights that are seen, of the grid, and of the middle of the picture, in arms

export class Flights {
  /** `kernels` are two that nothing else uses; `changed` is called when there is something new to show. */
  constructor(kernels, changed) {
    Object.assign(this, {kernels, changed, start: 'over', flights: [], time: 0, failed: []});
  }

  get running() {
    return this.frame !== undefined;
  }

  /** Take the case that is shown; a flight of another one ends. */
  take({vehicle, state}) {
    const {demand: _, shown: __, ...settings} = state, key = JSON.stringify([vehicle.source, settings]);
    if (key === this.key) return;
    this.key = key;
    Object.assign(this, {vehicle, settings, other: state.beside || 'pseudo_inverse'});
    this.reset();
  }

  choose(start) {
    this.start = start;
    this.reset();
    this.changed();
  }

  reset() {
    cancelAnimationFrame(this.frame);
    Object.assign(this, {frame: undefined, flights: [], time: 0, failed: []});
  }

  begin() {
    const {state, goal, failing} = STARTS[this.start];
    this.reset();
    // What fails on the way is sound before.
    const settings = {...this.settings, health: failing.length ? this.vehicle.health : this.settings.health};
    this.flights = ['exact', this.other].map((method, i) => ({
      flight: new Flight(this.kernels[i], this.vehicle, method, settings, goal, state), samples: [],
    }));
    let last;
    const tick = (now) => {
      const due = Math.min(250, Math.round((now - (last ?? now)) / 1e3 / STEP));
      last = now;
      this.advance(due);
      this.frame = this.time < DURATION ? requestAnimationFrame(tick) : undefined;
      this.changed();
    };
    this.frame = requestAnimationFrame(tick);
    this.changed();
  }

  /** Fly some steps, with the failures that are due. */
  advance(steps) {
    const all = Math.round(DURATION / STEP);
    for (let left = Math.min(steps, all - this.steps); left > 0;) {
      const {failing} = STARTS[this.start], next = failing.find(([, at]) => at > this.steps)?.[1] ?? Infinity;
      failing.forEach(([rotor, at]) => at === this.steps && this.fail(rotor));
      const part = Math.min(left, FRAME, next - this.steps);
      for (const one of this.flights) {
        one.now = one.flight.advance(part);
        one.samples.push({time: this.time + part * STEP, ...one.now});
      }
      this.time = (this.steps + part) * STEP;
      left -= part;
    }
  }

  get steps() {
    return Math.round(this.time / STEP);
  }

  /** Let a rotor fail in both flights. */
  fail(rotor) {
    if (!this.flights.length || this.failed.includes(rotor) || rotor >= this.vehicle.n) return;
    this.failed.push(rotor);
    this.flights.forEach(({flight}) => flight.fail(rotor));
  }

  /** Say how the flights went. */
  said() {
    if (!this.flights.length || this.running) return '';
    const {goal} = STARTS[this.start];
    return this.flights.map(({flight: {method}, now, samples}) => {
      const off = Math.hypot(...[0, 1, 2].map((k) => now.state[k] - goal[k]));
      const fallen = -Math.min(0, ...samples.map(({state}) => state[2]));
      const name = method === 'exact' ? 'exact' : `the ${METHODS[method]}`;
      return off < ARRIVED ? `${name} is ${digits(off)} m from the goal, and fell by ${digits(fallen)} m on the way`
        : `${name} is ${digits(off)} m away from the goal, ${digits(Math.max(0, goal[2] - now.state[2]))} m below it`;
    }).join('; ');
  }
}

/** Return the section of the page. */
export function flightSection(flights, act) {
  const {vehicle, other, start} = flights, said = flights.said(), fault = typeof vehicle.body === 'string' && vehicle.body;
  const names = ['exact', METHODS[other]];
  return html`<section id="flight" aria-label="Flight">
    <h2>Fly it: six seconds of closed loop</h2>
    <p class="hint" ?hidden=${!fault}>${fault}</p>
    <p class="hint" ?hidden=${fault}>The vehicle of this page, with your settings, behind two methods. <b>Click a rotor while it flies</b>:
      it fails in both, and the methods learn of it 0.1 s later. No wind, noise or lag of motors; steps of 1 ms.
      Where a clipped pseudo-inverse falls, weighted least squares and PX4's method with airmode may recover, too: see
      docs/comparison.md.</p>
    <div class="row" ?hidden=${fault}>
      <button id="fly" class="main" @click=${() => flights.begin()}>${flights.flights.length ? 'Fly again' : 'Fly'}</button>
      <select id="begin" aria-label="How it starts" @change=${({target}) => flights.choose(target.value)}>${
        Object.entries(STARTS).map(([value, {label}]) => html`<option .value=${value}
          .selected=${live(value === start)}>${label}</option>`)}</select>
      <output id="time">${flights.time.toFixed(1)} s</output>
    </div>
    <div id="flights" ?hidden=${fault}>
      ${names.map((name, i) => html`<figure><figcaption class=${i ? 'besides' : 'serveds'}>${name}</figcaption>
        <div class="view air" id=${`air${i}`}></div>
        <p class="state">${stateOf(flights.flights[i])}</p></figure>`)}
      <div id="lines">${charts(flights)}</div>
    </div>
    <p id="flown" aria-live="polite">${said ? `After ${DURATION} s: ${said}.` : ''}</p>
  </section>`;
}

const metres = (x) => `${(Math.round(10 * x) / 10 + 0).toFixed(1)} m`;

function stateOf(one) {
  if (!one?.now) return '';
  const {state, status} = one.now;
  return `height ${metres(state[2])}, ${status}${one.flight.fallen ? ', it tumbles' : ''}`;
}

/** Draw rotor speeds, margin and height over time. */
function charts(flights) {
  const [mine, others] = [0, 1].map((i) => flights.flights[i]?.samples ?? []);
  const {n, speedMax} = flights.vehicle, failed = flights.failed;
  const speeds = (samples, name) => chart(`rotor speeds, ${name} [rad/s]`, Array.from({length: n}, (_, i) => [
    failed.includes(i) ? 'lostline' : 'speedline', samples.map((s) => [s.time, s.speeds[i]])]), [0, Math.max(...speedMax)]);
  const both = (pick) => [['besideline', others.map((s) => [s.time, pick(s)])],
    ['servedline', mine.map((s) => [s.time, pick(s)])]];
  return [
    speeds(mine, 'exact'), speeds(others, METHODS[flights.other]),
    chart('margin of the demand [N, N m]', both((s) => s.margin), [-2, 1]),
    chart('height [m]', both((s) => s.state[2]), [-4, 2]),
  ];
}

function chart(title, lines, [low, high]) {
  const W = 300, H = 52, x = (t) => t / DURATION * W;
  const y = (v) => H - (Math.max(low, Math.min(high, v)) - low) / (high - low) * H;
  return html`<div class="chart"><span>${title}</span><svg viewBox="-34 -6 340 74" role="img" aria-label=${title}>
    <path class="axis" d="M0 0 V${H} H${W}" /> ${low < 0 ? svg`<path class="axis" d="M0 ${y(0)} H${W}" />` : ''}
    ${[low, ...(low < 0 ? [0] : []), high].map((v) => svg`<text class="tick" x="-4" y=${y(v) + 4}
      text-anchor="end">${v}</text>`)}
    ${[0, 2, 4, 6].map((t) => svg`<text class="tick" x=${x(t)} y=${H + 14} text-anchor=${t < DURATION ? 'middle' : 'end'}>${t} s</text>`)}
    ${lines.map(([name, samples]) => svg`<path class=${name} d=${samples.map(([t, v], i) =>
      `${i ? 'L' : 'M'}${x(t).toFixed(1)} ${y(v).toFixed(1)}`).join('')} />`)}</svg></div>`;
}

/** The two pictures of vehicles in the air. */
export class Air {
  constructor(elements, fail) {
    this.stages = elements.map((element, i) => {
      const stage = new Stage(element, [-7.2, -8.6, 1.8], [0, 0, TARGET]);
      stage.orbits(false);
      stage.eye = stage.camera.position.clone();
      element.addEventListener('pointerup', (event) => {
        const rotor = this.nearest(i, event);
        if (rotor >= 0) fail(rotor);
      });
      return stage;
    });
  }

  /** Return where the rotors of a vehicle are on the screen [pixels]. */
  spots(i) {
    const {left, top} = this.stages[i].element.getBoundingClientRect();
    return this.models[i].rotors.map(({disc}) => {
      const {x, y} = this.stages[i].project(disc.getWorldPosition(new Vector3()));
      return [left + x, top + y];
    });
  }

  /** Return the rotor that is nearest to the pointer, -1 if none is near: what flies is hard to hit. */
  nearest(i, {clientX, clientY}) {
    const gaps = this.spots(i).map(([x, y]) => Math.hypot(clientX - x, clientY - y)), least = Math.min(...gaps);
    return least < GRIP ? gaps.indexOf(least) : -1;
  }

  show(flights, scheme) {
    const {vehicle} = flights, key = vehicle.source + scheme;
    if (key !== this.key) this.build(vehicle);
    this.key = key;
    const {state: from, goal} = STARTS[flights.start], {size} = this.models[0], metre = 1 / size;
    this.stages.forEach((stage, i) => {
      const {now = {state: from, thrusts: Array(vehicle.n).fill(0), saturation: Array(vehicle.n).fill(0)}, flight} =
        flights.flights[i] ?? {}, {group} = this.models[i];
      const health = (flight?.health ?? flights.settings.health).map((h, j) => flights.failed.includes(j) ? 0 : h);
      this.models[i].show(health, now);
      const [x, y, z] = now.state.slice(0, 3).map((at) => at / size);
      // Who falls out of sight is shown at the edge, with the height.
      group.position.set(x, y, Math.max(z, LOWEST));
      stage.fallen.visible = z < LOWEST;
      stage.fallen.element.textContent = `↓ ${metres(now.state[2])}`;
      group.quaternion.copy(new Quaternion(...now.state.slice(6, 10)));
      // The eye follows sideways; who falls leaves the picture.
      stage.grid.position.set(x - x % metre, y - y % metre, FLOOR);
      stage.camera.position.set(stage.eye.x + x, stage.eye.y + y, stage.eye.z);
      stage.controls.target.set(x, y, TARGET);
      stage.controls.update();
      stage.goal.position.set(...goal.slice(0, 3).map((at) => at / size));
      stage.draw();
    });
  }

  build(vehicle) {
    this.models = this.stages.map((stage) => {
      stage.clear();
      const model = new Model(stage, vehicle, false), metre = 1 / model.size;
      const lines = [];
      for (let k = -4; k <= 4; k++) lines.push([k * metre, -4 * metre, 0, k * metre, 4 * metre, 0], [-4 * metre, k * metre, 0, 4 * metre, k * metre, 0]);
      stage.grid = stage.lines(lines, 'line', 1);
      stage.goal = stage.lines([[-0.3, 0, 0, 0.3, 0, 0], [0, -0.3, 0, 0, 0.3, 0], [0, 0, -0.3, 0, 0, 0.3]], 'demand', 2);
      stage.into(model.group, () => { stage.fallen = stage.label('', new Vector3(0, 0, 1.1), 'rotor'); });
      return model;
    });
  }
}
