// The attainable set over three axes, with the demand.
import {CircleGeometry, RingGeometry, Vector3} from 'three';
import {nice} from './plane.js';
import {UNITS} from './words.js';

const ON_TOP = {depthTest: false, transparent: true}, FAR = 1.6;
const DASHES = {dashed: true, dashSize: 0.04, gapSize: 0.03}, BELOW = new Vector3(0, 0, -0.09);

/** Draw the attainable set over the shown axes, in units of half of their ranges. */
export function drawSet(stage, {axes, shown, set, sets, whole, demand, served, beside, start}) {
  stage.clear();
  const scaled = (u, k) => (u[k] - set.center[k]) / set.extent[k],
    value = (x, k) => set.center[k] + x * set.extent[k];
  // What is farther out is drawn nearer, in the same direction.
  const spot = (u) => {
    const at = new Vector3(...shown.map((k) => scaled(u, k)));
    return at.multiplyScalar(Math.min(1, FAR / Math.max(...at.toArray().map(Math.abs))));
  };
  const edgesOf = (polygons) => polygons.flatMap((corners) =>
    corners.map((corner, j) => [...corner, ...corners[(j + 1) % corners.length]]));
  if (whole.length) stage.lines(edgesOf(whole), 'line', 1);
  sets.forEach((polygons, i) => {
    const edges = edgesOf(polygons);
    if (i === 0) stage.polygons(polygons, 'face', 0.3);
    if (edges.length) stage.lines(edges, i ? 'soft' : 'free', i ? 1 : 1.6, i ? DASHES : {});
  });
  const middle = spot(start);
  shown.forEach((k, place) => {
    const on = (x) => middle.clone().setComponent(place, x), step = nice(value(1, k) - value(0, k));
    stage.lines([[...on(-1.12), ...on(1.12)]], 'soft', 1);
    stage.label(`${axes[k]} [${UNITS[axes[k]] ?? '-'}]`, on(1.25), '');
    for (let t = Math.ceil(value(-1.05, k) / step); t * step <= value(1.05, k); t++) {
      const at = on(scaled(start.map((u, j) => j === k ? t * step : u), k));
      stage.rod(at.clone().addScalar(-1e-3), at, 0.012, 'soft');
      if (t || place === 0) stage.label(`${+(t * step).toPrecision(3)}`, at.add(BELOW), 'tick');
    }
  });
  const miss = (u, name) => stage.lines([[...spot(demand), ...spot(u)]], name, 2, {...DASHES, ...ON_TOP});
  miss(served, 'demand');
  if (beside) miss(beside, 'beside');
  // A ring, a hollow diamond and a dot, one inside the other where they are close; all face the eye.
  const marks = [[demand, new RingGeometry(0.082, 0.104, 40), 'demand'],
    ...(beside ? [[beside, new RingGeometry(0.048, 0.075, 4), 'beside']] : []),
    [served, new CircleGeometry(0.036, 24), 'served']];
  marks.forEach(([u, geometry, name], order) => {
    const mesh = stage.add(geometry, name, 1, ON_TOP, true);
    mesh.position.copy(spot(u));
    mesh.renderOrder = 2 + order;
    stage.facing.push(mesh);
  });
  stage.marks = [demand, served, ...(beside ? [beside] : [])].map(spot);
  [stage.demand] = stage.marks;
  stage.draw();
}
