// The case that the page shows, what changes it, and the address that carries it.
import {render} from 'lit-html';
import {Vector3} from 'three';
import {download, EXPORTS} from './exports.js';
import {Air, Flights} from './fly.js';
import {Flight} from './flight.js';
import {loadKernel} from './kernel.js';
import {Model} from './model.js';
import {page, REACH} from './page.js';
import {drawSet} from './pictures.js';
import {ASKED, fromPx4, isNormalised, readPx4} from './px4.js';
import {section} from './section.js';
import {hasWebGL, Stage} from './stage.js';
import {STORIES} from './stories.js';
import {bounds, readCase, readVehicle} from './vehicle.js';
import {compared, explain, METHODS} from './words.js';

const UNPREPARED = ['demand', 'beside', 'shown']; // what the kernel need not be prepared for
const NEAR = 26; // of the demand, where a press drags it [pixels]
const UP = new Vector3(0, 0, 1);

const $ = (id) => document.getElementById(id);
const kernel = await loadKernel();
const flights = new Flights([await loadKernel(), await loadKernel()], () => shown && update(false));
const started = Object.entries(JSON.parse($('start').textContent))[0];
const webgl = hasWebGL;
const dark = matchMedia('(prefers-color-scheme: dark)');
let shown; // the case: vehicle, name, state (what the controls set) and the attainable set
let own; // the vehicle that was opened last
let asked; // PX4's parameters that wait for what PX4 does not know
let story = ''; // which one is told
let zoom = 1;
let polygons = {}; // of the sets that are drawn, and what they are for
let stages; // the pictures
window.explorer = {change, kernel, loadKernel, Flight, flights, readVehicle, bounds, show, tell, open, times: [],
  get stages() { return stages; }, get air() { return stages.air; },
  exported: (key) => EXPORTS[key].text(shown.vehicle),
  get sets() { return polygons.sets; }, get state() { return {name: shown.name, ...shown.state}; }};

/** Do something that a wrong file or address can make fail; say why in one line. */
function attempt(what, job) {
  let fault = '';
  try {
    job();
  } catch (error) {
    fault = `${what}: ${error.message}`;
  }
  if (!shown) tell('roll');
  $('fault').textContent = fault;
}

const prepare = (vehicle, state) => kernel.prepare(vehicle, state.health, state);
/** Prepare a case; ranges stay those of the sound vehicle, so that a loss is seen. */
const prepared = (vehicle, state, {center, extent}) => ({...prepare(vehicle, state), center, extent});

/** Show a vehicle, given as YAML; the shipped ones have a name. What is wrong leaves the page as it is. */
function show(yaml, name = '', given = {}, told = '') {
  const vehicle = readVehicle(yaml), state = readCase(vehicle, given, Object.keys(METHODS));
  const full = prepare(vehicle, {...state, health: vehicle.health, elapsed: 0});
  if (full.fault) {
    if (shown) prepare(shown.vehicle, shown.state);
    throw new Error('the rotors cannot control the axes independently');
  }
  shown = {vehicle, name, state, full, set: prepared(vehicle, state, full)};
  story = told;
  zoom = 1;
  polygons = {};
  if (!name) own = {yaml, name: vehicle.name};
  update();
}

/** Tell a story: show its case, and say in one sentence what is seen. */
function tell(key) {
  const {vehicle, state, start} = STORIES[key], isOwn = typeof vehicle === 'function';
  flights.start = start;
  $('story')?.style.removeProperty('min-height');
  show(isOwn ? vehicle(VEHICLES.hexarotor) : VEHICLES[vehicle], isOwn ? '' : vehicle, state, key);
}

/** Show the same vehicle with other values of the state. */
function change(given) {
  const {vehicle, name, full} = shown, state = readCase(vehicle, {...shown.state, ...given}, Object.keys(METHODS));
  const unprepared = Object.keys(given).every((key) => UNPREPARED.includes(key));
  if (!unprepared) polygons.key = undefined;
  if (Object.keys(given).some((key) => key !== 'shown')) story = '';
  shown = {vehicle, name, state, full, set: unprepared ? shown.set : prepared(vehicle, state, full)};
  update();
}

/** Return the axes that are drawn, without those that are lost. */
function viewed() {
  const {vehicle, state, set} = shown;
  const left = state.shown.filter((axis) => set.kept.includes(axis)).map((axis) => vehicle.axes.indexOf(axis));
  const view = left.length > 1 ? left : [0, 1];
  return webgl ? view : view.slice(0, 2);
}

