// Draws a three.js scene on a plain canvas, far faces first, for browsers without WebGL. It knows what the 3-D view is made
// of: meshes whose geometry is a list of quads (`solids.triangles`), and lines.
import { BufferGeometry, Camera, Color, Fog, LineSegments, Matrix3, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial, Scene, Vector3 } from "three";

type Spot = readonly [number, number, number];

interface Face {
  readonly order: number;
  /** Distance of the vehicle or the like that the face belongs to, then of the face itself [m]. */
  readonly far: number;
  readonly depth: number;
  readonly points: readonly Spot[];
  readonly colour: string;
  readonly alpha: number;
  readonly isLine: boolean;
}

/** Faces nearer than this are cut off [m]. */
const NEAR = 0.3;
/** A vehicle may reach this far ahead of its middle [m]; what lies farther behind the camera is not looked at. */
const BEHIND = 15;
/** Where the light comes from, and how strong it is; `view3d` gives three's lights the same. */
export const LIGHT = { from: new Vector3(-0.45, 0.35, 0.82).normalize(), ambient: 0.55, direct: 0.5 };

/** The part of a polygon in front of the camera, which looks along -z. */
export function inFront(points: readonly Spot[], near = NEAR): Spot[] {
  return points.flatMap((b, i) => {
    const a = points[(i + points.length - 1) % points.length]!;
    const [da, db] = [-a[2] - near, -b[2] - near];
    const kept: Spot[] = [];
    if (da >= 0 !== db >= 0) {
      const t = da / (da - db);
      kept.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])]);
    }
    if (db >= 0) kept.push(b);
    return kept;
  });
}

export class Painter {
  readonly domElement: HTMLCanvasElement = document.createElement("canvas");
  private readonly pen = this.domElement.getContext("2d", { alpha: false })!;
  private size: readonly [number, number] = [1, 1];
  private pixels = 1;

  setPixelRatio(pixels: number): void {
    this.pixels = pixels;
  }

  setSize(width: number, height: number, _style = false): void {
    this.size = [width, height];
    this.domElement.width = Math.round(width * this.pixels);
    this.domElement.height = Math.round(height * this.pixels);
  }

  dispose(): void {
    this.domElement.remove();
  }

  render(scene: Scene, camera: Camera): void {
    scene.updateMatrixWorld();
    camera.updateMatrixWorld();
    const { pen, size: [width, height] } = this;
    pen.setTransform(this.pixels, 0, 0, this.pixels, 0, 0);
    blended.clear(); // the mist may have another colour
    const sky = scene.background instanceof Color ? scene.background : new Color("#888");
    pen.globalAlpha = 1;
    pen.fillStyle = `#${sky.getHexString()}`;
    pen.fillRect(0, 0, width, height);
    pen.lineJoin = "round";
    const found = facesOf(scene, camera);
    found.sort((a, b) => a.order - b.order || b.far - a.far || b.depth - a.depth);
    const p = camera.projectionMatrix.elements;
    for (const { points, colour, alpha, isLine } of found) {
      pen.beginPath();
      for (const [x, y, z] of points) pen.lineTo((1 + (p[0]! * x + p[8]! * z) / -z) * width / 2, (1 - (p[5]! * y + p[9]! * z) / -z) * height / 2);
      pen.globalAlpha = alpha;
      pen.strokeStyle = colour;
      pen.lineWidth = isLine ? 1.5 : 0.7; // a hair of the same colour closes the seams between faces
      if (!isLine) {
        pen.closePath();
        pen.fillStyle = colour;
        pen.fill();
      }
      if (isLine || alpha === 1) pen.stroke();
    }
    pen.globalAlpha = 1;
  }
}

const STEPS = 48;
const blended = new Map<number, string>();
const blend = new Color();

