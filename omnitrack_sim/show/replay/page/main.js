// The page: state, loop, keys, and window.replay for whoever drives it by script.
import { Quaternion, Vector3, WebGLRenderer } from "three";
import { Arrows } from "replay/arrows";
import { CAMERAS, Cameras } from "replay/cameras";
import { Chart } from "replay/chart";
import { Motion } from "replay/motion";
import { RobotPictures } from "replay/pictures";
import { Plots } from "replay/plots";
import { PIPES, SLIP_FULL, Stage, slipColour } from "replay/stage";
import { listEvents, Strip } from "replay/strip";
import { unpacked } from "replay/unpack";
import { chooser, element, tellFigures, tellHead, tellHelp } from "replay/words";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8];
const KEYS = [
  ["space", "play or pause"],
  ["\u2190 \u2192", "0.1 s back or on; with shift 1 s"],
  ["home, end", "to the beginning or the end"],
  ["1 2 3", "camera: orbit, follow, onboard"],
  ["p", "pipes: cut away, translucent, whole"],
  ["t", "tracks: coloured by slip, or as they are"],
  ["f", "arrows of the forces on or off"],
  ["+ \u2212", "faster, slower"],
  ["?", "this list on or off"],
];
const at = (id) => document.getElementById(id);
const SMALL = 60; // px that numbered bodies lie apart, below which their numbers would overlap
const TABS = ["plots", "events", "figures"];

class Replay {
  constructor(data, bytes) {
    this.data = data;
    this.motions = data.runs.map((run) => new Motion(run, bytes));
    const ends = this.motions.map((motion) => motion.end);
    this.span = [this.motions[0].start, Math.max(...ends)];
    if (!(this.span[1] > this.span[0])) this.span[1] = this.span[0] + 1;
    this.time = this.span[0];
    this.playing = false;
    this.speed = 1;
    this.frames = 0;
    this.ready = false;
    const seek = (time) => this.seek(time);
    tellHead(data);
    tellFigures(data);
    this.views = CAMERAS.filter((name) => name !== "onboard" || data.onboard);
    this.tracks = data.runs[0].robot.bodies.some((body) => body.on !== undefined);
    const idle = { t: !this.tracks, f: !this.motions[0].arrows.length };
    tellHelp(data, KEYS.filter(([key]) => !idle[key]));
    listEvents(data.runs[0], seek);
    this.plots = new Plots(data, this.motions, this.span, seek);
    this.strip = new Strip(this.motions[0], this.span, seek);
    if (data.map) this.chart = new Chart(data.map, this.motions[0], bytes);
    if (data.pictures) {
      this.pictures = new RobotPictures(data.pictures, () => (this.stale = true));
    }
    this.openStage(bytes);
    this.addControls();
    this.addTransport();
    this.fromAddress();
    new ResizeObserver(() => this.resize()).observe(at("view"));
    new ResizeObserver(() => this.resize()).observe(at("right"));
    this.resize();
  }

  /** Without WebGL there is no picture, but all the rest. */
  openStage(bytes) {
    const { data, motions } = this;
    try {
      this.renderer = new WebGLRenderer({ canvas: at("stage"), antialias: true, alpha: true });
    } catch (error) {
      for (const id of ["choices", "legend"]) at(id).hidden = true;
      at("message").textContent = `no picture: ${error.message}`;
      return;
    }
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
    this.stage = new Stage(data, bytes, motions);
    this.cameras = new Cameras(data, bytes, motions[0], at("stage"));
    this.stage.lightFor(this.cameras.outside, 1.7);
    this.stage.lightFor(this.cameras.onboard, 0.2);
    this.arrows = new Arrows(this.stage.scene, motions[0], data.arrows);
    this.cameras.controls.addEventListener("change", () => (this.stale = true));
    this.badges = motions[0].table.robot.badges.map(([, text, colour]) => {
      const badge = element("span", {}, text);
      badge.style.background = colour;
      at("badges").append(badge);
      return badge;
    });
  }

  addControls() {
    this.markCamera = chooser("cameras", this.views.map((name, i) => [name, `camera (${i + 1})`]),
      (name) => this.setCamera(name));
    this.markPipes = chooser("pipes", PIPES.map((name) => [name, "pipes (p)"]),
      (name) => this.setPipes(name));
    const extra = (name, title, act) => {
      const button = element("button", { title, onclick: act }, name);
      at("extras").append(button);
      return button;
    };
    this.slipButton = !this.tracks ? null : extra("slip", "colour the tracks by slip (t)", () => this.setSlip(!this.stage.slip));
    const arrows = this.motions[0].arrows.length;
    this.forceButton = !arrows ? null : extra("forces", "arrows of forces (f)", () => this.setForces(!this.arrows.visible));
  }