/** Answer the demand, and show it; a flight changes its own part alone. */
function update(anew = true) {
  if (anew) answer();
  const {drawing, extras} = shown, {vehicle, state, set} = shown;
  flights.take(shown);
  render(page(shown, shown.answer, shown.beside, {...extras, names: names(), flights, webgl, zoom, asked, story}, act),
    document.body);
  if (webgl) draw(anew, drawing, vehicle, state, set);
  if (anew) history.replaceState(null, '', `#${address()}`);
}

function names() {
  return {...Object.fromEntries(Object.keys(VEHICLES).map((word) => [word, word])), '': own?.name ?? ''};
}

function answer() {
  const {vehicle, state, set} = shown, {axes, reference: start} = vehicle, {demand} = state;
  const began = performance.now(), beside = state.beside ? kernel.allocate(vehicle, demand, state.beside) : null;
  const found = kernel.allocate(vehicle, demand), served = found.wrench, view = viewed();
  const hover = kernel.allocate(vehicle, start);
  if (set.fault) found.status = 'LOST';
  const moved = axes.some((axis, k) => !view.includes(k) && set.kept.includes(axis) &&
    Math.abs(demand[k] - served[k]) > 1e-9);
  const sets = sections(moved ? [demand, served] : [demand], view);
  const weaker = state.elapsed > 0 || state.health.some((h, i) => h < vehicle.health[i]);
  const sentence = compared(shown, found, beside), {lead, end} = STORIES[story] ?? {};
  explorer.times.push(performance.now() - began);
  Object.assign(shown, {answer: found, beside, drawing: {axes, shown: view, set, sets, demand, served,
    beside: beside?.wrench, start, whole: weaker ? section({...shown.full, center: set.center, extent: set.extent}, demand, view) : []}});
  shown.extras = {view, moved, weaker, drawing: shown.drawing, words: explain(shown, found, hover),
    sentence: lead ? `${lead} ${sentence}` : sentence[0].toUpperCase() + sentence.slice(1), because: end ?? ''};
}

