// Curves over time, one small plot a channel, with a cursor; a click or a drag goes to a time.
import { drag, element, sized, text3 } from "replay/words";

const SINGLE = "#22262b";
const GRID = "#d9dde3";
const [LEFT, RIGHT, TOP, BOTTOM] = [46, 8, 5, 16]; // px around the curves
const HEIGHT = 96;
const MAX_READOUTS = 6; // values beside a title; of more curves of one colour none can be told
const ANGLES = [1, 2, 5, 10, 15, 30, 45, 90, 180];

export class Plots {
  constructor(data, motions, span, seek) {
    this.motions = motions;
    this.colours = columnColours(data);
    this.span = span;
    this.seek = seek;
    this.box = document.getElementById("plots");
    this.plots = [];
    const chosen = document.getElementById("chosen");
    for (const panel of data.panels) {
      const plot = this.add(panel);
      const tick = element("input", { type: "checkbox", checked: panel.first });
      tick.addEventListener("change", () => {
        plot.figure.hidden = !tick.checked;
        this.resize();
      });
      const label = element("label", {}, tick, panel.title);
      chosen.append(label);
    }
    this.addKeys(data);
  }

  addKeys(data) {
    const keys = document.getElementById("keys");
    this.colours.forEach((colour, i) => {
      keys.append(element("span", {}, dash(colour), data.columns[i][0]));
    });
    for (const { heading, rows } of data.legends) {
      const group = element("div", { className: "parts" }, element("b", {}, heading));
      for (const [short, name, colour, number] of rows) {
        const sign = number ? element("i", { className: "badge" }, number) : dash(colour);
        if (number) sign.style.background = colour;
        group.append(element("span", { title: name }, sign, short));
      }
      keys.append(group);
    }
    if (data.panels.some((panel) => panel.command)) {
      keys.append(element("span", {}, dash(SINGLE, "dashed"), "command"));
    }
    if (data.runs.length > 1) keys.append(element("span", {}, dash("#8c93a0", "pale"), "second run"));
  }

  add(panel) {
    const head = element("figcaption", {}, element("b", {}, panel.title), ` ${unit(panel)} `);
    const values = element("span", { className: "values" });
    const canvas = element("canvas", { ariaLabel: `${panel.title}, ${panel.unit}, over time` });
    head.append(values);
    const figure = element("figure", { hidden: !panel.first }, head, canvas);
    this.box.append(figure);
    const plot = { panel, figure, canvas, values, picture: document.createElement("canvas") };
    plot.curves = this.curvesOf(panel);
    plot.bounds = boundsOf(panel, plot.curves);
    const told = plot.curves.filter((curve) => curve.told);
    const shown = told.length > MAX_READOUTS ? [] : told;
    plot.readouts = shown.map((curve) => {
      const readout = element("span", { title: curve.name });
      readout.style.color = curve.colour;
      values.append(readout);
      return { readout, curve };
    });
    drag(canvas, (x) => {
      const share = (x - LEFT) / (canvas.clientWidth - LEFT - RIGHT);
      this.seek(this.span[0] + share * (this.span[1] - this.span[0]));
    });
    this.plots.push(plot);
    return plot;
  }

  /** The curves of a panel, those that lie below first. */
  curvesOf(panel) {
    const curves = [];
    const add = (motion, name, look, told) => {
      const columns = motion.curves[name] ?? [];
      columns.forEach((values, i) => {
        const own = columns.length === this.colours.length ? this.colours[i] : SINGLE;
        const name = panel.names ? panel.names[i] : "";
        if (name === null) return; // it never acts
        const colour = panel.colours?.[i] ?? own;
        curves.push({ motion, values, colour, told, name, ...look });
      });
    };
    const [first, second] = this.motions;
    if (second) add(second, panel.channel, { width: 2.6, alpha: 0.38, dash: [] }, false);
    if (panel.command) add(first, panel.command, { width: 1, alpha: 0.85, dash: [5, 3] }, false);
    add(first, panel.channel, { width: 1.3, alpha: 1, dash: [] }, true);
    return curves;
  }

  resize() {
    for (const plot of this.plots) {
      if (plot.figure.hidden) continue;
      const ratio = sized(plot.canvas, plot.canvas.clientWidth, HEIGHT);
      plot.picture.width = plot.canvas.width;
      plot.picture.height = plot.canvas.height;
      this.paint(plot, ratio);
    }
    this.update(this.time ?? this.span[0]);
  }

