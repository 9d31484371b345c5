// The 3-D view: the road and its vehicles as a three.js scene, seen from behind and above the AV, or from where a drag puts
// the camera. Loaded when it is first asked for.
import {
  AmbientLight, BufferAttribute, BufferGeometry, Color, DirectionalLight, EdgesGeometry, Fog, Group, LineBasicMaterial, LineSegments, Mesh,
  MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, Scene, ShapeUtils, Vector2, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { Case, Kind, Motion, Outline, Site } from "../../shared/case";
import type { Colours } from "../../shared/colours";
import { boxAt, criticalAt, touch } from "../../shared/motion";
import { WIDE, letterAt, lightColour } from "../../shared/site";
import { type Corners, type Line, MARKS, outlines, strokes, surfaceOf } from "../../shared/surface";
import { brakes, trail } from "../../shared/trails";
import { turned as turnedEye } from "./eye";
import { LIGHT, Painter } from "./painter";
import { type Stuff, faces, triangles, vehicleBlocks } from "./solids";

/** What the camera looks at is this far ahead of the AV and this high [m]. */
const [AHEAD, HIGH] = [2, 1];
const TILE = 40; // of the ground [m]
const ORDER = { verge: 0, road: 1, paint: 2, shadow: 3, trail: 4, solid: 5, ghost: 6, contact: 7 };

export interface Shown {
  readonly frame: number;
  /** Camera from what it looks at [m]. */
  readonly eye: readonly [number, number, number];
  readonly ghosts: readonly { readonly motion: Motion; readonly colour: string }[];
  /** Length of the trails [s]; 0: none. */
  readonly trail: number;
}

/** Where a name stands in the picture [px]. */
export interface Tag {
  readonly x: number;
  readonly y: number;
  readonly index: number;
}

export interface View3d {
  readonly element: HTMLCanvasElement;
  readonly isPainted: boolean;
  resize(width: number, height: number): void;
  /** Draw a moment and say where the AV and its partner are in the picture. */
  draw(shown: Shown): Tag[];
  dispose(): void;
}

type Renderer = Pick<Painter, "domElement" | "setSize" | "setPixelRatio" | "render" | "dispose">;

/** Whether a program on the processor draws what a graphics card should. */
function isImitated(context: WebGL2RenderingContext): boolean {
  const names = context.getExtension("WEBGL_debug_renderer_info");
  const name = String(context.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : context.RENDERER));
  const found = /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
  if (found) context.getExtension("WEBGL_lose_context")?.loseContext();
  return found;
}

/** WebGL where the machine has it; where a program would only imitate it, painting is several times faster. */
function makeRenderer(): { renderer: Renderer; isPainted: boolean } {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("webgl2", { antialias: true, failIfMajorPerformanceCaveat: true, powerPreference: "low-power" });
  if (!context || isImitated(context)) return { renderer: new Painter(), isPainted: true };
  return { renderer: new WebGLRenderer({ canvas, context, antialias: true }), isPainted: false };
}

