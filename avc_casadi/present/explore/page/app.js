// The page: its settings stand in the address, every change is asked of the server, the last answer wins.

import { chart } from "./charts.js";
import { Fields, made } from "./fields.js";

const UNDO_JOIN_MS = 900, ADDRESS_MS = 300, POLL_MS = 700, PAUSE_MS = 150;
const get = (id) => document.getElementById(id);
const copy = (value) => JSON.parse(JSON.stringify(value));

let about, fields, gains;
let fresh = { values: {}, gains: {}, method: "", motion: "press" };
let state = { a: copy(fresh), b: null, on: "a" };
const shown = { a: {}, b: {} };
const past = [], future = [];
let joined = { kind: "", time: 0 };
let waiting = 0, trouble = "";

const current = () => state[state.on];
const columns = () => (state.b ? ["a", "b"] : ["a"]);

/** Ask the server; null where there is no answer. */
async function ask(part, question) {
  waiting += 1;
  setTimeout(() => waiting && (get("status").textContent = "computing"), 200);
  try {
    const answer = await fetch(part, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(question) });
    const found = await answer.json();
    if (!answer.ok) throw new Error(found.error);
    trouble = "";
    return found;
  } catch (error) {
    trouble = error instanceof TypeError ? "The server does not answer: has avc explore ended?" : error.message;
    return null;
  } finally {
    waiting -= 1;
    if (!waiting) get("status").textContent = trouble || "ready";
  }
}

// ---- settings, undo, address

/** The settings of an address, as far as the page knows them. */
function fromAddress(hash) {
  let found = null;
  try {
    found = JSON.parse(decodeURIComponent(hash.slice(1)));
  } catch { /* none of this page */ }
  const names = { values: about.fields.map((one) => one.key), gains: about.gains.map((one) => one.key) };
  const column = (given) => {
    const kept = copy(fresh);
    if (given === null || typeof given !== "object") return kept;
    for (const part of ["values", "gains"]) {
      for (const [key, value] of Object.entries(given[part] ?? {})) if (names[part].includes(key)) kept[part][key] = value;
    }
    if ([...about.live, ...about.slow].includes(given.method)) kept.method = given.method;
    if (["press", "tap", "hold"].includes(given.motion)) kept.motion = given.motion;
    return kept;
  };
  return { a: column(found?.a), b: found?.b ? column(found.b) : null, on: found?.b && found.on === "b" ? "b" : "a" };
}

let writing = null;
function writeAddress() {
  writing ??= setTimeout(() => {
    writing = null;
    history.replaceState(null, "", `#${encodeURIComponent(JSON.stringify(state))}`);
  }, ADDRESS_MS);
}

function change(edit, kind = "") {
  const time = performance.now();
  if (!kind || kind !== joined.kind || time - joined.time > UNDO_JOIN_MS) past.push(copy(state));
  joined = { kind, time };
  future.length = 0;
  edit();
  restate();
}

function travel(from, to) {
  if (!from.length) return;
  to.push(copy(state));
  state = from.pop();
  joined = { kind: "", time: 0 };
  restate();
}

function restate() {
  get("file-note").textContent = "";
  writeAddress();
  showControls();
  for (const column of columns()) follow(column);
  draw();
}

// ---- answers

/** Ask for what follows a slider, then for the rest: only that is the answer `of` its settings. Newer settings ask again. */
async function follow(column) {
  const mine = shown[column];
  const wanted = JSON.stringify(state[column]);
  if (mine.busy || mine.of === wanted) return;
  mine.busy = true;
  const settings = copy(state[column]);
  for (const whole of [false, true]) {
    const found = await ask("evaluate", { settings, whole });
    if (!found || !state[column]) break;
    mine.errors = found.errors ?? [];
    if (found.rows) mine.answer = found;
    mine.of = whole || found.errors ? wanted : "";
    if (column === state.on) showControls();
    draw();
    if (found.errors || JSON.stringify(state[column]) !== wanted) break;
    if (!whole) await new Promise((resolve) => setTimeout(resolve, PAUSE_MS));
    if (JSON.stringify(state[column]) !== wanted) break;
  }
  mine.busy = false;
  if (state[column] && !trouble && JSON.stringify(state[column]) !== wanted) follow(column);
}

