// The attainable set over two or three axes, in halves of their ranges: planes that cut each other.
import {Plane, Vector3} from 'three';
import {dot} from './kernel.js';

const FAR = 4; // beyond the set
const SQUARE = [[FAR, FAR], [-FAR, FAR], [-FAR, -FAR], [FAR, -FAR]];

/** Return the polygons around the set over the shown axes, the other axes at `base`. */
export function section(set, base, shown) {
  const planes = planesOf(set, base, shown);
  const faces = shown.length > 2 ? planes : planes.slice(0, 1).map(() => new Plane(new Vector3(0, 0, 1)));
  return faces.map((face) => {
    let polygon = squareIn(face);
    for (const plane of planes) {
      if (plane !== face) polygon = cut(polygon, plane);
      if (polygon.length < 3) break;
    }
    return polygon.map((corner) => corner.toArray());
  }).filter((polygon) => polygon.length > 2);
}

/** Return the facets as planes over the shown axes; none if the set has nothing at `base`. */
function planesOf({facets, center, extent}, base, shown) {
  const start = base.map((u, k) => shown.includes(k) ? center[k] : u), planes = [];
  for (const {normal, middle, width} of facets) {
    const [x, y, z = 0] = shown.map((k) => normal[k] * extent[k]), way = new Vector3(x, y, z);
    const offset = dot(normal, start) - middle, length = way.length();
    if (length <= 1e-12 * width) {
      if (Math.abs(offset) > (1 + 1e-9) * width) return [];
      continue;
    }
    for (const side of [1, -1]) {
      const plane = new Plane(way.clone().multiplyScalar(side / length), (side * offset - width) / length);
      if (!planes.some((known) => same(known, plane))) planes.push(plane);
    }
  }
  return planes.sort((a, b) => b.constant - a.constant); // the nearest first: they cut most
}

function same(a, b) {
  return Math.abs(a.constant - b.constant) + a.normal.manhattanDistanceTo(b.normal) < 1e-9;
}

/** Return a square in a plane that is greater than the set. */
function squareIn({normal, constant}) {
  const sizes = normal.toArray().map(Math.abs), least = sizes.indexOf(Math.min(...sizes));
  const along = new Vector3().setComponent(least, 1).cross(normal).normalize(),
    across = normal.clone().cross(along);
  return SQUARE.map(([x, y]) => new Vector3().addScaledVector(along, x).addScaledVector(across, y)
    .addScaledVector(normal, -constant));
}

/** Return the part of a polygon that is below a plane. */
function cut(polygon, plane) {
  const heights = polygon.map((corner) => plane.distanceToPoint(corner));
  if (heights.every((height) => height <= 0)) return polygon;
  return polygon.flatMap((corner, i) => {
    const next = (i + 1) % polygon.length, a = heights[i], b = heights[next], kept = a <= 0 ? [corner] : [];
    return a * b < 0 ? [...kept, corner.clone().lerp(polygon[next], a / (a - b))] : kept;
  });
}
