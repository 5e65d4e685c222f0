// The page as a template: a case with its answer, and the controls that change it.
import {html, svg} from 'lit-html';
import {live} from 'lit-html/directives/live.js';
import {ACCELERATION, groups} from './vehicle.js';
import {digits, kind, METHODS, short, UNITS} from './words.js';

export const REACH = 1.6; // of the demand, in halves of the ranges of the attainable set
const POLICIES = {prioritize: 'serve axes by priority', scale: 'scale the demand', reject: 'reject it'};
const DEVIATIONS = {prevent: 'change thrust as far as needed', allow: 'let axes reverse'};
const ORDERS = ['roll pitch,thrust,yaw', 'thrust,roll pitch,yaw', 'roll pitch yaw,thrust', 'thrust,roll pitch yaw',
  'roll pitch thrust yaw'];

const select = (id, label, list, chosen, act, disabled = false) => html`<select id=${id} aria-label=${label}
  ?disabled=${disabled} @change=${({target}) => act(target.value)}>${Object.entries(list).map(([value, text]) => html`
    <option .value=${value} .selected=${live(value === chosen)} ?disabled=${!text}>${text || 'your YAML'}</option>`)}
  </select>`;
const slider = (label, [min, max, step], value, act) => html`<input type="range" aria-label=${label} min=${min}
  max=${max} step=${step} .value=${live(String(value))} @input=${({target}) => act(target.value)}>`;
const mark = (color) => html`<i class=${color}></i>`;

/** Return the page of a case; `act` has what its controls do. */
export function page({vehicle, name, state, set}, answer, beside, {words, view, moved, names}, act) {
  const {axes} = vehicle, {demand, health} = state, change = (name) => (value) => act.change({[name]: value});
  const others = axes.flatMap((axis, k) => view.includes(k) || (axes.length > 4 && !demand[k]) ? []
    : [`${axis} ${digits(demand[k])} ${UNITS[axis]}`]);
  const title = `Attainable ${view.length > 2 ? 'torques' : view.map((k) => axes[k]).join(' and ')}${
    others.length ? ` at ${others.join(', ')}` : ''}`;
  const assumed = vehicle.ratesAssumed ? `, at ${ACCELERATION} rad/s² (no rate in the file)` : '';
  return html`
    <header>
      <h1>Control allocation explorer</h1>
      <label>Vehicle ${select('vehicle', 'Vehicle', names, name, act.pick)}</label>
      <button id="open" @click=${act.browse}>Open YAML</button>
      <input id="file" type="file" accept=".yaml,.yml" aria-label="YAML of a vehicle" hidden @change=${act.choose}>
      <button id="hover" title="Demand hover with all rotors sound" @click=${act.reset}>Reset</button>
      <output id="fault" role="alert"></output>
    </header>
    <main><div id="pictures">
      <section aria-label="Vehicle">
        <h2>Vehicle</h2>
        <p class="hint"><b>Click a rotor to make it fail</b>, or to repair it.</p>
        <div class="view" id="body"></div>
        <p class="legend">Thrust (arrows): <span>${mark('free')}between its bounds</span> <span>${mark('max')}at its
          maximum</span> <span>${mark('min')}at its minimum</span> <span>${mark('lost')}failed rotor</span></p>
      </section>
      <section aria-label="Attainable set">
        <h2>${title}</h2>
        <p class="hint"><b>Drag the orange ring</b>: it is the demand.${
          view.length > 2 ? ' Elsewhere a drag turns the picture.' : ''}</p>
        <div class="view" id="set"></div>
        <div id="shown" class="row" role="group" aria-label="Axes shown">${views(axes).map((list) => html`
          <button value=${list} aria-pressed=${String(list) === String(state.shown)}
            @click=${() => act.change({shown: list})}>${list.length > 2 ? 'all torques' : list.join('–')}</button>`)}
        </div>
        <p class="legend"><span>${mark('demand')}demand</span>
          <span>${mark('served')}what the rotors produce (method exact)</span>
          <span id="moved" ?hidden=${!moved}>${mark('dashed')}attainable with what the other axes get</span>
          <span ?hidden=${!beside}>${mark('beside')}${METHODS[state.beside]}</span></p>
      </section>
      <section id="answer" aria-live="polite"><strong id="status" class=${answer.status === 'EXACT' ? '' : 'short'}>${
        answer.status}</strong><ul id="words">${words.map((line) => html`<li>${line}</li>`)}</ul></section>
      </div>
      <section id="panel" aria-label="Settings">
        <h2>Demand</h2>
        <div id="demand">${axes.map((axis, k) => demandRow(axis, k, set, demand, answer.wrench, act))}</div>
        <h2>Rotors</h2>
        <p class="hint">Press a number to make the rotor fail or to repair it. The slider weakens it.</p>
        <div id="rotors">${health.map((_, i) => rotorRow(i, vehicle, health, set, answer, beside, act))}</div>
        <h2>If the demand is not attainable</h2>
        <div class="row">
          ${select('policy', 'Policy', POLICIES, state.policy, change('policy'))}
          ${select('order', 'Priorities', orders(vehicle, state), String(state.order),
            (value) => act.change({order: value.split(',')}), state.policy !== 'prioritize')}
          ${select('deviation', 'Thrust deviation', DEVIATIONS, state.deviation, change('deviation'),
            state.policy !== 'prioritize')}
        </div>
        <div class="limits">
          airmode limit ${slider('airmode limit', [0, 1, 0.01], state.airmode[0],
            (value) => act.change({airmode: [value, value]}))}
          <output>${state.airmode[0] < 1 ? `${Math.round(100 * state.airmode[0])} % of its range` : 'no limit'}</output>
          time since hover ${slider('time since hover', [0, 0.3, 0.005], state.elapsed, change('elapsed'))}
          <output>${state.elapsed ? `${Math.round(1e3 * state.elapsed)} ms${assumed}` : 'any'}</output>
        </div>
        <h2>Compare with another method</h2>
        <div class="row">${select('beside', 'Other method', METHODS, state.beside, change('beside'))}</div>
      </section>
    </main>`;
}

