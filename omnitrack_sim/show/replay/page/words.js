// Elements and texts. Names come from users: they are set as text, never as markup.

export function element(tag, fields = {}, ...children) {
  const made = Object.assign(document.createElement(tag), fields);
  made.append(...children);
  return made;
}

/** Give a canvas its size in CSS pixels; returns the pixels of the screen for one of them. */
export function sized(canvas, width, height) {
  const ratio = Math.min(2, window.devicePixelRatio || 1);
  canvas.style.height = `${height}px`;
  canvas.width = Math.max(1, Math.round(width * ratio));
  canvas.height = Math.max(1, Math.round(height * ratio));
  return ratio;
}

/** Call `go` with the place, px from the left, of clicks on an element and of drags from there. */
export function drag(target, go) {
  let held = false;
  const at = (event) => go(event.clientX - target.getBoundingClientRect().left);
  target.addEventListener("pointerdown", (event) => {
    held = true;
    target.setPointerCapture(event.pointerId);
    at(event);
  });
  target.addEventListener("pointermove", (event) => held && at(event));
  for (const end of ["pointerup", "pointercancel"]) {
    target.addEventListener(end, () => (held = false));
  }
}

/** A number with three digits, of which at most three stand after the point. */
export function text3(value) {
  if (value === null || !Number.isFinite(value)) return "\u2013";
  const size = Math.abs(value);
  const digits = size >= 99.95 ? 0 : size >= 9.995 ? 1 : size >= 0.9995 ? 2 : 3;
  return (size < 5e-4 ? 0 : value).toFixed(digits).replace("-", "\u2212");
}

const ROUNDING = 1e-9; // in units of a figure; less is left over by floating point

/** The numbers of a figure, each with three digits that count. */
function figure(value) {
  const one = (v) => {
    if (typeof v !== "number") return String(v ?? "\u2013");
    const small = Math.abs(v) > ROUNDING && Math.abs(v) < 0.9995;
    return small ? v.toPrecision(3).replaceAll("-", "\u2212") : text3(v);
  };
  return Array.isArray(value) ? value.map(one) : [one(value)];
}

const MAX_IN_HEAD = 2; // differences of the scenarios told beside the outcome
const MAX_SIGNS = 24; // of a value in the head; of a longer one only the key is told
const said = (unit) => (unit === "1" || !unit ? "" : ` ${unit}`);

/** Name, outcome and headline figures. */
export function tellHead(data) {
  const [first, second] = data.runs.map((run) => run.heading);
  document.getElementById("name").textContent = first.name;
  const chip = document.getElementById("outcome");
  chip.textContent = `${first.outcome} after ${first.duration.toFixed(2)} s`;
  if (first.success !== null) chip.classList.add(first.success ? "good" : "bad");
  chip.title = first.advice;
  document.getElementById("reason").textContent = first.reason;
  if (second) {
    const ghost = element("span", { className: "chip ghost" });
    ghost.textContent = `second run${differing(data.differences)}: ${second.outcome} after ` +
      `${second.duration.toFixed(2)} s`;
    const all = data.differences.map(([key, unit, one, other]) =>
      `${key}: ${one} \u2192 ${other}${said(unit)}`);
    ghost.title = [second.reason, ...all].join("\n");
    document.getElementById("second").append(ghost);
  }
  const list = document.getElementById("headline");
  for (const [name, words] of Object.entries(data.headline)) {
    const found = first.figures.find((one) => one.name === name);
    if (!found) continue;
    const beside = second?.figures.find((one) => one.name === name);
    const value = element("dd", {}, figure(found.value).join(" / ") + said(found.unit));
    if (beside) {
      value.append(element("small", {}, ` (${figure(beside.value).join(" / ")}${said(beside.unit)})`));
    }
    list.append(element("div", { title: found.meaning }, element("dt", {}, words), value));
  }
}

/** What the second run has other than the first, in brackets: short values before long ones. */
function differing(differences) {
  if (!differences.length) return "";
  const short = ([, , , value]) => value.length <= MAX_SIGNS;
  const ordered = [...differences.filter(short), ...differences.filter((one) => !short(one))];
  const few = ordered.slice(0, MAX_IN_HEAD).map((one) =>
    (short(one) ? `${one[0]} ${one[3]}${said(one[1])}` : one[0]));
  const rest = differences.length - few.length;
  return ` (${few.join(", ")}${rest ? ` and ${rest} more` : ""})`;
}

/** All figures of the runs, and where their scenarios differ. */
export function tellFigures(data) {
  const box = document.getElementById("figures-tab");
  const headings = data.runs.map((run) => run.heading);
  if (data.differences.length) {
    box.append(element("h2", {}, "Where the scenarios differ"));
    box.append(tableOf(["key", "unit", "this run", "second run"], data.differences));
  }
  headings.forEach((heading, i) => {
    const which = headings.length > 1 ? (i ? "second run" : "this run") : "the run";
    box.append(element("h2", {}, `Figures of ${which}`));
    box.append(element("p", {}, `${heading.name}: ${heading.outcome}, ${heading.reason}`));
    const columns = data.columns.map(([name], column) => (column ? name.split(" ").pop() : name));
    const names = columns.length ? columns : ["value"];
    const table = tableOf(["figure", "unit", ...names], heading.figures.map((one) => {
      const what = element("small", {}, one.meaning.split(/[;:]/)[0]);
      return [element("span", {}, one.name, what), said(one.unit), ...figure(one.value)];
    }));
    table.className = "figures";
    heading.figures.forEach((one, row) => (table.tBodies[0].rows[row].title = one.meaning));
    box.append(table);
  });
  box.append(element("p", { className: "note" },
    "A single value is of the whole robot. Hold the pointer over a figure for its full definition."));
}

function tableOf(heads, rows) {
  const head = element("tr", {}, ...heads.map((text) => element("th", {}, text)));
  const cells = (row) => row.map((text, i) => {
    const rest = i === row.length - 1 ? heads.length - row.length : 0;
    const colSpan = 1 + Math.max(0, rest);
    return element("td", { colSpan }, text);
  });
  return element("table", {}, element("thead", {}, head),
    element("tbody", {}, ...rows.map((row) => element("tr", {}, ...cells(row)))));
}

/** Keys and what made the runs, for the help. */
export function tellHelp(data, keys) {
  const list = document.getElementById("key-list");
  for (const [key, words] of keys) list.append(element("dt", {}, key), element("dd", {}, words));
  const made = document.getElementById("provenance");
  for (const [name, words] of data.runs[0].heading.provenance) {
    made.append(element("dt", {}, name), element("dd", {}, words));
  }
}

/** A group of buttons of which one is chosen; returns what marks one. */
export function chooser(box, names, choose) {
  const buttons = names.map(([name, title]) => {
    const button = element("button", { title }, name);
    button.addEventListener("click", () => choose(name));
    return button;
  });
  document.getElementById(box).append(...buttons);
  return (chosen) => {
    for (const button of buttons) button.ariaPressed = String(button.textContent === chosen);
  };
}
