// The page as a template: a case with its answer, and the controls that change it.
import {html, svg} from 'lit-html';
import {live} from 'lit-html/directives/live.js';
import {EXPORTS} from './exports.js';
import {flightSection} from './fly.js';
import {plane} from './plane.js';
import {STORIES} from './stories.js';
import {ACCELERATION, groups} from './vehicle.js';
import {digits, GLOSSARY, kind, METHODS, short, UNITS} from './words.js';

export const REACH = 1.6; // of the demand, in halves of the ranges of the attainable set
const POLICIES = {prioritize: 'serve axes by priority', scale: 'scale the demand', reject: 'reject it'};
const DEVIATIONS = {prevent: 'change thrust as far as needed', allow: 'let axes reverse'};
const ORDERS = ['roll pitch,thrust,yaw', 'thrust,roll pitch,yaw', 'roll pitch yaw,thrust', 'thrust,roll pitch yaw',
  'roll pitch thrust yaw'];

const select = (id, label, list, chosen, act, disabled = false) => html`<select id=${id} aria-label=${label}
  ?disabled=${disabled} @change=${({target}) => act(target.value)}>${Object.entries(list).map(([value, text]) => html`
    <option .value=${value} .selected=${live(value === chosen)} ?disabled=${!text}>${text || 'your file'}</option>`)}
  </select>`;
const slider = (label, [min, max, step], value, act, disabled = false) => html`<input type="range" aria-label=${label}
  min=${min} max=${max} step=${step} .value=${live(String(value))} ?disabled=${disabled}
  @input=${({target}) => act(target.value)}>`;
const mark = (color) => html`<i class=${color}></i>`;