function demandRow(axis, k, {center, extent}, demand, wrench, act) {
  const [min, max] = [-REACH, REACH].map((x) => center[k] + x * extent[k]), move = (value) => act.move({[k]: value});
  const miss = short(extent[k], demand[k], wrench[k]);
  return html`<div><span>${axis}</span> ${slider(axis, [min, max, (max - min) / 800], demand[k], move)}
    <input type="number" step="any" aria-label=${axis} .value=${String(+demand[k].toPrecision(6))}
      @change=${({target}) => move(target.value)}>
    <small>${UNITS[axis]}</small>
    <output class=${miss ? 'short' : ''}>${miss ? digits(wrench[k]) : '✓'}</output></div>`;
}

function rotorRow(i, {speedMax, forward}, health, {lower, upper}, answer, beside, act) {
  const top = Math.max(...upper, ...speedMax.map((s, j) => forward[j] * s * s)), bottom = Math.min(0, ...lower);
  const x = (thrust) => 100 * (thrust - bottom) / (top - bottom);
  const rect = (from, to, y, height, color) => svg`<rect x=${x(Math.min(from, to))} y=${y} height=${height}
    width=${Math.max(0.8, Math.abs(x(to) - x(from)))} fill=${`var(--${color})`}/>`;
  const thrust = answer.thrusts[i], other = beside?.thrusts[i];
  return html`<div>
    <button aria-pressed=${health[i] < 1e-9} title="Rotor ${i + 1} fails, or is repaired"
      @click=${() => act.fail(i)}>${i + 1}</button>
    ${slider(`health of rotor ${i + 1}`, [0, 1, 0.01], health[i],
      (value) => act.change({health: health.with(i, value)}))}
    <output>${Math.round(100 * health[i])} %</output>
    <svg viewBox="0 0 100 20" preserveAspectRatio="none">${rect(lower[i], upper[i], 3, 14, 'line')}
      ${rect(0, thrust, 6, 8, kind(health[i], answer.saturation[i]))}
      ${beside ? rect(other, other, 1, 18, 'beside') : ''}</svg>
    <output>${digits(thrust)} N, ${Math.round(answer.speeds[i])} rad/s</output></div>`;
}

/** Return the lists of axes that can be drawn together. */
function views(axes) {
  const isForce = (axis) => axis.startsWith('force') || axis === 'thrust';
  const pairs = axes.flatMap((a, i) => axes.slice(i + 1).map((b) => [a, b]));
  return [...(axes.length > 3 ? [axes.slice(-3)] : []),
    ...pairs.filter(([a, b]) => axes.length < 5 || isForce(a) === isForce(b))];
}

function orders(vehicle, state) {
  const common = ORDERS.map((words) => groups('order', [...words.split(','), 'force_x force_y'], vehicle.axes));
  return Object.fromEntries([state.order, vehicle.order, ...common].map((order) => [order, order.join(' before ')]));
}