function draw(anew, drawing, vehicle, state, set) {
  stages ??= makeStages();
  if (anew) {
    const key = vehicle.source + dark.matches;
    if (key !== stages.key) {
      stages.body.clear();
      stages.model = new Model(stages.body, vehicle);
    }
    stages.key = key;
    stages.model.show(state.health, shown.answer, set);
    stages.body.draw();
    stages.set.zoom = zoom;
    if (drawing.shown.length > 2) drawSet(stages.set, drawing);
  }
  if (typeof vehicle.body === 'string') return;
  stages.air ??= new Air([$('air0'), $('air1')], act.failInFlight);
  stages.air.show(flights, dark.matches);
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

/** Show the case of the address; without one, the vehicle that the page was written for, or else the first story. */
function fromAddress() {
  const {vehicle, yaml, ...words} = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  const lists = ['demand', 'health', 'airmode', 'order', 'shown'];
  const given = Object.fromEntries(Object.entries(words)
    .map(([name, word]) => [name, lists.includes(name) ? word.split(',') : word]));
  if (yaml !== undefined) return show(yaml, '', given);
  if (!location.hash && !started) return tell('roll');
  const name = vehicle ?? started?.[0] ?? 'hexarotor', text = vehicle === undefined && started?.[1];
  if (text) return show(text, VEHICLES[name] === text ? name : '', {beside: 'pseudo_inverse', ...given});
  const known = Object.keys(VEHICLES);
  if (!known.includes(name)) throw new Error(`vehicle: expected one of ${known.join(', ')}, got ${name}`);
  return show(VEHICLES[name], name, given);
}

/** Open a text: a parameter file, or PX4's parameters, which lack mass and thrusts. */
function open(text, name) {
  attempt(name, () => {
    const given = readPx4(text);
    asked = undefined;
    if (!given) return show(text);
    const keys = Object.keys(ASKED).filter((key) => key !== 'length' || isNormalised(given));
    asked = {name, given, fields: keys.map((key) => ({key, label: ASKED[key][0], value: ASKED[key][1]}))};
    return update();
  });
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
  change, fail, move, moveTo,
  tell: (key) => attempt('story', () => tell(key)),
  // A file on this machine is no address for others.
  address: /^https?:$/.test(location.protocol) && !/^(localhost|127\.|\[)/.test(location.hostname),
  pages: document.querySelector('meta[name=pages]')?.content,
  copy: () => (navigator.clipboard?.writeText(location.href) ?? Promise.reject()).then(() => { $('copy').textContent = 'Copied'; },
    () => { $('fault').textContent = 'the browser does not let the page copy: take the address from its bar'; }),
  pick: (name) => attempt(name, () => show(VEHICLES[name] ?? own.yaml, name, {beside: shown.state.beside})),
  browse: () => $('file').click(),
  choose: ({target}) => opened(target.files[0]).finally(() => { target.value = ''; }),
  answer(event) {
    event.preventDefault();
    const {given, name} = asked, numbers = Object.fromEntries([...new FormData(event.target)].map(([k, x]) => [k, +x]));
    attempt(name, () => {
      const text = fromPx4(given, {length: 1, ...numbers}, name.replace(/\W/g, '_'));
      asked = undefined;
      show(text, '', {beside: 'pseudo_inverse'});
    });
  },
  save(target) {
    const {end, text} = EXPORTS[target.value], {vehicle} = shown;
    target.value = '';
    attempt('export', () => download(vehicle.name.replace(/\W+/g, '_') + end, text(vehicle)));
  },
  zoom(factor) {
    zoom = Math.max(0.5, Math.min(8, zoom * factor));
    update();
  },
  /** Keep the height of what is above the pictures, lest they move under a drag. */
  hold: () => { $('story').style.minHeight = `${$('story').offsetHeight}px`; },
  failInFlight: (rotor) => flights.fail(rotor),
  reset() {
    const {reference, health, airmode} = shown.vehicle;
    change({demand: reference, health, airmode, elapsed: 0});
  },
};

async function opened(file) {
  if (file) open(await file.text(), file.name);
}

/** Make the pictures: a click on a rotor fails it, the demand is dragged, other drags turn. */
function makeStages() {
  const body = new Stage($('body'), [-3, -3.45, 3.35]), set = new Stage($('set'), [2.2, -3.9, 2.2]);
  // In the plane of the first two axes, or with Shift along the third.
  const drag = (event) => {
    const {x, y, z} = set.demand, away = set.camera.position.clone().setZ(0).normalize();
    const at = set.under(event, set.demand, event.shiftKey ? away : UP);
    if (at) moveTo(event.shiftKey ? [x, y, at.z] : [at.x, at.y, z]);
  };
  const atDemand = ({clientX, clientY}) => {
    const {left, top} = set.element.getBoundingClientRect(), {x, y} = set.project(set.demand);
    return Math.hypot(clientX - left - x, clientY - top - y) < NEAR;
  };
  let pressed, dragged = false;
  const listen = (element, types, job, how = true) => types.forEach((type) => element.addEventListener(type, job, how));
  listen(body.element, ['pointerdown'], ({clientX, clientY}) => { pressed = [clientX, clientY]; });
  listen(body.element, ['pointerup'], (event) => {
    const still = Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 5;
    const rotor = still ? body.rotorUnder(event) : undefined;
    if (rotor !== undefined) fail(rotor);
  });
  listen(set.element, ['touchstart'], (event) => dragged && event.preventDefault(), {passive: false, capture: true});
  listen(set.element, ['pointerdown'], (event) => {
    dragged = atDemand(event);
    if (!dragged) return;
    set.held = true;
    act.hold();
    set.orbits(false);
    set.element.setPointerCapture(event.pointerId);
    event.preventDefault();
    drag(event);
  });
  listen(set.element, ['pointermove'], (event) => dragged && drag(event));
  listen(set.element, ['pointerup', 'pointercancel'], () => {
    dragged = set.held = false;
    set.orbits(true);
    set.draw();
  });
  for (const id of ['set', 'section']) {
    // Without Ctrl the wheel scrolls the page.
    listen($(id), ['wheel'], (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      act.zoom(event.deltaY < 0 ? 1.15 : 1 / 1.15);
    }, {passive: false});
  }
  return {body, set};
}

window.onhashchange = () => attempt('address', fromAddress);
for (const type of ['dragover', 'dragleave', 'drop']) {
  window.addEventListener(type, (event) => {
    event.preventDefault();
    document.body.classList.toggle('drop', type === 'dragover');
    if (type === 'drop') opened(event.dataTransfer.files[0]);
  });
}
dark.onchange = () => update();
attempt('address', fromAddress);
