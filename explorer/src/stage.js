// A picture in three dimensions with labels; it is drawn when something has changed.
import {BufferGeometry, Color, CylinderGeometry, DirectionalLight, DoubleSide, Float32BufferAttribute, Group,
  HemisphereLight, Mesh, MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, Plane, Raycaster, Scene, Vector2,
  Vector3, WebGLRenderer} from 'three';
import {OrbitControls} from 'three/examples/jsm/controls/OrbitControls.js';
import {CSS2DObject, CSS2DRenderer} from 'three/examples/jsm/renderers/CSS2DRenderer.js';
import {LineMaterial} from 'three/examples/jsm/lines/LineMaterial.js';
import {LineSegments2} from 'three/examples/jsm/lines/LineSegments2.js';
import {LineSegmentsGeometry} from 'three/examples/jsm/lines/LineSegmentsGeometry.js';

export const color = (name) => new Color(getComputedStyle(document.documentElement).getPropertyValue(`--${name}`));

const EDGE = 0.94; // how near to the edge marks may be, as a share of half of the picture
const FOV = 30;

export const hasWebGL = (() => {
  const context = document.createElement('canvas').getContext('webgl2');
  context?.getExtension('WEBGL_lose_context')?.loseContext();
  return Boolean(context);
})();

export class Stage {
  /** Make a picture in an element, from an eye towards the middle, around which a drag turns it. */
  constructor(element, eye, target = [0, 0, 0]) {
    const light = new DirectionalLight(0xffffff, 2), camera = new PerspectiveCamera(FOV, 1, 0.1, 200);
    Object.assign(this, {element, camera, scene: new Scene(), content: new Group(), facing: [], marks: [], zoom: 1});
    this.parent = this.content;
    light.position.set(2, -3, 5);
    this.scene.add(new HemisphereLight(0xffffff, 0x8899aa, 2), light, this.content);
    camera.up.set(0, 0, 1);
    camera.position.set(...eye);
    this.renderer = new WebGLRenderer({antialias: true, alpha: true});
    this.labels = new CSS2DRenderer();
    element.append(this.renderer.domElement, this.labels.domElement);
    this.controls = new OrbitControls(camera, this.renderer.domElement);
    this.controls.enablePan = this.controls.enableZoom = false;
    this.controls.target.set(...target);
    this.controls.update();
    // A finger that moves up or down scrolls the page.
    this.renderer.domElement.style.touchAction = 'pan-y';
    this.controls.addEventListener('change', () => this.draw());
    new ResizeObserver(() => {
      const {clientWidth: w, clientHeight: h} = element;
      if (!w || !h) return;
      this.renderer.setPixelRatio(devicePixelRatio);
      this.renderer.setSize(w, h);
      this.labels.setSize(w, h);
      camera.aspect = w / h;
      this.draw();
    }).observe(element);
  }

  /** Let a drag turn the picture, or not. */
  orbits(free) {
    this.controls.enabled = free;
  }

  /** Remove everything that `add` and `label` have put here. */
  clear() {
    this.content.traverse((thing) => (thing.geometry?.dispose(), thing.material?.dispose()));
    this.content.clear();
    this.facing = [];
  }

  /** Put what a function adds into a group. */
  into(group, job) {
    const {parent} = this;
    parent.add(group);
    this.parent = group;
    const made = job();
    this.parent = parent;
    return made;
  }

  add(geometry, name, opacity = 1, more = {}, flat = false) {
    const glass = opacity < 1, material = flat ? MeshBasicMaterial : MeshLambertMaterial;
    const mesh = new Mesh(geometry, new material({
      color: color(name), side: DoubleSide, transparent: glass, opacity, depthWrite: !glass, ...more}));
    this.parent.add(mesh);
    return mesh;
  }

  /** Add segments, a flat list of their ends. */
  lines(ends, name, linewidth, more = {}) {
    const geometry = new LineSegmentsGeometry().setPositions(ends.flat());
    const line = new LineSegments2(geometry, new LineMaterial({color: color(name), linewidth, ...more}));
    this.parent.add(line.computeLineDistances());
    return line;
  }

  polygons(polygons, name, opacity) {
    const triangles = polygons.flatMap(([first, ...others]) =>
      others.slice(1).flatMap((corner, i) => [first, others[i], corner]));
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new Float32BufferAttribute(triangles.flat(), 3));
    geometry.computeVertexNormals();
    this.add(geometry, name, opacity);
  }

  /** Add a rod from one point to another. */
  rod(from, to, radius, name, top = radius, opacity = 1) {
    const way = to.clone().sub(from);
    const mesh = this.add(new CylinderGeometry(top, radius, way.length(), 24), name, opacity);
    mesh.position.copy(from).addScaledVector(way, 0.5);
    mesh.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), way.normalize());
    return mesh;
  }

  label(text, at, kind) {
    const span = Object.assign(document.createElement('span'), {textContent: text, className: kind});
    const label = new CSS2DObject(span);
    label.position.copy(at);
    this.parent.add(label);
    return label;
  }

  /** Return where a point is on the element [pixels]. */
  project(at) {
    const {x, y} = at.clone().project(this.camera), {clientWidth: w, clientHeight: h} = this.element;
    return new Vector2((x + 1) / 2 * w, (1 - y) / 2 * h);
  }

  ray({clientX, clientY}) {
    const {left, top, width, height} = this.element.getBoundingClientRect(), ray = new Raycaster();
    ray.setFromCamera(new Vector2((clientX - left) / width * 2 - 1, 1 - (clientY - top) / height * 2),
      this.camera);
    return ray;
  }

  /** Return which rotor is under the pointer, if any. */
  rotorUnder(event) {
    const hits = this.ray(event).intersectObjects(this.content.children);
    return hits.find(({object}) => 'rotor' in object.userData)?.object.userData.rotor;
  }

  /** Return where the pointer is in the plane through a point with a normal. */
  under(event, point, normal) {
    return this.ray(event).ray.intersectPlane(new Plane().setFromNormalAndCoplanarPoint(normal, point), new Vector3());
  }

  draw() {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = undefined;
      this.facing.forEach((mesh) => mesh.quaternion.copy(this.camera.quaternion));
      this.fit();
      this.renderer.render(this.scene, this.camera);
      this.labels.render(this.scene, this.camera);
    });
  }

  /** Zoom, but not so far that a mark leaves the picture. */
  fit() {
    if (this.held) return; // a drag
    const {camera} = this, near = Math.min(1, 0.9 * camera.aspect) * this.zoom;
    Object.assign(camera, {zoom: near});
    camera.updateProjectionMatrix();
    const far = Math.max(...this.marks.flatMap((at) => {
      const {x, y} = at.clone().project(camera);
      return [Math.abs(x), Math.abs(y)];
    }), 0) / EDGE;
    if (far <= 1) return;
    camera.zoom = near / far;
    camera.updateProjectionMatrix();
  }
}