/** `turned` is told where a drag or the wheel puts the camera. */
export function makeView3d(item: Case, colours: Colours, turned: (eye: [number, number, number]) => void): View3d {
  const { renderer, isPainted } = makeRenderer();
  const scene = new Scene();
  const camera = new PerspectiveCamera(50, 2, 0.3, 600);
  camera.up.set(0, 0, 1);
  const controls = new OrbitControls(camera, renderer.domElement);
  Object.assign(controls, { enablePan: false, enableDamping: false, minDistance: 5, maxDistance: 140, maxPolarAngle: 1.53, rotateSpeed: 0.6 });
  const world = new World(scene, item, colours);
  const target = new Vector3();
  let [isOurs, heading] = [false, 0]; // at a site the camera turns with the AV
  controls.addEventListener("change", () => {
    if (isOurs) return;
    const eye = camera.position.clone().sub(controls.target);
    const [x, y, z] = turnedEye([eye.x, eye.y, eye.z], -heading);
    turned([x, y, z]);
  });
  const size = { width: 1, height: 1 };
  return {
    element: renderer.domElement,
    isPainted,
    resize(width, height) {
      Object.assign(size, { width, height });
      renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
      renderer.setSize(width, height, false);
      camera.aspect = width / height;
      camera.fov = width < height * 1.2 ? 58 : 42;
      camera.updateProjectionMatrix();
    },
    draw(shown) {
      const av = boxAt(item.vehicles[0]!, shown.frame);
      if (!av) return [];
      world.put(shown);
      isOurs = true; // so that following the AV does not count as a drag
      heading = item.site ? av.h : 0;
      const [ahead, aside] = turnedEye([AHEAD, 0, 0], heading);
      target.set(av.x + ahead, av.y + aside, HIGH);
      controls.target.copy(target);
      const eye = turnedEye(shown.eye, heading);
      camera.position.set(target.x + eye[0], target.y + eye[1], target.z + eye[2]);
      camera.lookAt(target);
      controls.update();
      isOurs = false;
      renderer.render(scene, camera);
      return [0, item.partner].filter((index) => index >= 0).flatMap((index) => {
        const vehicle = item.vehicles[index]!;
        const box = boxAt(vehicle, shown.frame);
        if (!box) return [];
        const spot = new Vector3(box.x, box.y, heightOf(vehicle.kind) + 0.35).project(camera);
        if (spot.z > 1) return [];
        return [{ index, x: ((1 + spot.x) / 2) * size.width, y: ((1 - spot.y) / 2) * size.height }];
      });
    },
    dispose() {
      controls.dispose();
      world.dispose();
      renderer.dispose();
      // A browser has room for a few contexts only, and gives them back late.
      if (renderer instanceof WebGLRenderer) renderer.forceContextLoss();
      renderer.domElement.remove();
    },
  };
}

const heightOf = (kind: Kind): number => (kind === "truck" ? 3.7 : kind === "person" ? 1.8 : 1.6);

/** Everything that stands or moves in the scene. */
class World {
  private readonly vehicles: Group[];
  private readonly shades: Group[] = [];
  private readonly ribbons: Mesh<BufferGeometry, MeshBasicMaterial>[];
  private readonly ring: Mesh<BufferGeometry, MeshBasicMaterial>;
  private readonly lights: MeshBasicMaterial[];
  private readonly lamps = { on: new MeshBasicMaterial({ color: "#ff3b30" }), off: new MeshBasicMaterial({ color: "#6d1b16" }) };

  constructor(private readonly scene: Scene, private readonly item: Case, private readonly colours: Colours) {
    const sky = new Color(colours.verge).lerp(new Color("#7fa8c9"), 0.35);
    const isDark = sky.getHSL({ h: 0, s: 0, l: 0 }).l < 0.5;
    const green = new Color(colours.verge).lerp(new Color("#6f8f5a"), isDark ? 0.07 : 0.38);
    scene.background = sky;
    scene.fog = new Fog(sky, 90, 330);
    const sun = new DirectionalLight("#ffffff", LIGHT.direct * Math.PI);
    sun.position.copy(LIGHT.from);
    scene.add(new AmbientLight("#ffffff", LIGHT.ambient * Math.PI), sun);
    this.lights = item.site ? this.laySite(item.site, green) : [];
    if (!item.site) this.layRoad(green);
    this.vehicles = item.vehicles.map((vehicle) => this.makeVehicle(vehicle.kind, vehicle.length, vehicle.width));
    this.ribbons = item.vehicles.map(() => {
      const ribbon = flat([], colours.other, ORDER.trail);
      ribbon.geometry.setAttribute("position", new BufferAttribute(new Float32Array(18 * 40), 3));
      ribbon.frustumCulled = false;
      Object.assign(ribbon.material, { transparent: true, opacity: 0.55, depthWrite: false });
      return ribbon;
    });
    this.ring = flat(ringQuads(2.1, 0.22, 0.08), colours.contact, ORDER.contact);
    this.ring.material.depthTest = false; // it lies between the two, and shall be seen from wherever one looks
    scene.add(...this.vehicles, ...this.ribbons, this.ring);
  }

