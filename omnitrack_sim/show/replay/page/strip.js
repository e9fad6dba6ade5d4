// The time line: fittings, phases and events; a click or a drag goes to a time.
import { ticks } from "replay/plots";
import { drag, element, sized } from "replay/words";

const [FITTINGS, PHASES, EVENTS, TIMES] = [18, 18, 16, 14]; // heights of the rows, px
const HEIGHT = FITTINGS + PHASES + EVENTS + TIMES;
const REACH = 8; // px from an event within which it is meant

export class Strip {
  constructor(motion, span, seek) {
    this.table = motion.table;
    this.span = span;
    this.canvas = document.getElementById("strip");
    this.picture = document.createElement("canvas");
    this.tip = document.getElementById("tip");
    drag(this.canvas, (x) => seek(this.timeAt(x)));
    this.canvas.addEventListener("pointermove", (event) => this.tell(event));
    this.canvas.addEventListener("pointerdown", (event) => this.tell(event));
    this.canvas.addEventListener("pointerleave", () => (this.tip.hidden = true));
  }

  x(time) {
    return ((time - this.span[0]) / (this.span[1] - this.span[0])) * this.canvas.clientWidth;
  }

  timeAt(x) {
    return this.span[0] + (x / this.canvas.clientWidth) * (this.span[1] - this.span[0]);
  }

  resize() {
    const ratio = sized(this.canvas, this.canvas.clientWidth, HEIGHT);
    this.picture.width = this.canvas.width;
    this.picture.height = this.canvas.height;
    const pen = this.picture.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, this.canvas.clientWidth, HEIGHT);
    pen.font = "11px system-ui, sans-serif";
    this.bands(pen, this.table.fittings, 0, FITTINGS);
    this.bands(pen, this.table.phases, FITTINGS, PHASES);
    for (const { time } of this.table.events) this.mark(pen, this.x(time));
    pen.fillStyle = "#5b626c";
    pen.textBaseline = "top";
    const width = this.canvas.clientWidth;
    for (const time of ticks(this.span, Math.max(3, Math.floor(width / 80)))) {
      const text = `${Number(time.toPrecision(6))} s`;
      pen.textAlign = this.x(time) < 15 ? "left" : this.x(time) > width - 15 ? "right" : "center";
      pen.fillText(text, this.x(time), HEIGHT - TIMES + 1);
    }
    this.update(this.time ?? this.span[0]);
  }

  bands(pen, spans, top, height) {
    pen.textBaseline = "middle";
    pen.textAlign = "center";
    for (const { name, colour, start, end } of spans) {
      const [left, right] = [this.x(start), this.x(end)];
      pen.fillStyle = colour;
      pen.fillRect(left, top, right - left, height - 1);
      pen.strokeStyle = "#b9bec6";
      pen.strokeRect(left, top + 0.5, right - left, height - 2);
      pen.fillStyle = "#22262b";
      if (pen.measureText(name).width < right - left - 6) {
        pen.fillText(name, (left + right) / 2, top + height / 2);
      }
    }
  }

  mark(pen, x) {
    const middle = FITTINGS + PHASES + EVENTS / 2;
    pen.fillStyle = "#c8322b";
    pen.beginPath();
    pen.moveTo(x, middle - 6);
    pen.lineTo(x + 5, middle);
    pen.lineTo(x, middle + 6);
    pen.lineTo(x - 5, middle);
    pen.fill();
  }

  /** Tell the event, phase or fitting under the pointer. */
  tell(event) {
    const box = this.canvas.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    const time = this.timeAt(x);
    const under = (spans) => spans.findLast((span) => span.start <= time && time <= span.end);
    let words = null;
    if (y < FITTINGS) {
      const fitting = under(this.table.fittings);
      words = fitting && `${fitting.name}: ${fitting.manoeuvre}`;
      if (fitting?.leg) words += `, leg ${fitting.leg}`;
      if (fitting?.tail) words += ", tail first";
    } else if (y < FITTINGS + PHASES) words = under(this.table.phases)?.name;
    else {
      const near = this.table.events.filter((one) => Math.abs(this.x(one.time) - x) < REACH);
      words = near.map((one) => `${one.time.toFixed(2)} s, ${one.text}`).join("\n");
    }
    this.tip.hidden = !words;
    this.tip.textContent = words ?? "";
    const left = Math.min(event.clientX + 12, window.innerWidth - this.tip.offsetWidth - 8);
    this.tip.style.left = `${Math.max(8, left)}px`;
    this.tip.style.top = `${box.top - this.tip.offsetHeight - 6}px`;
  }

  update(time) {
    this.time = time;
    const pen = this.canvas.getContext("2d");
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    if (!this.picture.width) return;
    pen.drawImage(this.picture, 0, 0);
    const ratio = this.canvas.width / this.canvas.clientWidth;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = "#c8322b";
    pen.fillRect(this.x(time) - 1, 0, 2, HEIGHT - TIMES);
  }
}

/** The events as a list; a click goes to one. */
export function listEvents(table, seek) {
  const list = document.getElementById("events");
  for (const note of table.notes) list.append(element("li", { className: "note" }, note));
  for (const { time, text } of table.events) {
    const go = element("button", {}, `${time.toFixed(2)} s`);
    go.addEventListener("click", () => seek(time));
    list.append(element("li", {}, go, ` ${text}`));
  }
  if (!list.children.length) list.append(element("li", { className: "note" }, "none in this run"));
}
