// The page: its state, its controls, and the address that carries the state.
import {Vector3} from 'three';
import {loadKernel} from './kernel.js';
import {drawSet, drawVehicle, kind, UNITS} from './pictures.js';
import {Stage} from './stage.js';
import {bounds, readVehicle} from './vehicle.js';

const REACH = 1.6, OTHERS = {'': 'no other method', pseudo_inverse: 'clipped pseudo-inverse',
  fixed_pseudo_inverse: 'clipped pseudo-inverse, computed once'};
const $ = (id) => document.getElementById(id), text = (id, words) => ($(id).textContent = words);
const make = (tag, fields, ...below) => {
  const node = Object.assign(document.createElement(tag), fields);
  node.append(...below);
  return node;
};
const digits = (x) => String(Math.abs(x) < 1e-9 ? 0 : Number(x.toPrecision(3)));
const listed = (words) => words.length > 1 ? `${words.slice(0, -1).join(', ')} and ${words.at(-1)}` : words.join('');
const numbered = (flags, value) => flags.flatMap((flag, i) => flag === value ? [i + 1] : []);

const kernel = await loadKernel();
const stages = {body: new Stage($('body'), [-3, -3.45, 3.35]), set: new Stage($('set'), [2.6, -4.6, 2.6])};
const state = {}, page = {kernel, readVehicle, bounds, state, show, times: []};
window.explorer = page;
let vehicle, set, answer;

/** Show a vehicle, given as YAML; the shipped ones have a name. */
function show(yaml, name = '', given = {}) {
  const read = readVehicle(yaml), before = vehicle;
  vehicle = read;
  try {
    Object.assign(state, {name, health: [...read.health], policy: read.policy, order: read.order, deviation: read.deviation, airmode: read.airmode, elapsed: 0, beside: '',
      demand: [...read.reference], shown: read.axes.slice(-3), ...given});
    prepare();
  } catch (error) {
    vehicle = before;
    throw error;
  }
  build();
  update();
}

function prepare() {
  set = kernel.prepare(vehicle, state.health, state);
  if (set.fault && state.health.every((h) => h === 1)) throw new Error('the rotors cannot control the axes independently');
}

function build() {
  const {axes, n} = vehicle, orders = [vehicle.order, ...['roll pitch,thrust,yaw', 'thrust,roll pitch,yaw', 'roll pitch yaw,thrust',
    'thrust,roll pitch yaw', 'roll pitch thrust yaw'].map((words) => readOrder(words))];
  $('vehicle').value = state.name;
  if (!state.name) $('vehicle').selectedIndex = $('vehicle').options.length - 1;
  $('vehicle').lastChild.textContent = state.name ? 'your YAML (open or drop)' : vehicle.name;
  const words = [...new Set([...orders, state.order].map((order) => order.map((group) => group.join(' ')).join(', ')))];
  $('order').replaceChildren(...words.map((order) => make('option', {value: order, textContent: order.replaceAll(', ', ' before ')})));
  $('demand').replaceChildren(...axes.map((axis, k) => {
    const [low, high] = [-REACH, REACH].map((x) => set.center[k] + x * set.extent[k]), field = {min: low, max: high, step: (high - low) / 800};
    const change = ({target}) => { state.demand[k] = Number(target.value); update(); };
    return make('div', {}, make('label', {textContent: axis, htmlFor: `demand-${k}`}),
      make('input', {type: 'range', id: `demand-${k}`, ...field, oninput: change}),
      make('input', {type: 'number', step: 'any', ariaLabel: axis, onchange: change}), make('small', {textContent: UNITS[axis]}), make('output'));
  }));
  $('rotors').replaceChildren(...Array.from({length: n}, (_, i) => make('div', {},
    make('button', {textContent: i + 1, title: `Fail or repair rotor ${i + 1}`, onclick: () => fail(i)}),
    make('input', {type: 'range', min: 0, max: 1, step: 0.01, ariaLabel: `health of rotor ${i + 1}`,
      oninput: ({target}) => { state.health[i] = Number(target.value); change(); }}),
    make('output'), document.createElementNS('http://www.w3.org/2000/svg', 'svg'), make('output'))));
  const forces = (axis) => axis.startsWith('force') || axis === 'thrust', pairs = axes.flatMap((a, i) => axes.slice(i + 1).map((b) => [a, b]));
  const views = [...(axes.length > 3 ? [axes.slice(-3)] : []), ...pairs.filter(([a, b]) => axes.length < 5 || forces(a) === forces(b))];
  $('shown').replaceChildren(...views.map((view) => make('button', {textContent: view.length > 2 ? 'all torques' : view.join('–'),
    value: view, onclick: () => { state.shown = view; update(); }})));
}

