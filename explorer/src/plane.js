// The attainable set over two axes, with the demand: a drawing that needs no WebGL.
import {html, svg} from 'lit-html';
import {UNITS} from './words.js';

const SIZE = 1.5, WIDE = 1.8; // half of what the drawing shows, in halves of the ranges; if the demand is far out
const FAR = 1.64; // where a demand that is farther out is drawn

let pressed = false, size = SIZE;

const points = (corners) => corners.map(([x, y]) => `${x},${-y}`).join(' ');
const line = ([x, y], [z, w], name) => svg`<line class=${name} x1=${x} y1=${-y} x2=${z} y2=${-w} />`;

/** Return a point no farther out than the drawing. */
export const within = (spot) => spot.map((x) => Math.max(-FAR, Math.min(FAR, x)));

export function nice(half) {
  const power = 10 ** Math.floor(Math.log10(half));
  return [0.5, 1, 2, 5].map((digit) => digit * power).findLast((step) => half / step >= 1.4) ?? power / 2;
}

/** Return the drawing; `act.moveTo` gets spots of a demand that is dragged. */
export function plane({axes, shown, set, sets, whole, demand, served, beside, start}, zoom, act) {
  const spot = (u) => shown.map((k) => (u[k] - set.center[k]) / set.extent[k]);
  const [asked, got, other, middle] = [demand, served, beside, start].map((u) => u && within(spot(u)));
  if (!pressed) size = Math.max(...asked.map(Math.abs)) > SIZE - 0.15 ? WIDE : SIZE;
  const half = size / zoom, about = zoom > 1 ? asked.map((x, i) => (x + got[i]) / 2) : [0, 0];
  const px = (size) => size / zoom;
  const outside = spot(demand).some((x, i) => x !== asked[i]);
  return html`<svg class="plane" viewBox="${about[0] - half} ${-about[1] - half} ${2 * half} ${2 * half}"
      role="img" aria-label="Section of the attainable set" style="font-size:${px(0.13)}px"
      @pointerdown=${(event) => press(event, asked, act)} @pointermove=${(event) => pressed && follow(event, act)}
      @pointerup=${release} @pointercancel=${release} @touchstart=${{handleEvent: held, passive: false}}>
    ${whole.map((corners) => svg`<polygon class="whole" points=${points(corners)} />`)}
    ${sets.map((polygons, i) => polygons.map((corners) => svg`<polygon class=${i ? 'wider' : 'face'}
      points=${points(corners)} />`))}
    ${shown.map((k, place) => scale(place, k, {axes, set, middle, px}))}
    ${line(asked, got, 'miss')} ${other ? line(asked, other, 'miss other') : ''}
    ${outside ? svg`<text class="tick" x=${asked[0]} y=${-asked[1] + px(0.2)} text-anchor="middle">farther out</text>` : ''}
    <circle class="ring" cx=${asked[0]} cy=${-asked[1]} r=${px(0.1)} />
    ${other ? svg`<path class="diamond" d="M${other[0]} ${-other[1] - px(0.07)} l${px(0.07)} ${px(0.07)} l${-px(0.07)} ${
      px(0.07)} l${-px(0.07)} ${-px(0.07)} z" />` : ''}
    <circle class="dot" cx=${got[0]} cy=${-got[1]} r=${px(0.034)} />
  </svg>`;
}

/** Draw an axis through hover, with numbers in its unit. */
function scale(place, k, {axes, set, middle, px}) {
  const value = (x) => set.center[k] + x * set.extent[k], step = nice(set.extent[k]);
  const on = (x) => middle.with(place, x), text = (x, y, words, name, anchor = 'middle') => svg`<text
    class=${name} x=${x} y=${-y} text-anchor=${anchor}>${words}</text>`;
  const marks = [];
  for (let t = Math.ceil(value(-1.3) / step); t * step <= value(1.3); t++) {
    const at = on((t * step - set.center[k]) / set.extent[k]);
    const [dx, dy] = place ? [px(0.03), 0] : [0, px(0.03)], label = String(+(t * step).toPrecision(3));
    marks.push(line([at[0] - dx, at[1] - dy], [at[0] + dx, at[1] + dy], 'axis'));
    if (t || !place) marks.push(place ? text(at[0] - px(0.06), at[1] - px(0.04), label, 'tick', 'end')
      : text(at[0], at[1] - px(0.16), label, 'tick'));
  }
  const end = on(1.34), name = `${axes[k]} [${UNITS[axes[k]] ?? '-'}]`;
  return [line(on(-1.34), end, 'axis'), ...marks,
    place ? text(end[0], end[1] + px(0.06), name, '') : text(SIZE - 0.05, end[1] - px(0.32), name, '', 'end')];
}

const GRIP = 34; // how near to the demand a finger has to be to drag it [pixels]

function spotOf(event) {
  const drawing = event.currentTarget, at = new DOMPoint(event.clientX, event.clientY)
    .matrixTransform(drawing.getScreenCTM().inverse());
  return [at.x, -at.y];
}

function near(event, [x, y]) {
  const at = new DOMPoint(x, -y).matrixTransform(event.currentTarget.getScreenCTM());
  return Math.hypot(at.x - event.clientX, at.y - event.clientY) < GRIP;
}

/** Keep the page still while a finger drags the demand, which `press` has seen before; elsewhere it scrolls. */
function held(event) {
  if (pressed) event.preventDefault();
}

function press(event, asked, act) {
  if (event.pointerType !== 'mouse' && !near(event, asked)) return;
  pressed = true;
  act.hold();
  event.currentTarget.setPointerCapture(event.pointerId);
  follow(event, act);
}

function follow(event, act) {
  act.moveTo(spotOf(event));
}

function release() {
  pressed = false;
}