  addTransport() {
    at("play").addEventListener("click", () => this.toggle());
    const scrub = at("scrub");
    [scrub.min, scrub.max] = this.span;
    scrub.addEventListener("input", () => this.seek(Number(scrub.value)));
    for (const speed of SPEEDS) {
      at("speed").append(element("option", { value: speed, selected: speed === 1 }, `${speed}\u00d7`));
    }
    at("speed").addEventListener("change", () => (this.speed = Number(at("speed").value)));
    at("help-button").addEventListener("click", () => at("help").showModal());
    const markTab = chooser("tabs", TABS.map((name) => [name, ""]), (name) => show(name));
    const show = (name) => {
      for (const tab of TABS) at(`${tab}-tab`).hidden = tab !== name;
      markTab(name);
      this.plots.resize();
    };
    markTab(TABS[0]);
    window.addEventListener("keydown", (event) => this.key(event));
  }

  /** What the address asks for after #, such as t=3.5&camera=follow&pipes=whole. */
  fromAddress() {
    const asked = new URLSearchParams(location.hash.slice(1));
    const camera = asked.get("camera");
    this.setCamera(this.views.includes(camera) ? camera : this.data.map ? "follow" : "orbit");
    this.setPipes(PIPES.includes(asked.get("pipes")) ? asked.get("pipes") : PIPES[0]);
    this.setSlip(asked.get("slip") !== "off");
    this.setForces(asked.get("forces") !== "off");
    if (Number.isFinite(Number.parseFloat(asked.get("t")))) this.seek(Number.parseFloat(asked.get("t")));
  }

  get duration() {
    return this.span[1] - this.span[0];
  }

  seek(time) {
    this.time = Math.min(this.span[1], Math.max(this.span[0], time));
    this.stale = true;
  }

  toggle() {
    if (!this.playing && this.time >= this.span[1]) this.seek(this.span[0]);
    this.playing = !this.playing;
    at("play").classList.toggle("on", this.playing);
    at("play").ariaLabel = this.playing ? "pause" : "play";
  }

  setCamera(name) {
    if (!this.stage || !this.views.includes(name)) return;
    this.cameras.choose(name);
    this.markCamera(name);
    this.stale = true;
  }

  setPipes(name) {
    if (!this.stage) return;
    this.stage.pipes = name;
    this.markPipes(name);
    this.stale = true;
  }

  setSlip(on) {
    if (!this.stage || !this.tracks) return;
    this.stage.slip = on;
    this.slipButton.ariaPressed = String(on);
    this.tellLegend();
  }

  setForces(on) {
    if (!this.stage || !this.forceButton) return;
    this.arrows.visible = on;
    this.forceButton.ariaPressed = String(on);
    this.tellLegend();
  }

  tellLegend() {
    this.stale = true;
    const legend = at("legend");
    legend.replaceChildren();
    if (this.tracks && this.stage.slip) {
      const bar = element("i", { className: "bar" });
      const stops = [0, 0.25, 0.5, 0.75, 1].map((s) => `#${slipColour(s * SLIP_FULL).getHexString()}`);
      bar.style.background = `linear-gradient(90deg, ${stops.join(", ")})`;
      const air = element("i", { className: "air" });
      legend.append(element("div", {}, "slip ratio 0 ", bar, ` \u2265 ${SLIP_FULL}`));
      legend.append(element("div", {}, air, " track off the wall"));
    }
    if (this.motions.length > 1) {
      const veil = element("i", { className: "veil" });
      legend.append(element("div", {}, veil, " second run, translucent"));
    }
    const kinds = this.arrows.visible ? Object.values(this.data.arrows) : [];
    for (const { words, colour, scale } of kinds) {
      const sign = element("i", { className: "arrow" });
      sign.style.color = colour;
      const long = 0.01 / scale;
      legend.append(element("div", {}, sign, ` ${words}, ${Number(long.toPrecision(3))} N for 10 mm`));
    }
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (at("help").open) {
      if (event.key === "?") at("help").close();
      return;
    }
    if (event.target.tagName === "SELECT" || event.target.type === "checkbox") return;
    const { key } = event;
    const step = event.shiftKey ? 1 : 0.1;
    const next = (list, one) => list[(list.indexOf(one) + 1) % list.length];
    const acts = {
      " ": () => this.toggle(),
      ArrowLeft: () => this.seek(this.time - step),
      ArrowRight: () => this.seek(this.time + step),
      Home: () => this.seek(this.span[0]),
      End: () => this.seek(this.span[1]),
      1: () => this.setCamera(CAMERAS[0]),
      2: () => this.setCamera(CAMERAS[1]),
      3: () => this.setCamera(CAMERAS[2]),
      p: () => this.setPipes(next(PIPES, this.stage?.pipes)),
      t: () => this.setSlip(!this.stage?.slip),
      f: () => this.setForces(!this.arrows?.visible),
      "+": () => this.faster(1),
      "-": () => this.faster(-1),
      "?": () => at("help").showModal(),
    };
    if (!Object.hasOwn(acts, key)) return;
    event.preventDefault();
    acts[key]();
  }

