// The case that the page shows, what changes it, and the address that carries it.
import {render} from 'lit-html';
import {Vector3} from 'three';
import {Flight} from './flight.js';
import {loadKernel} from './kernel.js';
import {page, REACH} from './page.js';
import {drawSet, drawVehicle} from './pictures.js';
import {section} from './section.js';
import {Stage} from './stage.js';
import {bounds, readCase, readVehicle} from './vehicle.js';
import {explain, METHODS} from './words.js';

const UNPREPARED = ['demand', 'beside', 'shown']; // what the kernel need not be prepared for

const $ = (id) => document.getElementById(id);
const kernel = await loadKernel();
const started = Object.entries(JSON.parse($('start').textContent))[0];
let shown; // the case: vehicle, name, state (what the controls set) and the attainable set
let own; // the vehicle that was opened last
let polygons = {}; // of the sets that are drawn, and what they are for
let stages; // the pictures
window.explorer = {change, kernel, loadKernel, Flight, readVehicle, bounds, show, times: [], get sets() { return polygons.sets; },
  get state() { return {name: shown.name, ...shown.state}; }};

/** Do something that a wrong file or address can make fail; say why in one line. */
function attempt(what, job) {
  let fault = '';
  try {
    job();
  } catch (error) {
    fault = `${what}: ${error.message}`;
  }
  if (!shown) show(VEHICLES.hexarotor, 'hexarotor');
  $('fault').textContent = fault;
}

const prepare = (vehicle, state) => kernel.prepare(vehicle, state.health, state);

