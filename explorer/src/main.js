// The page: the case that it shows, its controls, and the address that carries the case.
import {Vector3} from 'three';
import {loadKernel} from './kernel.js';
import {drawSet, drawVehicle, kind, UNITS} from './pictures.js';
import {Stage} from './stage.js';
import {bounds, groups, readCase, readVehicle} from './vehicle.js';
import {digits, explain, METHODS, short} from './words.js';

const REACH = 1.6; // of the demand, in halves of the ranges of the attainable set
const SLOW = 40, REST = 150; // [ms]; a set that takes longer is drawn when the drag rests
const UNPREPARED = ['demand', 'beside', 'shown']; // what the kernel need not be prepared for
const ORDERS = ['roll pitch,thrust,yaw', 'thrust,roll pitch,yaw', 'roll pitch yaw,thrust', 'thrust,roll pitch yaw', 'roll pitch thrust yaw'];
const KEYS = {ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowDown: [1, -1], ArrowUp: [1, 1], PageDown: [2, -1], PageUp: [2, 1]};
/** By name the settings with one control, and what its value makes of them. */
const CONTROLS = {
  policy: (value) => value, deviation: (value) => value, beside: (value) => value, order: (value) => value.split(','),
  elapsed: Number, airmode: (value) => [Number(value), Number(value), ...shown.state.airmode.slice(2)],
};

const $ = (id) => document.getElementById(id);
const make = (tag, fields, ...below) => {
  const node = Object.assign(document.createElement(tag), fields);
  node.append(...below);
  return node;
};
const kernel = await loadKernel();
const stages = {body: new Stage($('body'), [-3, -3.45, 3.35]), set: new Stage($('set'), [2.6, -4.6, 2.6])};
const started = Object.entries(JSON.parse($('start').textContent))[0];
let shown; // the case: vehicle, name, state (what the controls set) and the attainable set
let own; // the YAML that was opened last
let polygons = {}; // of the sets that are drawn, with the time that they took and what they are for
window.explorer = {change, kernel, readVehicle, bounds, show, times: [], get state() { return {name: shown.name, ...shown.state}; },
  get sets() { return polygons.sets; }};

/** Do something that a wrong file or address can make fail; say why in one line. */
function attempt(what, job) {
  $('fault').textContent = '';
  try {
    job();
  } catch (error) {
    $('fault').textContent = `${what}: ${error.message}`;
  }
}

/** Show a vehicle, given as YAML; the shipped ones have a name. What is wrong leaves the page as it is. */
function show(yaml, name = '', given = {}) {
  const vehicle = readVehicle(yaml), state = readCase(vehicle, given, Object.keys(METHODS));
  if (prepare(vehicle, {...state, health: vehicle.health}).fault) {
    if (shown) prepare(shown.vehicle, shown.state);
    throw new Error('the rotors cannot control the axes independently');
  }
  shown = {vehicle, name, state, set: prepare(vehicle, state)};
  polygons = {};
  if (!name) own = yaml;
  build();
  update();
}

/** Show the same vehicle with other values of the state. */
function change(given) {
  const {vehicle, name} = shown, state = readCase(vehicle, {...shown.state, ...given}, Object.keys(METHODS));
  const unprepared = Object.keys(given).every((key) => UNPREPARED.includes(key));
  if (!unprepared) polygons.key = undefined;
  shown = {vehicle, name, state, set: unprepared ? shown.set : prepare(vehicle, state)};
  update();
}

const prepare = (vehicle, state) => kernel.prepare(vehicle, state.health, state);
const fail = (i) => change({health: shown.state.health.with(i, shown.state.health[i] > 0 ? 0 : 1)});