  faster(steps) {
    const place = SPEEDS.indexOf(this.speed) + steps;
    this.speed = SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, place))];
    at("speed").value = this.speed;
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = at("view");
    if (width < 1 || height < 1) return;
    this.renderer?.setSize(width, height, false);
    this.cameras?.resize(width, height);
    this.chart?.resize(width, height);
    this.plots.resize();
    this.strip.resize();
    this.stale = true;
  }

  /** One frame of the browser: time goes on, and what has changed is drawn. */
  frame(now) {
    if (this.playing) {
      this.seek(this.time + (this.speed * (now - (this.before ?? now))) / 1000);
      if (this.time >= this.span[1]) this.toggle();
    }
    this.before = now;
    if (this.stale) this.draw();
  }

  draw() {
    this.stale = false;
    for (const motion of this.motions) motion.seek(this.time);
    if (this.stage) this.drawStage();
    this.chart?.update();
    this.pictures?.update(this.time);
    this.plots.update(this.time);
    this.strip.update(this.time);
    this.tellState();
    this.frames += 1;
  }

  drawStage() {
    const { stage, cameras, data } = this;
    const { objects } = stage.robots[0];
    const [chassis] = objects;
    stage.move();
    cameras.update(chassis, objects[data.onboard?.body ?? 0]);
    stage.openPipes(cameras.camera, cameras.mode, chassis.position);
    this.arrows.update();
    this.renderer.render(stage.scene, cameras.camera);
    this.placeBadges();
  }

  /** Numbers on the modules; dots where the robot is too small for them. */
  placeBadges() {
    const { clientWidth: width, clientHeight: height } = at("stage");
    const { camera, mode } = this.cameras;
    const places = this.motions[0].table.robot.badges.map(([body]) => {
      this.motions[0].pose(body, point, turn);
      point.project(camera);
      return [((point.x + 1) / 2) * width, ((1 - point.y) / 2) * height, point.z];
    });
    const [xs, ys] = [0, 1].map((i) => places.map((place) => place[i]));
    const spread = Math.max(...xs) - Math.min(...xs) + Math.max(...ys) - Math.min(...ys);
    places.forEach(([x, y, depth], i) => {
      const badge = this.badges[i];
      badge.hidden = mode === "onboard" || Math.abs(depth) > 1;
      badge.className = spread < SMALL ? "dot" : "";
      badge.style.left = `${x}px`;
      badge.style.top = `${y}px`;
    });
  }

  tellState() {
    const [motion] = this.motions;
    const { phases, fittings } = motion.table;
    const fitting = Motion.spanAt(fittings, this.time);
    const leg = fitting.leg ? `, leg ${fitting.leg}` : "";
    at("clock").textContent = `${this.time.toFixed(2)} / ${this.span[1].toFixed(2)} s`;
    at("scrub").value = this.time;
    at("state").replaceChildren(
      element("b", {}, Motion.spanAt(phases, this.time)?.name ?? ""),
      element("span", {}, `in ${fitting.name}${leg}${fitting.tail ? ", tail first" : ""}`),
      element("span", {}, this.data.state.map(([name, words, scale, digits, unit]) =>
        `${words}${(scale * motion.value(name)).toFixed(digits)}${unit}`).join(", ")),
    );
  }

  /** Where a body of a run is now: {position: [x, y, z] m, quaternion: [w, x, y, z]}. */
  pose(name, run = 0) {
    for (const motion of this.motions) motion.seek(this.time);
    this.stage.move();
    const body = this.stage.robots[run].objects.find((object) => object.name === name);
    if (!body) throw new Error(`there is no body ${name}`);
    const { x, y, z, w } = body.quaternion;
    return { position: body.position.toArray(), quaternion: [w, x, y, z] };
  }

  get bodies() {
    return this.motions[0].table.robot.bodies.map((body) => body.name);
  }

  /** Draw calls and triangles of the last picture. */
  get counts() {
    const { calls, triangles } = this.renderer.info.render;
    return { calls, triangles };
  }
}

const point = new Vector3();
const turn = new Quaternion();
const data = JSON.parse(at("data").textContent);
const replay = new Replay(data, await unpacked(data.data));
window.replay = replay;
const loop = (now) => {
  replay.frame(now);
  requestAnimationFrame(loop);
};
replay.draw();
replay.ready = true;
at("message").hidden = Boolean(replay.stage);
requestAnimationFrame(loop);
