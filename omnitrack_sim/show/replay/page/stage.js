// The scene: pipes, robots, lights, and what is switched about them.
import {
  BufferAttribute, BufferGeometry, Color, DirectionalLight, DoubleSide, Group, HemisphereLight,
  Mesh, MeshPhongMaterial, PointLight, Scene, SRGBColorSpace, Vector3,
} from "three";
import { columnsOf, flattened } from "replay/unpack";

export const PIPES = ["cut away", "translucent", "whole"];
export const SLIP_FULL = 0.5;
const SLIP_STOPS = ["#c9d3de", "#f5d573", "#f3883a", "#d5342a", "#7f0a2a"].map((c) => new Color(c));
const AIR = new Color("#3d434b");
const GHOST = "#5a6fb0";
const LAMP = 0.32; // brightness of the light at the nose, of a robot of scale 1
const [DAY, DUSK] = [1.9, 0.6]; // brightness around, outside the pipes and in them
const EDGE_ON = 0.3; // cosine to the cut below which a half would hide the robot

export class Stage {
  constructor(data, bytes, motions) {
    this.scene = new Scene();
    this.data = data;
    this.shapes = data.shapes.map((shape) => geometryOf(bytes, shape));
    this.addPipes();
    this.robots = motions.map((motion, index) => this.addRobot(motion, index > 0));
    this.sky = new HemisphereLight(0xffffff, 0x8f99a8, DAY);
    this.lamp = new PointLight(0xfff6e6, 0, 0, 1);
    this.scene.add(this.sky);
    if (data.onboard) {
      this.robots[0].objects[data.onboard.body].add(this.lamp);
      this.lamp.position.fromArray(data.onboard.lamp);
    }
    this.pipes = PIPES[0];
    this.slip = true;
  }

  /** The light over the shoulder of a camera. */
  lightFor(camera, brightness) {
    const light = new DirectionalLight(0xffffff, brightness);
    light.position.set(-0.5, 0.9, 0.6);
    light.target.position.set(0, 0, -1);
    camera.add(light, light.target);
    this.scene.add(camera);
  }

  addPipes() {
    const { pipes } = this.data;
    const color = new Color().setRGB(...pipes.pipe, SRGBColorSpace);
    const look = { color, shininess: 30, specular: 0x222222 };
    this.solid = new MeshPhongMaterial(look);
    this.skin = new MeshPhongMaterial({ ...look, side: DoubleSide });
    const ring = new Color().setRGB(...pipes.mark, SRGBColorSpace);
    this.ring = new MeshPhongMaterial({ ...look, color: ring });
    const glass = { ...look, transparent: true, depthWrite: false };
    this.clear = new MeshPhongMaterial({ ...glass, opacity: 0.26, side: DoubleSide });
    this.faded = new MeshPhongMaterial({ ...glass, opacity: 0.12 });
    this.parts = pipes.parts.map((part) => {
      const made = { cut: new Vector3(...part.cut), part };
      made.middle = new Vector3(...part.low).add(new Vector3(...part.high)).multiplyScalar(0.5);
      made.reach = made.middle.distanceTo(new Vector3(...part.high));
      for (const look of ["kept", "front", "inside"]) made[look] = this.addPiece(part[look]);
      made.marks = part.marks && this.addPiece(part.marks);
      if (made.marks) made.marks.material = this.ring;
      return made;
    });
    for (const plate of pipes.plates) {
      const mesh = this.addPiece(plate);
      const plateColour = new Color().setRGB(...plate.colour, SRGBColorSpace);
      mesh.material = new MeshPhongMaterial({ color: plateColour });
    }
  }

  addPiece(piece) {
    const mesh = new Mesh(this.shapes[piece.shape], this.solid);
    const [w, x, y, z] = piece.turn;
    mesh.position.fromArray(piece.position);
    mesh.quaternion.set(x, y, z, w);
    mesh.updateMatrixWorld();
    mesh.matrixAutoUpdate = false;
    this.scene.add(mesh);
    return mesh;
  }

  addRobot(motion, ghost) {
    const group = new Group();
    const { bodies } = motion.table.robot;
    const robot = { motion, group, objects: [], tracks: [] };
    for (const body of bodies) {
      const object = body.shape === undefined ? new Group() : this.addBody(body, ghost);
      object.name = body.name;
      group.add(object);
      robot.objects.push(object);
      if (body.on !== undefined && !ghost) robot.tracks.push({ body, object });
    }
    this.scene.add(group);
    return robot;
  }