/** Build the controls of a vehicle. */
function build() {
  const {vehicle, name, state, set} = shown, {axes, n} = vehicle, option = $('vehicle').lastChild;
  Object.assign(option, {textContent: own ? readVehicle(own).name : 'your YAML (open or drop)', disabled: !own});
  $('vehicle').value = name;
  const orders = [state.order, vehicle.order, ...ORDERS.map((words) => groups('order', [...words.split(','), 'force_x force_y'], axes))];
  $('order').replaceChildren(...[...new Set(orders.map(String))].map((order) => make('option', {
    value: order, textContent: order.replaceAll(',', ' before ')})));
  $('demand').replaceChildren(...axes.map((axis, k) => {
    const [min, max] = [-REACH, REACH].map((x) => set.center[k] + x * set.extent[k]);
    const moved = ({target}) => move({[k]: target.value});
    return make('div', {}, make('label', {textContent: axis, htmlFor: `demand-${k}`}),
      make('input', {type: 'range', id: `demand-${k}`, min, max, step: (max - min) / 800, oninput: moved}),
      make('input', {type: 'number', step: 'any', ariaLabel: axis, onchange: moved}),
      make('small', {textContent: UNITS[axis]}), make('output'));
  }));
  $('rotors').replaceChildren(...Array.from({length: n}, (_, i) => make('div', {},
    make('button', {textContent: i + 1, title: `Fail or repair rotor ${i + 1}`, onclick: () => fail(i)}),
    make('input', {type: 'range', min: 0, max: 1, step: 0.01, ariaLabel: `health of rotor ${i + 1}`,
      oninput: ({target}) => change({health: shown.state.health.with(i, Number(target.value))})}),
    make('output'), document.createElementNS('http://www.w3.org/2000/svg', 'svg'), make('output'))));
  const isForce = (axis) => axis.startsWith('force') || axis === 'thrust';
  const pairs = axes.flatMap((a, i) => axes.slice(i + 1).map((b) => [a, b]));
  const views = [...(axes.length > 3 ? [axes.slice(-3)] : []), ...pairs.filter(([a, b]) => axes.length < 5 || isForce(a) === isForce(b))];
  $('shown').replaceChildren(...views.map((view) => make('button', {
    textContent: view.length > 2 ? 'all torques' : view.join('–'), value: view, onclick: () => change({shown: view})})));
}

/** Return the axes that are drawn, without those that are lost. */
function viewed() {
  const {vehicle, state, set} = shown;
  const left = state.shown.filter((axis) => set.kept.includes(axis)).map((axis) => vehicle.axes.indexOf(axis));
  return left.length > 1 ? left : [0, 1];
}

/** Answer the demand, and show it. */
function update() {
  const {vehicle, state, set} = shown, {axes} = vehicle, {demand} = state, began = performance.now();
  const beside = state.beside && kernel.allocate(vehicle, demand, state.beside);
  const answer = kernel.allocate(vehicle, demand);
  const hover = state.health.some((h) => h < 1e-9) && kernel.allocate(vehicle, vehicle.reference);
  if (set.fault) answer.status = 'LOST';
  const view = viewed(), others = axes.some((axis, k) => !view.includes(k) && set.kept.includes(axis) && Math.abs(demand[k] - answer.wrench[k]) > 1e-9);
  const sets = sections([demand, ...(others ? [answer.wrench] : [])], view);
  explorer.times.push(performance.now() - began);
  drawVehicle(stages.body, vehicle, state.health, set, answer);
  look(view.length < 3);
  drawSet(stages.set, {axes, shown: view, set, sets, demand, served: answer.wrench, beside: beside?.wrench, start: vehicle.reference});
  const fixed = axes.flatMap((axis, k) => view.includes(k) || (axes.length > 4 && !demand[k]) ? [] : [`${axis} ${digits(demand[k])} ${UNITS[axis]}`]);
  const names = view.length > 2 ? 'torques' : view.map((k) => axes[k]).join(' and ');
  $('set-title').textContent = `Attainable ${names}${fixed.length ? ` at ${fixed.join(', ')}` : ''}`;
  $('moved').hidden = !others;
  controls(answer, beside);
  $('status').textContent = answer.status;
  $('status').className = answer.status === 'EXACT' ? '' : 'short';
  $('words').replaceChildren(...explain(shown, answer, beside, hover).map((line) => make('li', {textContent: line})));
  history.replaceState(null, '', `#${address()}`);
}

/** Return the attainable sets through some wrenches; slow ones, when the drag rests. */
function sections(bases, view) {
  const key = JSON.stringify([view, bases.map((base) => base.filter((_, k) => !view.includes(k)))]);
  const waits = polygons.time > SLOW && key !== polygons.key && performance.now() < polygons.moved + REST;
  clearTimeout(polygons.timer);
  polygons.moved = performance.now();
  $('waits').hidden = !waits;
  if (waits) {
    polygons.timer = setTimeout(update, REST);
    return [];
  }
  if (key !== polygons.key) {
    polygons.sets = bases.map((base) => kernel.section(base, view) ?? []);
    Object.assign(polygons, {key, time: performance.now() - polygons.moved});
  }
  return polygons.sets;
}