/** A colour in a light (1: as it is) and in mist (1: all mist), both in steps, as CSS writes it; each is made once. */
function mixed(colour: Color, light: number, mist: Color, share: number): string {
  const [a, b] = [Math.round(light * STEPS), Math.round(share * STEPS)];
  // Exact below 2^53: 24 bits of colour, and room for both steps.
  const key = (colour.getHex() * 128 + a) * 64 + b;
  let text = blended.get(key);
  if (text === undefined) {
    text = `#${blend.copy(colour).multiplyScalar(a / STEPS).lerp(mist, b / STEPS).getHexString()}`;
    blended.set(key, text);
  }
  return text;
}

function facesOf(scene: Scene, camera: Camera): Face[] {
  const found: Face[] = [];
  const toCamera = new Matrix4();
  const turned = new Matrix3();
  const place = new Vector3();
  const fog = scene.fog instanceof Fog ? scene.fog : null;
  scene.traverseVisible((object) => {
    const isMesh = object instanceof Mesh;
    if (!isMesh && !(object instanceof LineSegments)) return;
    const geometry = object.geometry as BufferGeometry;
    const material = object.material as MeshLambertMaterial | MeshBasicMaterial;
    const values = geometry.getAttribute("position").array;
    const count = Math.min(geometry.drawRange.count, values.length / 3);
    toCamera.multiplyMatrices(camera.matrixWorldInverse, object.matrixWorld);
    turned.setFromMatrix4(object.matrixWorld);
    // What belongs together is sorted as one, so that a car never shows through another.
    const owner = object.parent && object.parent !== scene ? object.parent : null;
    const far = owner ? -place.setFromMatrixPosition(owner.matrixWorld).applyMatrix4(camera.matrixWorldInverse).z : 0;
    if (owner && (far < -BEHIND || (fog && far > fog.far))) return;
    const vertex = (i: number): Spot => {
      place.set(values[3 * i]!, values[3 * i + 1]!, values[3 * i + 2]!).applyMatrix4(toCamera);
      return [place.x, place.y, place.z];
    };
    const add = (points: readonly Spot[], shade: number, isLine: boolean) => {
      if (points.length < 2) return;
      const depth = -points.reduce((sum, point) => sum + point[2], 0) / points.length;
      if (fog && depth > fog.far) return;
      const mist = fog && !isLine ? Math.max(0, (depth - fog.near) / (fog.far - fog.near)) : 0;
      const colour = mixed(material.color, shade, fog?.color ?? material.color, mist);
      found.push({ order: object.renderOrder, far, depth, points, colour, alpha: material.opacity, isLine });
    };
    if (!isMesh) {
      for (let i = 0; i + 1 < count; i += 2) {
        const line = [vertex(i), vertex(i + 1)];
        if (line.every((point) => -point[2] > NEAR)) add(line, 1, true);
      }
      return;
    }
    for (let i = 0; i + 5 < count; i += 6) {
      const quad = [vertex(i), vertex(i + 1), vertex(i + 2), vertex(i + 5)];
      const across = normalOf(quad[0]!, quad[1]!, quad[2]!);
      // The camera is at the origin of its own space.
      if (across[0] * quad[0]![0] + across[1] * quad[0]![1] + across[2] * quad[0]![2] >= 0) continue;
      let shade = 1;
      if (material instanceof MeshLambertMaterial) {
        const at = (k: number): Spot => [values[3 * (i + k)]!, values[3 * (i + k) + 1]!, values[3 * (i + k) + 2]!];
        place.set(...normalOf(at(0), at(1), at(2))).applyMatrix3(turned).normalize();
        shade = LIGHT.ambient + LIGHT.direct * Math.max(0, place.dot(LIGHT.from));
      }
      add(inFront(quad), shade, false);
    }
  });
  return found;
}

function normalOf(a: Spot, b: Spot, c: Spot): [number, number, number] {
  const [u, v] = [[b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]]] as const;
  return [u[1]! * v[2]! - u[2]! * v[1]!, u[2]! * v[0]! - u[0]! * v[2]!, u[0]! * v[1]! - u[1]! * v[0]!];
}