  /** Ground, lanes with their markings, and posts at the verge, which show how fast the AV is. */
  private layRoad(green: Color): void {
    const { item, colours, scene } = this;
    const places = item.vehicles[0]!.x.filter((x) => x !== null);
    const [from, to] = [Math.floor((Math.min(...places) - 180) / 12) * 12, Math.max(...places) + 360];
    const steps = Array.from({ length: Math.ceil((to - from) / 12) }, (_, i) => from + 12 * i);
    const wide = item.lanes * item.laneWidth;
    const surface = surfaceOf(item);
    // In pieces, of which the painter leaves out what is far.
    const strip = ([[x0, r0], [x1, r1], [, l1], [, l0]]: Corners, z: number): Quad[] => steps.flatMap((step) => {
      const [a, b] = [Math.max(step, x0), Math.min(step + 12, x1)];
      const at = (x: number, y0: number, y1: number) => [x, y0 + ((y1 - y0) * (x - x0)) / (x1 - x0), z] as const;
      return a < b ? [[at(a, r0, r1), at(b, r0, r1), at(b, l0, l1), at(a, l0, l1)]] : [];
    });
    const painted = (line: Line) => strokes(line, from, to).flatMap(([[x0, y0], [x1, y1]]) => {
      const h = 0.6 * MARKS[line[4]][0];
      return strip(x0 === x1 ? [[x0 - h, y0], [x0 + h, y0], [x0 + h, y1], [x0 - h, y1]] : [[x0, y0 - h], [x1, y1 - h], [x1, y1 + h], [x0, y0 + h]], 0.01);
    });
    const asphalt = outlines(surface, from, to, 0.9).flatMap((corners) => strip(corners, 0));
    const [barriers, lines] = [true, false].map((wish) => surface.lines.filter((line) => (line[4] === "barrier") === wish)) as [Line[], Line[]];
    const sides = [[-500, -0.9], [-0.9, wide + 0.9], [wide + 0.9, wide + 500]] as const;
    const grass = flat(sides.flatMap(([y0, y1]) => steps.map((x) => patch(x, x + 12, y0, y1, -0.02))), green, ORDER.verge);
    grass.material.depthWrite = false;
    scene.add(
      grass,
      flat(asphalt, colours.road, ORDER.road),
      flat(lines.flatMap(painted), colours.paint, ORDER.paint),
      flat(barriers.flatMap(painted), colours.contact, ORDER.paint),
    );
    const stand = (x: number, y: number, half: number, colour: string) => {
      const group = new Group(); // one each, so that the painter can tell which is farther
      group.position.set(x, y, 0);
      group.add(solid(faces({ stuff: "body", bottom: [-half, half, half], top: [-half, half, half], from: 0, to: 1 }), new MeshLambertMaterial({ color: colour })));
      scene.add(group);
    };
    for (const x of steps.filter((_, i) => i % 3 === 0)) {
      const here = asphalt.filter(([a, b]) => a![0] <= x && x < b![0]);
      stand(x, Math.min(...here.map((quad) => quad[0]![1])) - 0.7, 0.06, colours.muted);
      stand(x, Math.max(...here.map((quad) => quad[3]![1])) + 0.7, 0.06, colours.muted);
    }
    for (const [x0, y0, x1, y1] of barriers) {
      if (x0 === x1) [0.2, 0.5, 0.8].forEach((part) => stand(x0!, y0 + part * (y1 - y0), 0.15, colours.contact));
      else steps.filter((x) => x > (x0 ?? from) && x < (x1 ?? to)).forEach((x) => stand(x, y0, 0.15, colours.contact));
    }
  }

  /** Ground, lanes, crosswalks and stop lines of a site; what is returned colours its lights. */
  private laySite(site: Site, green: Color): MeshBasicMaterial[] {
    const { colours, scene } = this;
    const places = site.lanes.flat();
    const [xs, ys] = [0, 1].map((k) => places.filter((_, i) => i % 2 === k)) as [number[], number[]];
    const reach = (values: number[]) => {
      const [from, to] = [Math.min(...values) - 240, Math.max(...values) + 240];
      return Array.from({ length: Math.ceil((to - from) / TILE) }, (_, i) => from + TILE * i);
    };
    const grass = flat(reach(xs).flatMap((x) => reach(ys).map((y) => patch(x, x + TILE, y, y + TILE, -0.02))), green, ORDER.verge);
    grass.material.depthWrite = false;
    const lines = (all: readonly Outline[], wide: number) => all.flatMap((line) => bands(line, 1.3 * wide, 0.012));
    scene.add(
      grass,
      flat([...site.lanes.flatMap((lane) => tiles(lane, 0)), ...site.lanes.flatMap((lane) => bands(lane, 1.2, 0))], colours.road, ORDER.road),
      flat([...lines(site.edges, WIDE.edge), ...site.bars.flatMap((bar) => tiles(bar, 0.01)), ...lines(site.stops, WIDE.stop)], colours.paint, ORDER.paint),
    );
    return site.lights.map(({ at, walks }) => {
      const material = new MeshBasicMaterial({ color: colours["signal-red"] });
      const stroke = solid(bands(at, walks ? 0.5 : 0.9, 0.02), material);
      stroke.renderOrder = ORDER.paint;
      scene.add(stroke);
      return material;
    });
  }