  addBody(body, ghost) {
    const geometry = this.shapes[body.shape].clone();
    if (ghost) {
      const veil = { color: GHOST, transparent: true, opacity: 0.3, shininess: 10 };
      const mesh = new Mesh(geometry, new MeshPhongMaterial(veil));
      mesh.renderOrder = 2;
      return mesh;
    }
    const colours = new Float32Array(3 * geometry.attributes.position.count);
    const color = new Color();
    let at = 0;
    for (const [count, rgb] of body.colours) {
      color.setRGB(...rgb, SRGBColorSpace);
      for (let i = 0; i < count; i++, at += 3) color.toArray(colours, at);
    }
    geometry.setAttribute("color", new BufferAttribute(colours, 3));
    const look = { vertexColors: true, shininess: 45, specular: 0x2a2a2a };
    return new Mesh(geometry, new MeshPhongMaterial(look));
  }

  /** Move the robots to where they are now. */
  move() {
    for (const robot of this.robots) robot.motion.place(robot.objects);
    this.colourTracks();
  }

  colourTracks() {
    const { motion, tracks } = this.robots[0];
    for (const { body, object } of tracks) {
      const { material } = object;
      if (material.vertexColors === this.slip) {
        material.vertexColors = !this.slip;
        material.needsUpdate = true;
      }
      if (!this.slip) material.color.set(0xffffff);
      else if (!(motion.nearest(motion.curves.contact_count[2 * body.column + body.side]) > 0)) {
        material.color.copy(AIR);
      } else slipColour(motion.value("slip_ratio", body.column), material.color);
    }
  }

  /** Choose for each pipe what is seen of it by a camera in a mode. */
  openPipes(camera, mode, robot) {
    // From within only the inner surface is drawn: where the halves of a wall meet, or the ends of
    // two walls, the faces between them would be seen as a line.
    const within = mode === "onboard";
    for (const part of this.parts) {
      const { kept, front, inside } = part;
      const whole = this.pipes === "whole" && !within;
      const clear = this.pipes === "translucent" && !within;
      toCamera.copy(camera.position).sub(part.middle).normalize();
      const facing = whole || clear || within || mode === "follow" ? 0 : part.cut.dot(toCamera);
      kept.visible = whole || facing > EDGE_ON;
      front.visible = whole || facing < -EDGE_ON;
      inside.visible = !kept.visible && !front.visible;
      if (part.marks) part.marks.visible = within;
      const hides = inside.visible && !clear && mode === "follow" && inTheWay(part, camera, robot);
      const solid = within ? this.skin : this.solid;
      inside.material = clear ? this.clear : hides ? this.faded : solid;
      inside.renderOrder = clear || hides ? 3 : 0;
    }
    this.lamp.intensity = within ? LAMP * this.robots[0].motion.table.robot.scale : 0;
    this.sky.intensity = within ? DUSK : DAY;
  }
}

const toCamera = new Vector3();
const sight = new Vector3();
const nearestPoint = new Vector3();

/** Whether a pipe's box comes between the camera and the robot, and the robot is not in it. */
function inTheWay({ part }, camera, robot) {
  const inBox = (point) =>
    ["x", "y", "z"].every((axis, i) => part.low[i] <= point[axis] && point[axis] <= part.high[i]);
  if (inBox(robot)) return false;
  sight.copy(camera.position).sub(robot);
  for (let share = 0.1; share < 1; share += 0.06) {
    if (inBox(nearestPoint.copy(robot).addScaledVector(sight, share))) return true;
  }
  return false;
}

/** The colour of a slip ratio, by its size. */
export function slipColour(ratio, color = new Color()) {
  const place = Math.min(1, Math.abs(ratio) / SLIP_FULL) * (SLIP_STOPS.length - 1);
  const stop = Math.min(SLIP_STOPS.length - 2, Math.floor(place));
  return color.lerpColors(SLIP_STOPS[stop], SLIP_STOPS[stop + 1], place - stop);
}

function geometryOf(bytes, shape) {
  const geometry = new BufferGeometry();
  const normals = flattened(bytes, shape.normals, Int8Array);
  const vertices = flattened(bytes, shape.vertices, Float32Array);
  geometry.setAttribute("position", new BufferAttribute(vertices, 3));
  geometry.setAttribute("normal", new BufferAttribute(normals, 3, true));
  const [faces] = columnsOf(bytes, shape.faces);
  const Index = vertices.length / 3 > 65535 ? Uint32Array : Uint16Array;
  geometry.setIndex(new BufferAttribute(Index.from(faces), 1));
  return geometry;
}