/** Follow the runs: the server ends one that no page asks for any more. */
async function poll() {
  for (const column of columns()) {
    const settings = copy(state[column]), { answer } = shown[column];
    if (!about.slow.includes(settings.method) || !answer || answer.done) continue;
    const found = await ask("run", { settings });
    if (!found || JSON.stringify(settings) !== JSON.stringify(state[column]) || shown[column].answer !== answer) continue;
    const same = JSON.stringify(answer.rows.method) === JSON.stringify(found.rows) && answer.running === found.running;
    answer.rows.method = found.rows;
    answer.running = found.running;
    if (same && !found.done) continue;
    if (found.done) {
      shown[column].of = "";
      follow(column);
    }
    showControls();
    draw();
  }
  setTimeout(poll, POLL_MS);
}

async function run(question) {
  const settings = copy(current()), column = state.on;
  const found = await ask("run", { settings, ...question });
  if (!found || !shown[column].answer) return;
  Object.assign(shown[column].answer, { running: found.running });
  shown[column].answer.rows.method = found.rows;
  showControls();
  draw();
}

// ---- what is shown

function showControls() {
  const settings = current(), { answer, errors } = shown[state.on];
  get("undo").disabled = !past.length;
  get("redo").disabled = !future.length;
  get("tab-a").hidden = get("tab-b").hidden = get("drop").hidden = !state.b;
  get("compare").hidden = Boolean(state.b);
  for (const one of ["a", "b"]) get(`tab-${one}`).setAttribute("aria-pressed", String(state.on === one));
  get("method").value = settings.method;
  const slow = about.slow.includes(settings.method), running = Boolean(answer?.running);
  get("run").hidden = !slow || running || Boolean(answer?.done);
  get("cancel").hidden = !slow || !running;
  get("motion").value = settings.motion;
  gains.show({ ...answer?.gains, ...settings.gains });
  fields.show({ ...answer?.values, ...settings.values });
  fields.note(answer?.dropped ?? [], "Its range is left out.");
  const rest = gains.faults(fields.faults(errors ?? []));
  get("error-method").textContent = rest.filter((one) => one.key === "method").map((one) => one.message).join("; ");
  get("general-error").textContent = rest.filter((one) => one.key !== "method").map((one) => `${one.key} ${one.message}`.trim()).join("; ");
  if (answer) {
    get("title").textContent = document.title = `avc explore: ${answer.title}`;
    get("headline").textContent = answer.headline;
    get("h-method").textContent = settings.method === "recommend" ? "Recommended coupling" : `Coupling by ${settings.method}`;
  }
}

const MARKS = { pass: "✓ ", fail: "✗ ", caution: "! ", none: "" };

function table(id, part, there) {
  const rows = there.map((column) => shown[column].answer.rows[part]);
  const labels = [...new Set(rows.flat().map((row) => row.label))];
  const cell = (mine, label) => made("td", {}, ...mine.filter((row) => row.label === label).map((row) => made("div", {}, made("span", { class: row.mark }, MARKS[row.mark]), row.text)));
  const head = there.length > 1 ? [made("thead", {}, made("tr", {}, made("td", {}), ...there.map((one) => made("th", { scope: "col" }, one.toUpperCase()))))] : [];
  get(id).replaceChildren(...head, made("tbody", {}, ...labels.map((label) => made("tr", {}, made("th", { scope: "row" }, label), ...rows.map((mine) => cell(mine, label))))));
}