  private makeVehicle(kind: Kind, length: number, width: number): Group {
    const group = new Group();
    const blocks = vehicleBlocks(kind, length, width);
    const materials: Record<Stuff, MeshLambertMaterial | MeshBasicMaterial> = {
      body: new MeshLambertMaterial({ color: this.colours.other }),
      load: new MeshLambertMaterial({ color: this.colours.other }),
      glass: new MeshLambertMaterial({ color: "#1d2a36" }),
      dark: new MeshLambertMaterial({ color: "#1b1b1d" }),
      "rear lamp": this.lamps.off,
      "head lamp": new MeshBasicMaterial({ color: "#fff6d8" }),
    };
    for (const stuff of Object.keys(materials) as Stuff[]) {
      const quads = blocks.filter((block) => block.stuff === stuff).flatMap(faces);
      if (quads.length === 0) continue;
      const mesh = solid(quads, materials[stuff]);
      mesh.name = stuff;
      group.add(mesh);
    }
    const shadow = flat([patch(-length / 2 - 0.15, length / 2 + 0.15, -width / 2 - 0.15, width / 2 + 0.15, 0.02)], "#000000", ORDER.shadow);
    Object.assign(shadow.material, { transparent: true, opacity: 0.35, depthWrite: false });
    group.add(shadow);
    return group;
  }

  private makeShade(motion: Motion, colour: string): Group {
    const group = new Group();
    const quads = vehicleBlocks("car", motion.length, motion.width).filter(({ stuff }) => stuff === "body" || stuff === "glass").flatMap(faces);
    const body = solid(quads, new MeshBasicMaterial({ color: colour, transparent: true, opacity: 0.16, depthWrite: false }));
    const lines = new LineSegments(new EdgesGeometry(body.geometry, 1), new LineBasicMaterial({ color: colour }));
    body.renderOrder = lines.renderOrder = ORDER.ghost;
    group.add(body, lines);
    return group;
  }

  put({ frame, ghosts, trail: seconds }: Shown): void {
    const { item, colours } = this;
    const critical = criticalAt(item, frame);
    item.vehicles.forEach((vehicle, index) => {
      const [group, ribbon] = [this.vehicles[index]!, this.ribbons[index]!];
      const box = boxAt(vehicle, frame);
      group.visible = box !== null;
      ribbon.visible = box !== null && seconds > 0;
      if (!box) return;
      group.position.set(box.x, box.y, 0);
      group.rotation.z = box.h;
      const colour = index === 0 ? colours.av : index === item.partner ? colours.partner : index === critical ? colours.critical : vehicle.kind === "person" ? colours.person : colours.other;
      for (const part of group.children as Mesh<BufferGeometry, MeshLambertMaterial>[]) {
        if (part.name === "body") part.material.color.set(colour);
        if (part.name === "load") part.material.color.set(colour).lerp(new Color("#ffffff"), 0.35);
        if (part.name === "rear lamp") (part as Mesh).material = brakes(vehicle, frame, item.dt) ? this.lamps.on : this.lamps.off;
      }
      if (ribbon.visible) {
        ribbon.material.color.set(colour);
        lay(ribbon.geometry, trail(vehicle, frame, seconds, item.dt));
      }
    });
    item.site?.lights.forEach((light, i) => this.lights[i]!.color.set(lightColour(letterAt(light, frame), colours)));
    this.putShades(frame, ghosts);
    const pair = [0, item.partner].map((index) => (index >= 0 ? boxAt(item.vehicles[index]!, frame) : null));
    const met = item.crash !== null && frame >= item.crash && pair[0] && pair[1] ? touch(pair[0], pair[1]) : null;
    this.ring.visible = met !== null;
    if (met) this.ring.position.set(met.middle[0], met.middle[1], 1.6);
  }