/** Show a vehicle, given as YAML; the shipped ones have a name. What is wrong leaves the page as it is. */
function show(yaml, name = '', given = {}) {
  const vehicle = readVehicle(yaml), state = readCase(vehicle, given, Object.keys(METHODS));
  if (prepare(vehicle, {...state, health: vehicle.health}).fault) {
    if (shown) prepare(shown.vehicle, shown.state);
    throw new Error('the rotors cannot control the axes independently');
  }
  shown = {vehicle, name, state, set: prepare(vehicle, state)};
  polygons = {};
  if (!name) own = {yaml, name: vehicle.name};
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

/** Return the axes that are drawn, without those that are lost. */
function viewed() {
  const {vehicle, state, set} = shown;
  const left = state.shown.filter((axis) => set.kept.includes(axis))
    .map((axis) => vehicle.axes.indexOf(axis));
  return left.length > 1 ? left : [0, 1];
}

/** Answer the demand, and show it. */
function update() {
  const {vehicle, name, state, set} = shown, {axes, reference: start} = vehicle, {demand, health} = state;
  const began = performance.now(),
    beside = state.beside ? kernel.allocate(vehicle, demand, state.beside) : null;
  const answer = kernel.allocate(vehicle, demand), served = answer.wrench, view = viewed();
  const hover = kernel.allocate(vehicle, start);
  if (set.fault) answer.status = 'LOST';
  const moved = axes.some((axis, k) => !view.includes(k) && set.kept.includes(axis) &&
    Math.abs(demand[k] - served[k]) > 1e-9);
  const sets = sections(moved ? [demand, served] : [demand], view);
  explorer.times.push(performance.now() - began);
  const names = {...Object.fromEntries(Object.keys(VEHICLES).map((word) => [word, word])),
    '': own?.name ?? ''};
  const extras = {words: explain(shown, answer, beside, hover), view, moved, names};
  render(page(shown, answer, beside, extras, act), document.body);
  stages ??= makeStages();
  drawVehicle(stages.body, vehicle, health, set, answer);
  stages.set.look(view.length < 3);
  drawSet(stages.set, {axes, shown: view, set, sets, demand, served, beside: beside?.wrench, start});
  history.replaceState(null, '', `#${address()}`);
}

/** Return the attainable sets through some wrenches; a drag in the picture leaves them as they are. */
function sections(bases, view) {
  const key = JSON.stringify([view, bases.map((base) => base.filter((_, k) => !view.includes(k)))]);
  if (key !== polygons.key) polygons = {key, sets: bases.map((base) => section(shown.set, base, view))};
  return polygons.sets;
}

function address() {
  const {vehicle, name, state} = shown;
  return new URLSearchParams({...(name ? {vehicle: name} : {yaml: vehicle.source}), ...state}).toString();
}

/** Show the case of the address; without one, the vehicle that the page was written for. */
function fromAddress() {
  const {vehicle, yaml, ...words} = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  const lists = ['demand', 'health', 'airmode', 'order', 'shown'];
  const given = Object.fromEntries(Object.entries(words)
    .map(([name, word]) => [name, lists.includes(name) ? word.split(',') : word]));
  if (yaml !== undefined) return show(yaml, '', given);
  const name = vehicle ?? started?.[0] ?? 'hexarotor', text = vehicle === undefined && started?.[1];
  if (text) return show(text, VEHICLES[name] === text ? name : '', given);
  const known = Object.keys(VEHICLES);
  if (!known.includes(name)) throw new Error(`vehicle: expected one of ${known.join(', ')}, got ${name}`);
  return show(VEHICLES[name], name, given);
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
  const {center, extent} = shown.set, near = (x) => Math.max(-REACH, Math.min(REACH, x));
  move(Object.fromEntries(viewed().map((k, i) => [k, center[k] + extent[k] * near(spot[i])])));
}

const fail = (i) => change({health: shown.state.health.with(i, shown.state.health[i] > 0 ? 0 : 1)});

/** What the controls do. */
const act = {
  change, fail, move,
  pick: (name) => attempt(name, () => show(VEHICLES[name] ?? own.yaml, name)),
  browse: () => $('file').click(),
  choose: ({target}) => open(target.files[0]).finally(() => { target.value = ''; }),
  reset() {
    const {reference, health, airmode} = shown.vehicle;
    change({demand: reference, health, airmode, elapsed: 0});
  },
};

/** Make the pictures: a click on a rotor fails it, the demand is dragged, other drags turn. */
function makeStages() {
  const body = new Stage($('body'), [-3, -3.45, 3.35]), set = new Stage($('set'), [2.6, -4.6, 2.6]);
  const drag = (event) => {
    const at = set.under(event, set.flat ? new Vector3() : set.demand);
    if (at) moveTo(at.toArray());
  };
  let pressed, dragged = false;
  const listen = (element, types, job) => types.forEach((type) => element.addEventListener(type, job, true));
  listen(body.element, ['pointerdown'], ({clientX, clientY}) => { pressed = [clientX, clientY]; });
  listen(body.element, ['pointerup'], (event) => {
    const still = Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 5;
    const hits = still ? body.ray(event).intersectObjects(body.content.children) : [];
    const hit = hits.find(({object}) => 'rotor' in object.userData);
    if (hit) fail(hit.object.userData.rotor);
  });
  listen(set.element, ['pointerdown'], (event) => {
    const {left, top} = set.element.getBoundingClientRect(), {x, y} = set.project(set.demand);
    dragged = set.flat || Math.hypot(event.clientX - left - x, event.clientY - top - y) < 26;
    if (!dragged) return;
    set.orbits(false);
    set.element.setPointerCapture(event.pointerId);
    event.preventDefault();
    drag(event);
  });
  listen(set.element, ['pointermove'], (event) => dragged && drag(event));
  listen(set.element, ['pointerup', 'pointercancel'], () => { dragged = false; set.orbits(!set.flat); });
  return {body, set};
}

window.onhashchange = () => attempt('address', fromAddress);
for (const type of ['dragover', 'dragleave', 'drop']) {
  window.addEventListener(type, (event) => {
    event.preventDefault();
    document.body.classList.toggle('drop', type === 'dragover');
    if (type === 'drop') open(event.dataTransfer.files[0]);
  });
}
matchMedia('(prefers-color-scheme: dark)').onchange = update;
attempt('address', fromAddress);