/** Look at a section from above, and at three axes from where one looked before. */
function look(flat) {
  const stage = stages.set;
  if (stage.flat === flat) return;
  if (flat) stage.eye = stage.camera.position.clone();
  stage.flat = flat;
  if (stage.controls) stage.controls.enabled = !flat;
  stage.camera.up.set(0, flat ? 1 : 0, flat ? 0 : 1);
  stage.camera.position.copy(flat ? new Vector3(0, 0, 5) : stage.eye ?? stage.camera.position);
  stage.camera.lookAt(0, 0, 0);
}

/** Show the values of the controls, and what each rotor does. */
function controls(answer, beside) {
  const {vehicle, state, set} = shown;
  [...$('demand').children].forEach((row, k) => {
    const [, slider, number, , served] = row.children, miss = short(set.extent[k], state.demand[k], answer.wrench[k]);
    served.textContent = miss ? digits(answer.wrench[k]) : '✓';
    served.className = miss ? 'short' : '';
    slider.value = state.demand[k];
    if (document.activeElement !== number) number.value = +state.demand[k].toPrecision(6);
  });
  const most = vehicle.speedMax.map((s, i) => vehicle.forward[i] * s * s);
  const top = Math.max(...set.upper, ...most), bottom = Math.min(0, ...set.lower), x = (thrust) => 100 * (thrust - bottom) / (top - bottom);
  const rect = (from, to, y, height, fill) => `<rect x="${x(Math.min(from, to))}" width="${
    Math.max(0.8, Math.abs(x(to) - x(from)))}" y="${y}" height="${height}" fill="var(--${fill})"/>`;
  [...$('rotors').children].forEach((row, i) => {
    const [button, slider, share, bar, result] = row.children, name = kind(state.health[i], answer.saturation[i]);
    button.setAttribute('aria-pressed', state.health[i] < 1e-9);
    slider.value = state.health[i];
    share.textContent = `${Math.round(100 * state.health[i])} %`;
    result.textContent = `${digits(answer.thrusts[i])} N, ${Math.round(answer.speeds[i])} rad/s`;
    bar.setAttribute('viewBox', '0 0 100 20');
    bar.setAttribute('preserveAspectRatio', 'none');
    bar.innerHTML = rect(set.lower[i], set.upper[i], 3, 14, 'line') + rect(0, answer.thrusts[i], 6, 8, name) +
      (beside ? rect(beside.thrusts[i], beside.thrusts[i], 1, 18, 'beside') : '');
  });
  for (const name of Object.keys(CONTROLS)) $(name).value = name === 'airmode' ? state.airmode[0] : state[name];
  $('airmode-value').textContent = state.airmode[0] < 1 ? `${Math.round(100 * state.airmode[0])} % of its range` : 'no limit';
  $('elapsed-value').textContent = state.elapsed ? `${Math.round(1e3 * state.elapsed)} ms` : 'any';
  $('order').disabled = $('deviation').disabled = state.policy !== 'prioritize';
  for (const button of $('shown').children) button.setAttribute('aria-pressed', button.value === String(state.shown));
  $('beside-legend').hidden = !beside;
  $('beside-legend').lastElementChild.textContent = METHODS[state.beside];
}

function address() {
  const {vehicle, name, state} = shown;
  return new URLSearchParams({...(name ? {vehicle: name} : {yaml: vehicle.source}), ...state}).toString();
}

/** Show the case of the address; without one, the vehicle that the page was written for. */
function fromAddress() {
  const {vehicle, yaml, ...words} = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  const lists = ['demand', 'health', 'airmode', 'order', 'shown'];
  const given = Object.fromEntries(Object.entries(words).map(([name, word]) => [name, lists.includes(name) ? word.split(',') : word]));
  if (yaml !== undefined) return show(yaml, '', given);
  if (vehicle === undefined && started) return show(started[1], nameOf(started[1]), given);
  return show(shipped(vehicle ?? 'hexarotor'), vehicle ?? 'hexarotor', given);
}

const nameOf = (yaml) => Object.keys(VEHICLES).find((name) => VEHICLES[name] === yaml) ?? '';

function shipped(name) {
  if (!Object.hasOwn(VEHICLES, name)) throw new Error(`vehicle: expected one of ${Object.keys(VEHICLES).join(', ')}, got ${name}`);
  return VEHICLES[name];
}