  private putShades(frame: number, ghosts: Shown["ghosts"]): void {
    const isSame = ghosts.length === this.shades.length && ghosts.every(({ motion }, i) => this.shades[i]!.userData.motion === motion);
    if (!isSame) {
      for (const shade of this.shades.splice(0)) {
        this.scene.remove(shade);
        release(shade);
      }
      for (const { motion, colour } of ghosts) {
        const shade = this.makeShade(motion, colour);
        shade.userData.motion = motion;
        this.shades.push(shade);
        this.scene.add(shade);
      }
    }
    ghosts.forEach(({ motion }, i) => {
      const [shade, box] = [this.shades[i]!, boxAt(motion, frame)];
      shade.visible = box !== null;
      if (!box) return;
      shade.position.set(box.x, box.y, 0);
      shade.rotation.z = box.h;
    });
  }

  dispose(): void {
    release(this.scene);
  }
}

function release(root: Group | Scene): void {
  root.traverse((object) => {
    if (!(object instanceof Mesh || object instanceof LineSegments)) return;
    object.geometry.dispose();
    object.material.dispose();
  });
}

type Quad = readonly (readonly [number, number, number])[];

const patch = (x0: number, x1: number, y0: number, y1: number, z: number): Quad => [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]];

/** A filled outline on the ground, in triangles: quads whose last two corners are one. */
function tiles(outline: Outline, z: number): Quad[] {
  const points = Array.from({ length: outline.length / 2 }, (_, i) => new Vector2(outline[2 * i], outline[2 * i + 1]));
  if (ShapeUtils.isClockWise(points)) points.reverse();
  return ShapeUtils.triangulateShape(points, []).map((three) => {
    const [a, b, c] = three.map((i) => [points[i]!.x, points[i]!.y, z] as const);
    return [a!, b!, c!, c!];
  });
}

/** A line on the ground, so wide [m]. */
function bands(line: Outline, wide: number, z: number): Quad[] {
  return Array.from({ length: line.length / 2 - 1 }, (_, i): Quad => {
    const [x0, y0, x1, y1] = line.slice(2 * i, 2 * i + 4) as [number, number, number, number];
    const long = Math.hypot(x1 - x0, y1 - y0) || 1;
    const [dx, dy] = [(-(y1 - y0) / long) * (wide / 2), ((x1 - x0) / long) * (wide / 2)];
    return [[x0 - dx, y0 - dy, z], [x1 - dx, y1 - dy, z], [x1 + dx, y1 + dy, z], [x0 + dx, y0 + dy, z]];
  });
}

function solid<M extends MeshLambertMaterial | MeshBasicMaterial>(quads: readonly Quad[], material: M): Mesh<BufferGeometry, M> {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(triangles(quads), 3));
  geometry.computeVertexNormals();
  const mesh = new Mesh(geometry, material);
  mesh.renderOrder = ORDER.solid;
  return mesh;
}

/** Something flat on the ground, which no light changes. */
function flat(quads: readonly Quad[], colour: string | Color, order: number): Mesh<BufferGeometry, MeshBasicMaterial> {
  const mesh = solid(quads, new MeshBasicMaterial({ color: colour }));
  mesh.renderOrder = order;
  return mesh;
}

/** A flat ring around the origin, seen from above. */
function ringQuads(radius: number, wide: number, z: number): Quad[] {
  const at = (k: number, r: number): [number, number, number] => [r * Math.cos((k * Math.PI) / 12), r * Math.sin((k * Math.PI) / 12), z];
  return Array.from({ length: 24 }, (_, k) => [at(k, radius), at(k, radius + wide), at(k + 1, radius + wide), at(k + 1, radius)]);
}

/** Lay a ribbon on the ground along a trail, which is given newest first. */
function lay(geometry: BufferGeometry, points: readonly { readonly x: number; readonly y: number }[]): void {
  const positions = geometry.getAttribute("position") as BufferAttribute;
  const half = 0.14;
  const most = Math.min(points.length - 1, positions.count / 6);
  const quads: Quad[] = [];
  for (let i = 0; i < most; i++) {
    const [a, b] = [points[i]!, points[i + 1]!];
    const long = Math.hypot(a.x - b.x, a.y - b.y) || 1;
    const [dx, dy] = [(-half * (a.y - b.y)) / long, (half * (a.x - b.x)) / long];
    quads.push([[b.x - dx, b.y - dy, 0.03], [a.x - dx, a.y - dy, 0.03], [a.x + dx, a.y + dy, 0.03], [b.x + dx, b.y + dy, 0.03]]);
  }
  (positions.array as Float32Array).set(triangles(quads));
  positions.needsUpdate = true;
  geometry.setDrawRange(0, 6 * quads.length);
}