/** Draw tables and charts; charts of two columns lie in one. */
function draw() {
  const there = columns().filter((column) => shown[column].answer);
  if (!there.length) return;
  table("own", "own", there);
  table("coupling", "method", there);
  const named = (one, column) => (there.length > 1 ? { ...one, name: `${column.toUpperCase()}: ${one.name}`, cls: `${one.cls} ${column}` } : one);
  const charts = new Map();
  for (const column of there) {
    for (const one of shown[column].answer.charts) {
      const whole = charts.get(one.id) ?? { ...one, series: [], bands: [], points: [] };
      for (const part of ["series", "bands", "points"]) whole[part].push(...(one[part] ?? []).map((line) => named(line, column)));
      charts.set(one.id, whole);
    }
  }
  const host = get("charts");
  for (const one of charts.values()) {
    let figure = get(`c-${one.id}`);
    if (!figure) {
      figure = made("figure", { id: `c-${one.id}`, class: one.wide ? "wide" : null });
      host.append(figure);
    }
    chart(figure, one);
  }
  const late = there.some((column) => shown[column].of !== JSON.stringify(state[column]) || shown[column].errors.length);
  // Of the first answer of new settings some charts are still those before.
  for (const figure of host.children) figure.hidden = !charts.has(figure.id.slice(2)) && !late;
  document.querySelector("main").classList.toggle("stale", late);
}

// ---- files

async function save(kind) {
  const found = await ask("file", { settings: current(), kind, column: state.on });
  if (!found) return;
  if (found.errors) {
    get("file-note").textContent = `Not saved: ${found.errors.map((one) => one.message).join("; ")}.`;
    return;
  }
  const link = made("a", { href: URL.createObjectURL(new Blob([found.text])), download: found.name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  get("file-note").textContent = `Saved ${found.name}${found.note ? `: ${found.note}` : ""}.`;
}

// ---- begin

function build() {
  const option = (value, text = value) => made("option", { value }, text);
  get("method").append(...[["at once", about.live], ["a run of seconds to minutes", about.slow]]
    .filter(([, names]) => names.length).map(([label, names]) => made("optgroup", { label }, ...names.map((one) => option(one)))));
  gains = new Fields(get("gains"), about.gains, (key, value, kind) => change(() => (current().gains[key] = value), kind));
  fields = new Fields(get("fields"), about.fields, (key, value, kind) => change(() => (current().values[key] = value), kind));
  const on = (id, event, act) => get(id).addEventListener(event, act);
  on("method", "change", (event) => change(() => (current().method = event.target.value)));
  on("motion", "change", (event) => change(() => (current().motion = event.target.value)));
  on("undo", "click", () => travel(past, future));
  on("redo", "click", () => travel(future, past));
  on("compare", "click", () => change(() => {
    shown.b = { ...shown.a, busy: false };
    state = { a: state.a, b: copy(state.a), on: "b" };
  }));
  on("drop", "click", () => change(() => (state = { a: state.a, b: null, on: "a" })));
  for (const column of ["a", "b"]) on(`tab-${column}`, "click", () => {
    state.on = column;
    restate();
  });
  on("run", "click", () => run({ begin: true }));
  on("cancel", "click", () => run({ cancel: true }));
  on("save-problem", "click", () => save("problem"));
  on("save-coupling", "click", () => save("coupling"));
  on("controls", "submit", (event) => event.preventDefault());
  document.addEventListener("keydown", (event) => {
    const key = event.key.toLowerCase();
    if (!(event.ctrlKey || event.metaKey) || !["y", "z"].includes(key) || event.target.matches("input[type=text]")) return;
    event.preventDefault();
    if (event.shiftKey || key === "y") travel(future, past);
    else travel(past, future);
  });
  let width = window.innerWidth;
  window.addEventListener("resize", () => {
    if (window.innerWidth !== width) draw();
    width = window.innerWidth;
  });
  window.addEventListener("hashchange", (event) => {
    past.push(copy(state));
    state = fromAddress(new URL(event.newURL).hash);
    restate();
  });
}

async function begin() {
  about = await ask("start", {});
  if (!about) return;
  fresh.method = about.method;
  build();
  state = fromAddress(location.hash);
  restate();
  poll();
  // A page opens with the run that it asks about.
  if (about.slow.includes(current().method)) {
    while (!shown[state.on].answer && !shown[state.on].errors?.length) await new Promise((resolve) => setTimeout(resolve, 50));
    run({ begin: true });
  }
}

begin();