const readOrder = (words) => words.split(',').map((group) => group.trim().split(' ').filter((axis) => vehicle.axes.includes(axis)))
  .concat([vehicle.axes.filter((axis) => !words.includes(axis))]).filter((group) => group.length);

function fail(i) {
  state.health[i] = state.health[i] > 0 ? 0 : 1;
  change();
}

function change() {
  prepare();
  update();
}

function update() {
  const {axes} = vehicle, began = performance.now(), shown = state.shown.filter((axis) => set.kept.includes(axis)).map((a) => axes.indexOf(a));
  if (set.fault) return explain();
  const beside = state.beside && kernel.allocate(vehicle, state.demand, state.beside);
  answer = kernel.allocate(vehicle, state.demand);
  const others = axes.some((_, k) => !shown.includes(k) && set.kept.includes(axes[k]) && Math.abs(state.demand[k] - answer.wrench[k]) > 1e-9);
  const view = shown.length > 1 ? shown : [0, 1];
  const sets = [state.demand, ...(others ? [answer.wrench] : [])].map((base) => kernel.section(base, view));
  page.times.push(performance.now() - began);
  const scaled = (u, k) => (u[k] - set.center[k]) / set.extent[k], value = (x, k) => set.center[k] + x * set.extent[k];
  drawVehicle(stages.body, vehicle, state.health, set, answer);
  look(view.length < 3);
  drawSet(stages.set, {axes, shown: view, scaled, value, sets: sets.map((polygons) => polygons ?? []), demand: state.demand,
    served: answer.wrench, beside: beside?.wrench, start: vehicle.reference});
  page.sets = sets;
  const fixed = axes.flatMap((axis, k) => view.includes(k) || axes.length > 4 && !state.demand[k] ? [] : [`${axis} ${digits(state.demand[k])} ${UNITS[axis]}`]);
  text('set-title', `Attainable ${view.length > 2 ? 'torques' : view.map((k) => axes[k]).join(' and ')}${fixed.length ? ` at ${fixed.join(', ')}` : ''}`);
  $('moved').hidden = !others;
  controls(beside);
  explain(beside);
  history.replaceState(null, '', `#${address()}`);
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

function controls(beside) {
  [...$('demand').children].forEach((row, k) => {
    const [, slider, number, , served] = row.children, miss = Math.abs(state.demand[k] - answer.wrench[k]) > 1e-6 * set.extent[k];
    served.textContent = miss ? digits(answer.wrench[k]) : '✓';
    served.className = miss ? 'short' : '';
    slider.value = state.demand[k];
    if (document.activeElement !== number) number.value = +state.demand[k].toPrecision(6);
  });
  const top = Math.max(...set.upper, ...vehicle.speedMax.map((s, i) => vehicle.forward[i] * s * s)), bottom = Math.min(0, ...set.lower);
  const x = (thrust) => 100 * (thrust - bottom) / (top - bottom);
  [...$('rotors').children].forEach((row, i) => {
    const [button, slider, share, bar, result] = row.children, name = kind(state.health[i], answer.saturation[i]);
    button.setAttribute('aria-pressed', state.health[i] < 1e-9);
    slider.value = state.health[i];
    share.textContent = `${Math.round(100 * state.health[i])} %`;
    result.textContent = `${answer.thrusts[i].toFixed(2)} N, ${Math.round(answer.speeds[i])} rad/s`;
    bar.setAttribute('viewBox', '0 0 100 20');
    bar.setAttribute('preserveAspectRatio', 'none');
    const rect = (from, to, y, h, fill) => `<rect x="${x(Math.min(from, to))}" width="${Math.max(0.8, Math.abs(x(to) - x(from)))}" y="${y}" height="${h}" fill="var(--${fill})"/>`;
    bar.innerHTML = rect(set.lower[i], set.upper[i], 3, 14, 'line') + rect(0, answer.thrusts[i], 6, 8, name) +
      (beside ? rect(beside.thrusts[i], beside.thrusts[i], 1, 18, 'beside') : '');
  });
  for (const id of ['policy', 'deviation', 'beside', 'elapsed']) $(id).value = state[id];
  $('airmode').value = state.airmode[0];
  text('airmode-value', state.airmode[0] < 1 ? `${Math.round(100 * state.airmode[0])} % of its range` : 'no limit');
  text('elapsed-value', state.elapsed ? `${Math.round(1e3 * state.elapsed)} ms` : 'any');
  $('order').value = state.order.map((group) => group.join(' ')).join(', ');
  $('order').disabled = $('deviation').disabled = state.policy !== 'prioritize';
  for (const button of $('shown').children) button.setAttribute('aria-pressed', button.value === String(state.shown));
  $('beside-legend').hidden = !beside;
  $('beside-legend').lastElementChild.textContent = OTHERS[state.beside];
}

/** Say in words what the numbers of the kernel mean. */
function explain(beside) {
  const words = [], {axes} = vehicle, lost = numbered(state.health.map((h) => h < 1e-9), true);
  const missing = (result) => axes.flatMap((axis, k) => {
    const miss = state.demand[k] - result.wrench[k];
    return Math.abs(miss) > 1e-6 * set.extent[k] ? [`${axis} ${digits(result.wrench[k])} instead of ${digits(state.demand[k])} ${UNITS[axis]}`] : [];
  });
  const rotors = (flags) => listed([['maximum', 1], ['minimum', -1]].flatMap(([name, sign]) => {
    const some = numbered(flags.map((flag, i) => set.upper[i] > set.lower[i] ? flag : 0), sign);
    return some.length ? [`rotor${some.length > 1 ? 's' : ''} ${listed(some)} at ${name}`] : [];
  }));
  if (set.fault) {
    words.push('No axis can be controlled: too many rotors are lost.');
  } else {
    const missed = missing(answer);
    if (answer.status === 'EXACT') words.push(`Served in full; ${digits(answer.margin)} from the limit with ${rotors(answer.limit)}.`);
    else if (answer.status === 'REJECTED') words.push('Not attainable, and rejected: all rotors are as slow as possible.');
    else words.push(`Not attainable${answer.status === 'RATE_LIMITED' ? ' yet' : ''}: ${missed.join(', ')}.`, ...limits());
    if (set.lost.length) words.push(`Lost: ${listed(set.lost)}. The rotors cannot control it independently.`);
    if (lost.length) words.push(hover(`Rotor${lost.length > 1 ? 's' : ''} ${listed(lost)} lost`));
    if (beside) {
      const other = missing(beside);
      words.push(`${OTHERS[state.beside][0].toUpperCase()}${OTHERS[state.beside].slice(1)}: ${other.length ? other.join(', ') : 'served in full'}.`);
    }
  }
  text('status', set.fault ? 'LOST' : answer.status);
  $('status').className = !set.fault && answer.status === 'EXACT' ? '' : 'short';
  $('words').replaceChildren(...words.map((line) => make('li', {textContent: line})));
}

/** Say which rotors, or the limit on airmode, keep an axis from its demand. */
function limits() {
  const why = (k, flag) => numbered(answer.blocked[k].map((blocked, i) => blocked && answer.cause[i]), flag);
  const causes = [[1, 'at maximum'], [-1, 'at minimum'], [2, 'speeding up'], [-2, 'slowing down'], [3, 'lost or weak'], [-3, 'lost or weak']];
  const axesOf = {};
  vehicle.axes.forEach((axis, k) => {
    const parts = causes.flatMap(([flag, how]) => why(k, flag).length ? [`${listed(why(k, flag))} ${how}`] : []);
    const all = [...(parts.length ? [`rotors ${parts.join(', ')}`] : []), ...(answer.airmodeBlocks[k] ? ['the limit on airmode'] : [])];
    if (answer.served[k] < 1 && all.length) (axesOf[all.join(' and ')] ??= []).push(axis);
  });
  return Object.entries(axesOf).map(([what, axes]) => `What limits ${listed(axes)}: ${what}.`);
}

function hover(start) {
  const {axes, reference} = vehicle, at = kernel.allocate(vehicle, reference);
  const off = axes.filter((axis, k) => Math.abs(at.wrench[k] - reference[k]) > 1e-6 * (set.extent[k] || 1));
  if (!off.length) return `${start}: hover is still attainable, ${digits(at.margin)} from the limit.`;
  if (String(off) === 'yaw') return `${start}: hover leaves a yaw torque of ${digits(at.wrench[axes.indexOf('yaw')])} N m, so the vehicle spins.`;
  return `${start}: hover is not attainable (${listed(off)}).`;
}

function address() {
  const {name, demand, health, order, ...rest} = state;
  return new URLSearchParams({...(name ? {vehicle: name} : {yaml: vehicle.source}), demand, health, ...rest,
    order: order.map((group) => group.join(' '))}).toString();
}

/** Return what an address says about the state. */
function given(parameters) {
  const numbers = (key) => parameters.has(key) ? {[key]: parameters.get(key).split(',').map(Number)} : {};
  const words = (key) => parameters.has(key) ? {[key]: parameters.get(key)} : {};
  return {...numbers('demand'), ...numbers('health'), ...words('policy'), ...(parameters.has('elapsed') ? {elapsed: Number(parameters.get('elapsed'))} : {}), ...numbers('airmode'), ...words('deviation'), ...words('beside'),
    ...(parameters.has('shown') ? {shown: parameters.get('shown').split(',')} : {}),
    ...(parameters.has('order') ? {order: parameters.get('order').split(',').map((group) => group.split(' '))} : {})};
}

/** Do something that a wrong file or address can make fail; say why in one line. */
function attempt(what, job) {
  text('fault', '');
  try {
    job();
  } catch (error) {
    text('fault', `${what}: ${error.message}`);
  }
}

const open = async (file) => file && attempt(file.name, await file.text().then((yaml) => () => show(yaml)));
const start = JSON.parse($('start').textContent), vehicles = {...VEHICLES, ...start};
const fromAddress = () => {
  const parameters = new URLSearchParams(location.hash.slice(1)), name = parameters.get('vehicle') ?? Object.keys(start)[0] ?? 'hexarotor';
  show(parameters.get('yaml') ?? vehicles[name], parameters.has('yaml') ? '' : name, given(parameters));
};
$('vehicle').append(...Object.keys(vehicles).map((name) => make('option', {textContent: name, value: name})), make('option', {value: '', disabled: true}));
$('beside').append(...Object.entries(OTHERS).map(([value, textContent]) => make('option', {value, textContent})));
$('vehicle').onchange = ({target}) => attempt(target.value, () => show(vehicles[target.value], target.value));
$('file').onchange = ({target}) => open(target.files[0]);
$('hover').onclick = () => { Object.assign(state, {demand: [...vehicle.reference], health: [...vehicle.health], airmode: vehicle.airmode, elapsed: 0}); change(); };
$('link').onclick = () => navigator.clipboard?.writeText(location.href);
$('beside').onchange = ({target}) => { state.beside = target.value; update(); };
$('airmode').oninput = ({target}) => { state.airmode = [Number(target.value), Number(target.value), ...state.airmode.slice(2)]; change(); };
$('elapsed').oninput = ({target}) => { state.elapsed = Number(target.value); change(); };
for (const id of ['policy', 'deviation']) $(id).onchange = ({target}) => { state[id] = target.value; change(); };
$('order').onchange = ({target}) => { state.order = readOrder(target.value); change(); };
window.onhashchange = () => attempt('address', fromAddress);
for (const type of ['dragover', 'dragleave', 'drop']) {
  window.addEventListener(type, (event) => {
    event.preventDefault();
    document.body.classList.toggle('drop', type === 'dragover');
    if (type === 'drop') open(event.dataTransfer.files[0]);
  });
}
matchMedia('(prefers-color-scheme: dark)').onchange = () => update();

// A click on a rotor fails it; a drag turns the picture.
let pressed;
$('body').addEventListener('pointerdown', (event) => { pressed = [event.clientX, event.clientY]; }, true);
$('body').addEventListener('pointerup', (event) => {
  const still = Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 5;
  const hit = still && stages.body.ray(event).intersectObjects(stages.body.content.children).find(({object}) => 'rotor' in object.userData);
  if (hit) fail(hit.object.userData.rotor);
});

let dragged = false;
const drag = (event) => {
  const stage = stages.set, at = stage.flat ? stage.under(event, new Vector3(), new Vector3(0, 0, 1)) : stage.under(event, stage.demand);
  if (at) move(at.toArray());
};
const view = () => state.shown.map((axis) => vehicle.axes.indexOf(axis));
const move = (spot) => {
  view().forEach((k, i) => { state.demand[k] = +(set.center[k] + set.extent[k] * Math.max(-REACH, Math.min(REACH, spot[i]))).toFixed(4); });
  update();
};
$('set').addEventListener('pointerdown', (event) => {
  const {left, top} = $('set').getBoundingClientRect(), {x, y} = stages.set.project(stages.set.demand);
  dragged = stages.set.flat || Math.hypot(event.clientX - left - x, event.clientY - top - y) < 26;
  if (!dragged) return;
  if (stages.set.controls) stages.set.controls.enabled = false;
  $('set').setPointerCapture(event.pointerId);
  event.preventDefault();
  drag(event);
}, true);
$('set').addEventListener('pointermove', (event) => dragged && drag(event), true);
for (const type of ['pointerup', 'pointercancel']) {
  $('set').addEventListener(type, () => { dragged = false; if (stages.set.controls) stages.set.controls.enabled = !stages.set.flat; }, true);
}
$('set').addEventListener('keydown', ({key, shiftKey}) => {
  const step = {ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowDown: [1, -1], ArrowUp: [1, 1], PageDown: [2, -1], PageUp: [2, 1]}[key];
  if (!step || step[0] >= state.shown.length) return;
  move(view().map((k, i) => (state.demand[k] - set.center[k]) / set.extent[k] + (i === step[0] ? step[1] * (shiftKey ? 0.1 : 0.01) : 0)));
});

attempt('address', fromAddress);