async function open(file) {
  if (!file) return;
  const yaml = await file.text();
  attempt(file.name, () => show(yaml));
}

/** Move the demand of some axes, to digits that suit their ranges. */
function move(values) {
  const {state, set} = shown, demand = [...state.demand];
  for (const [k, value] of Object.entries(values)) {
    const places = 4 - Math.floor(Math.log10(set.extent[k]));
    demand[k] = value === '' ? demand[k] : +Number(value).toFixed(Math.max(0, Math.min(20, places)));
  }
  attempt('demand', () => change({demand}));
}

/** Move the demand to a spot of the picture, in halves of the ranges. */
function moveTo(spot) {
  const {center, extent} = shown.set;
  move(Object.fromEntries(viewed().map((k, i) => [k, center[k] + extent[k] * Math.max(-REACH, Math.min(REACH, spot[i]))])));
}

function drag(event) {
  const stage = stages.set, at = stage.flat ? stage.under(event, new Vector3(), new Vector3(0, 0, 1)) : stage.under(event, stage.demand);
  if (at) moveTo(at.toArray());
}

function step({key, shiftKey}) {
  const {state, set} = shown, [place, sense] = KEYS[key] ?? [];
  const spot = viewed().map((k) => (state.demand[k] - set.center[k]) / set.extent[k]);
  if (!(place < spot.length)) return;
  spot[place] += sense * (shiftKey ? 0.1 : 0.01);
  moveTo(spot);
}

async function copy() {
  const done = await navigator.clipboard?.writeText(location.href).then(() => true, () => false);
  $('link').textContent = done ? 'Copied' : 'Copy it from the address bar';
  setTimeout(() => { $('link').textContent = 'Copy link'; }, 2000);
}

$('vehicle').append(...Object.keys(VEHICLES).map((name) => make('option', {textContent: name, value: name})), make('option', {value: ''}));
$('beside').append(...Object.entries(METHODS).map(([value, textContent]) => make('option', {value, textContent})));
for (const [name, read] of Object.entries(CONTROLS)) $(name).oninput = ({target}) => change({[name]: read(target.value)});
$('vehicle').onchange = ({target}) => attempt(target.value, () => show(VEHICLES[target.value] ?? own, target.value));
$('file').onchange = ({target}) => open(target.files[0]).finally(() => { target.value = ''; });
$('open').onclick = () => $('file').click();
$('hover').onclick = () => {
  const {reference, health, airmode} = shown.vehicle;
  change({demand: reference, health, airmode, elapsed: 0});
};
$('link').onclick = copy;
window.onhashchange = () => attempt('address', fromAddress);
for (const type of ['dragover', 'dragleave', 'drop']) {
  window.addEventListener(type, (event) => {
    event.preventDefault();
    document.body.classList.toggle('drop', type === 'dragover');
    if (type === 'drop') open(event.dataTransfer.files[0]);
  });
}
matchMedia('(prefers-color-scheme: dark)').onchange = update;

// A click on a rotor fails it; a drag turns the picture.
let pressed;
$('body').addEventListener('pointerdown', (event) => { pressed = [event.clientX, event.clientY]; }, true);
$('body').addEventListener('pointerup', (event) => {
  const still = Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 5;
  const hit = still && stages.body.ray(event).intersectObjects(stages.body.content.children).find(({object}) => 'rotor' in object.userData);
  if (hit) fail(hit.object.userData.rotor);
});

let dragged = false;
const free = (orbits) => { if (stages.set.controls) stages.set.controls.enabled = orbits; };
$('set').addEventListener('pointerdown', (event) => {
  const {left, top} = $('set').getBoundingClientRect(), {x, y} = stages.set.project(stages.set.demand);
  dragged = stages.set.flat || Math.hypot(event.clientX - left - x, event.clientY - top - y) < 26;
  if (!dragged) return;
  free(false);
  $('set').setPointerCapture(event.pointerId);
  event.preventDefault();
  drag(event);
}, true);
$('set').addEventListener('pointermove', (event) => dragged && drag(event), true);
for (const type of ['pointerup', 'pointercancel']) {
  $('set').addEventListener(type, () => { dragged = false; free(!stages.set.flat); }, true);
}
$('set').addEventListener('keydown', step);

attempt('address', fromAddress);
if (!shown) show(VEHICLES.hexarotor, 'hexarotor');