/** Return the page of a case; `act` has what its controls do. */
export function page(shown, answer, beside, extras, act) {
  const {vehicle, name, state, set} = shown, {names, words, sentence, because, story, view, drawing, moved, weaker, flights, webgl} = extras;
  const {axes} = vehicle, {demand, health} = state, change = (key) => (value) => act.change({[key]: value});
  const others = axes.flatMap((axis, k) => view.includes(k) || (axis !== 'thrust' && !demand[k]) ? []
    : [`${axis} ${digits(demand[k])} ${UNITS[axis]}`]);
  const title = `Attainable ${view.length > 2 ? 'torques' : view.map((k) => axes[k]).join(' and ')}${
    others.length ? ` at ${others.join(', ')}` : ''}`;
  const assumed = vehicle.ratesAssumed ? `, at ${ACCELERATION} rad/s² (no rate in the file)` : '';
  const byPriority = state.policy === 'prioritize';
  return html`
    <header>
      <h1>Control allocation explorer</h1>
      <label>Vehicle ${select('vehicle', 'Vehicle', names, name, act.pick)}</label>
      <button id="open" title="A parameter file of ca_ros (YAML), or PX4's parameters" @click=${act.browse}>Open file</button>
      <input id="file" type="file" aria-label="File of a vehicle" hidden @change=${act.choose}>
      <select id="export" aria-label="Export" @change=${({target}) => act.save(target)}>
        <option value="">Export …</option>
        ${Object.entries(EXPORTS).map(([key, {label}]) => html`<option value=${key}>${label}</option>`)}</select>
      <button id="copy" ?hidden=${!act.address} @click=${act.copy}>Copy link</button>
      <button id="hover" title="Demand hover with all rotors sound" @click=${act.reset}>Reset</button>
      <output id="fault" role="alert"></output>
    </header>
    ${extras.asked ? askedForm(extras.asked, act) : ''}
    <section id="story" aria-label="Stories">
      <p class="lead">A multirotor cannot produce every force and torque. See which it can, and what allocation methods
        make of a demand that is too much. The kernel of ca_ros computes all numbers here, in your browser.</p>
      <div class="row" role="group" aria-label="Stories">${Object.entries(STORIES).map(([key, {label}]) => html`
        <button value=${key} aria-pressed=${key === story} @click=${() => act.tell(key)}>${label}</button>`)}</div>
      <p id="sentence" aria-live="polite">${sentence}</p><p id="because" ?hidden=${!because}>${because}</p>
    </section>
    <main><div id="pictures">
      <section aria-label="Vehicle" id="bodycard">
        <h2>Vehicle</h2>
        <p class="hint"><b>Click a rotor to make it fail</b>, or to repair it.</p>
        <div class="view" id="body" ?hidden=${!webgl}></div>
        ${webgl ? '' : html`<p id="nowebgl">This browser has no WebGL, so there are no pictures in three dimensions: the
          sections of the set are beside, and the rotors in the list.</p>`}
        <p class="legend">Thrust (arrows): <span>${mark('free')}between its bounds</span> <span>${mark('max')}at its
          maximum</span> <span>${mark('min')}at its minimum</span> <span>${mark('lost')}failed rotor</span></p>
      </section>
      <section aria-label="Attainable set" id="setcard">
        <h2>${title} <strong id="status" class=${answer.status === 'EXACT' ? '' : 'short'}>${answer.status}</strong></h2>
        <p class="hint"><b>Drag the orange ring</b>: it is the demand.${
          view.length > 2 && webgl ? ' It moves in the plane of roll and pitch, with Shift along yaw. Elsewhere a drag turns the picture.' : ''}</p>
        <div class="frame"><div class="view" id="set" ?hidden=${!webgl || view.length < 3}></div>
        <div class="view" id="section" ?hidden=${webgl && view.length > 2}>${
          webgl && view.length > 2 ? '' : plane(drawing, extras.zoom, act)}</div>
          <div id="zoom"><button aria-label="Zoom in" @click=${() => act.zoom(1.25)}>+</button>
          <button aria-label="Zoom out" @click=${() => act.zoom(0.8)}>−</button></div></div>
        <div id="shown" class="row" role="group" aria-label="Axes shown">${views(axes).map((list) => html`
          <button value=${list} aria-pressed=${String(list) === String(state.shown)}
            @click=${() => act.change({shown: list})}>${list.length > 2 ? 'all torques' : list.join('–')}</button>`)}
        </div>
        <p class="legend"><span>${mark('demand')}demand</span>
          <span>${mark('served')}what the rotors produce with exact</span>
          <span ?hidden=${!beside}>${mark('beside')}${METHODS[state.beside]}</span>
          <span id="whole" ?hidden=${!weaker}>${mark('thin')}with all rotors</span>
          <span id="moved" ?hidden=${!moved}>${mark('dashed')}attainable with what the other axes get</span></p>
      </section>
      <section id="answer" aria-live="polite"><ul id="words">${words.map((line) => html`<li>${line}</li>`)}</ul></section>
      </div>
      <section id="panel" aria-label="Settings">
        <h2>Demand</h2>
        <div id="demand">${axes.map((axis, k) => demandRow(axis, k, set, demand, answer.wrench, act))}</div>
        <h2>Rotors</h2>
        <p class="hint">Press a number to make the rotor fail or to repair it. The slider weakens it.</p>
        <div id="rotors">${health.map((_, i) => rotorRow(i, vehicle, health, set, answer, beside, act))}</div>
        <h2>Compare with another method</h2>
        <div class="row">${select('beside', 'Other method', METHODS, state.beside, change('beside'))}</div>
        <h2>If the demand is not attainable</h2>
        <div class="row">
          ${select('policy', 'Policy', POLICIES, state.policy, change('policy'))}
          ${select('order', 'Priorities', orders(vehicle, state), String(state.order),
            (value) => act.change({order: value.split(',')}), !byPriority)}
          ${select('deviation', 'Thrust deviation', DEVIATIONS, state.deviation, change('deviation'), !byPriority)}
        </div>
        <div class="limits">
          airmode limit ${slider('airmode limit', [0, 1, 0.01], state.airmode[0],
            (value) => act.change({airmode: [value, value]}), !byPriority)}
          <output>${state.airmode[0] < 1 ? `${Math.round(100 * state.airmode[0])} % of its range` : 'no limit'}</output>
          reachable from hover within ${slider('time since hover', [0, 0.3, 0.005], state.elapsed, change('elapsed'))}
          <output>${state.elapsed ? `${Math.round(1e3 * state.elapsed)} ms${assumed}` : 'any time'}</output>
        </div>
      </section>
    </main>
    ${flightSection(flights, act)}
    <section id="glossary" aria-label="Glossary"><h2>Words</h2>
      <dl>${Object.entries(GLOSSARY).map(([word, meaning]) => html`<div><dt>${word}</dt><dd>${meaning}</dd></div>`)}</dl>
      <p>${act.pages ? html`More: <a href=${act.pages}>the pages of ca_ros</a>.` : html`More: README and the folder
        <code>docs/</code> of ca_ros: <code>docs/exact.md</code> has the method, <code>docs/priorities.md</code> what
        happens outside the set, <code>docs/comparison.md</code> other methods, some of which recover from as much.`}</p>
    </section>`;
}

/** Ask what PX4's parameters do not have. */
function askedForm({name, fields}, act) {
  return html`<form id="asked" @submit=${act.answer}>
    <p>${name} has the geometry of a vehicle for PX4, which knows neither its mass nor its thrusts:</p>
    ${fields.map(({key, label, value}) => html`<label>${label} <input name=${key} type="number" step="any" required
      .value=${String(value)}></label>`)}
    <button class="main">Show it</button></form>`;
}

function demandRow(axis, k, {center, extent, kept}, demand, wrench, act) {
  const [min, max] = [-REACH, REACH].map((x) => center[k] + x * extent[k]), move = (value) => act.move({[k]: value});
  const lost = !kept.includes(axis), miss = !lost && short(extent[k], demand[k], wrench[k]);
  return html`<div><span>${axis}</span> ${slider(axis, [min, max, (max - min) / 800], demand[k], move)}
    <input type="number" step="any" aria-label=${axis} .value=${String(+demand[k].toPrecision(6))}
      @change=${({target}) => move(target.value)}>
    <small>${UNITS[axis]}</small>
    <output class=${miss || lost ? 'short' : ''}>${lost ? 'lost' : miss ? digits(wrench[k]) : '✓'}</output></div>`;
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