  paint(plot, ratio) {
    const { panel, canvas, picture, curves, bounds } = plot;
    const pen = picture.getContext("2d");
    const width = canvas.clientWidth - LEFT - RIGHT;
    const height = HEIGHT - TOP - BOTTOM;
    if (width < 10) return;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, canvas.clientWidth, HEIGHT);
    const x = (time) => LEFT + ((time - this.span[0]) / (this.span[1] - this.span[0])) * width;
    const y = (value) => TOP + ((bounds[1] - value) / (bounds[1] - bounds[0])) * height;
    for (const phase of this.motions[0].table.phases) {
      pen.fillStyle = phase.colour;
      pen.fillRect(x(phase.start), TOP, x(phase.end) - x(phase.start), height);
    }
    this.paintGrid(pen, plot, x, y, width, height);
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, TOP - 1, width, height + 2);
    pen.clip();
    for (const curve of curves) paintCurve(pen, curve, panel, x, y);
    pen.restore();
  }

  paintGrid(pen, { panel, bounds }, x, y, width, height) {
    const steps = panel.wraps ? ANGLES : undefined;
    pen.font = "10px system-ui, sans-serif";
    pen.lineWidth = 1;
    pen.fillStyle = "#5b626c";
    pen.strokeStyle = GRID;
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    for (const value of ticks(bounds, 4, steps)) {
      line(pen, LEFT, y(value), LEFT + width, y(value));
      pen.fillText(tickText(value), LEFT - 5, y(value));
    }
    pen.textBaseline = "top";
    pen.textAlign = "center";
    for (const time of ticks(this.span, Math.max(3, Math.floor(width / 60)))) {
      line(pen, x(time), TOP, x(time), TOP + height);
      const text = `${tickText(time)} s`;
      const room = pen.measureText(text).width / 2;
      const middle = Math.min(LEFT + width - room, Math.max(LEFT + room, x(time)));
      pen.fillText(text, middle, TOP + height + 4);
    }
  }

  /** Move the cursor, and tell the values there. */
  update(time) {
    this.time = time;
    for (const { panel, figure, canvas, picture, readouts } of this.plots) {
      if (figure.hidden || !picture.width) continue;
      const ratio = canvas.width / canvas.clientWidth;
      const pen = canvas.getContext("2d");
      pen.setTransform(1, 0, 0, 1, 0, 0);
      pen.clearRect(0, 0, canvas.width, canvas.height);
      pen.drawImage(picture, 0, 0);
      pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      const width = canvas.clientWidth - LEFT - RIGHT;
      const at = LEFT + ((time - this.span[0]) / (this.span[1] - this.span[0])) * width;
      pen.strokeStyle = "#c8322b";
      pen.lineWidth = 1.4;
      line(pen, at, TOP, at, HEIGHT - BOTTOM);
      for (const { readout, curve } of readouts) {
        const near = panel.wraps ? "nearest" : "between";
        // What no legend above the plots tells stands beside its value.
        const word = curve.name && !panel.told ? `${curve.name} ` : "";
        readout.textContent = word + text3(curve.motion[near](curve.values) * panel.scale);
      }
    }
  }
}

/** CSS colours of the columns of channels with so many. */
export function columnColours(data) {
  return data.columns.map(([, rgb]) => `rgb(${rgb})`);
}

function unit(panel) {
  return panel.unit === "1" || !panel.unit ? "" : panel.unit;
}

function dash(colour, kind = "") {
  const sign = element("i", { className: `dash ${kind}` });
  sign.style.borderTopColor = colour;
  return sign;
}

function line(pen, x0, y0, x1, y1) {
  pen.beginPath();
  pen.moveTo(x0, y0);
  pen.lineTo(x1, y1);
  pen.stroke();
}

/** Lowest and highest value of a plot. */
function boundsOf(panel, curves) {
  let [low, high] = [Infinity, -Infinity];
  for (const { values } of curves) {
    for (const value of values) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (!(low <= high)) [low, high] = [0, 1];
  const room = 0.06 * (high - low) * panel.scale;
  low = panel.low ?? low * panel.scale - room;
  high = panel.high ?? high * panel.scale + room;
  const lacking = (panel.span || 1e-6 * Math.max(1, Math.abs(high))) - (high - low);
  if (lacking > 0) {
    if (panel.low === null) low -= lacking / 2;
    high += panel.low === null ? lacking / 2 : lacking;
  }
  return [low, high];
}

/** A curve; where many samples share a column of pixels, from their least to their greatest. */
function paintCurve(pen, { motion, values, colour, width, alpha, dash: pattern }, panel, x, y) {
  pen.strokeStyle = colour;
  pen.globalAlpha = alpha;
  pen.lineWidth = width;
  pen.setLineDash(pattern);
  pen.lineJoin = "round";
  pen.beginPath();
  const jump = panel.wraps ? 180 : Infinity;
  let drawn = false;
  let [last, column, low, high] = [NaN, NaN, NaN, NaN];
  for (let row = 0; row < values.length; row++) {
    const value = values[row] * panel.scale;
    if (!Number.isFinite(value)) {
      drawn = false;
      continue;
    }
    const at = x(motion.time[row]);
    const same = drawn && Math.round(at) === column && Math.abs(value - last) < jump;
    if (same && value >= low && value <= high) {
      last = value;
      continue;
    }
    if (drawn && Math.abs(value - last) < jump) pen.lineTo(at, y(value));
    else pen.moveTo(at, y(value));
    [low, high] = same ? [Math.min(low, value), Math.max(high, value)] : [value, value];
    [drawn, last, column] = [true, value, Math.round(at)];
  }
  pen.stroke();
  pen.globalAlpha = 1;
  pen.setLineDash([]);
}

/** Round numbers within bounds, about `count` >= 4 of them and at least two; `steps` are taken
 * before other ones where they give two. */
export function ticks(bounds, count, steps = []) {
  const found = spaced(bounds, count, steps);
  return found.length < 2 ? spaced(bounds, 2 * count, []) : found;
}

function spaced([low, high], count, steps) {
  const raw = (high - low) / count;
  if (!(raw > 0)) return [];
  const power = 10 ** Math.floor(Math.log10(raw));
  const enough = (step) => step >= 0.999 * raw;
  const step = steps.find(enough) ?? [1, 2, 5, 10].map((s) => s * power).find(enough);
  const found = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) found.push(i * step);
  return found;
}

function tickText(value) {
  return String(Number(value.toPrecision(6))).replace("-", "\u2212");
}
