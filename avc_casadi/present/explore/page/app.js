// The page: its settings stand in the address, every change is asked of the server, the last answer wins.

import { chart } from "./charts.js";
import { Fields, made } from "./fields.js";

const UNDO_JOIN_MS = 900, ADDRESS_MS = 300, POLL_MS = 700, PAUSE_MS = 150;
/** The pictures that say most: next to each other above the table, the others below it. */
const FIRST = ["magnitude", "law", "position", "region", "rigid"];
const FEW = 3;
/** Rows that come first in any answer. */
const LEADING = ["Deployable", "Coupling"];
const get = (id) => document.getElementById(id);
const copy = (value) => JSON.parse(JSON.stringify(value));

let about, fields, gains;
let fresh = { values: {}, gains: {}, method: "", motion: "press" };
let state = { a: copy(fresh), b: null, on: "a" };
/** What a column shows: `of` and `busy` hold settings by extent; charts and verdicts remember their settings as `of`. */
const empty = () => ({ of: {}, busy: {}, errors: [], answer: null, charts: new Map(), rows: {}, verdicts: {}, running: false, done: false });
const shown = { a: empty(), b: empty() };
const past = [], future = [];
let joined = { kind: "", time: 0 };
let waiting = 0, trouble = "", revision = 0, picked = "";

const current = () => state[state.on];
const columns = () => (state.b ? ["a", "b"] : ["a"]);
const key = (column) => JSON.stringify(state[column]);

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
  revision += 1;
  get("file-note").textContent = "";
  writeAddress();
  showControls();
  for (const column of columns()) follow(column);
  draw();
}

// ---- answers

/** Ask for the pictures, which follow a slider at once, then for rows and verdicts, then for the rest. */
const follow = (column) => chase(column, "pictures");

/** Ask for an extent of the answer until it is that of the settings now. */
async function chase(column, extent) {
  const mine = shown[column], wanted = key(column), since = revision;
  if (mine.busy[extent]) return;
  if (mine.of[extent] !== wanted) {
    mine.busy[extent] = true;
    const found = await ask("evaluate", { settings: copy(state[column]), extent });
    mine.busy[extent] = false;
    if (!found || shown[column] !== mine || !state[column]) return;
    take(mine, found, extent, wanted, since);
    if (column === state.on) showControls();
    draw();
    if (key(column) !== wanted) return chase(column, extent);
    if (found.errors) return;
  }
  if (extent === "pictures") chase(column, "rows");
  if (extent === "rows") setTimeout(() => state[column] && key(column) === wanted && chase(column, "whole"), PAUSE_MS);
}

/** Take an answer over; a chart of settings that are older than those of the chart that is shown is passed over. */
function take(mine, found, extent, wanted, since) {
  mine.errors = found.errors ?? [];
  if (found.errors) {
    mine.of = { pictures: wanted, rows: wanted, whole: wanted };
    return;
  }
  mine.of[extent] = wanted;
  mine.answer = found;
  if (extent === "whole") for (const id of mine.charts.keys()) if (!found.charts.some((one) => one.id === id)) mine.charts.delete(id);
  for (const one of found.charts) {
    if ((mine.charts.get(one.id)?.since ?? -1) <= since) mine.charts.set(one.id, { ...one, since, of: wanted });
  }
  if (found.rows) judge(mine, found.rows, found.verdicts, wanted);
  if ("running" in found) Object.assign(mine, { running: found.running, done: found.done });
}

/** Take rows and verdicts over; a verdict that takes longer than the rows stays that of the settings before. */
function judge(mine, rows, verdicts, wanted) {
  for (const part of Object.keys(rows)) {
    mine.rows[part] = rows[part];
    if (verdicts[part]) mine.verdicts[part] = { ...verdicts[part], of: wanted };
  }
}

/** Follow the runs: the server ends one that no page asks for any more. */
async function poll() {
  for (const column of columns()) {
    const mine = shown[column];
    if (!about.slow.includes(state[column].method) || !mine.rows.method || mine.done) continue;
    await progress(column, {});
    if (mine.done && state[column]) {
      mine.of = {};
      follow(column);
    }
  }
  setTimeout(poll, POLL_MS);
}

/** Ask how far the run of a column is; `question` begins or cancels it. */
async function progress(column, question) {
  const mine = shown[column], wanted = key(column);
  const found = await ask("run", { settings: copy(state[column]), ...question });
  if (!found || !state[column] || key(column) !== wanted || shown[column] !== mine) return;
  const before = JSON.stringify([mine.rows.method, mine.running]);
  judge(mine, { method: found.rows }, { method: found.verdict }, wanted);
  Object.assign(mine, { running: found.running, done: found.done });
  if (before === JSON.stringify([mine.rows.method, mine.running])) return;
  showControls();
  draw();
}

// ---- what is shown

function showControls() {
  const settings = current(), { answer, errors, running, done } = shown[state.on];
  get("undo").disabled = !past.length;
  get("redo").disabled = !future.length;
  get("tab-a").hidden = get("tab-b").hidden = get("drop").hidden = !state.b;
  get("compare").hidden = Boolean(state.b);
  for (const one of ["a", "b"]) get(`tab-${one}`).setAttribute("aria-pressed", String(state.on === one));
  get("method").value = settings.method;
  const slow = about.slow.includes(settings.method);
  get("run").hidden = !slow || running || done;
  get("cancel").hidden = !slow || !running;
  get("motion").value = settings.motion;
  gains.show({ ...answer?.gains, ...settings.gains });
  fields.show({ ...answer?.values, ...settings.values });
  fields.note(answer?.dropped ?? [], "Its range is left out.");
  const rest = gains.faults(fields.faults(errors ?? []));
  get("error-method").textContent = rest.filter((one) => one.key === "method").map((one) => one.message).join("; ");
  get("general-error").textContent = rest.filter((one) => one.key !== "method").map((one) => `${one.key} ${one.message}`.trim()).join("; ");
  if (answer) {
    get("title").textContent = answer.title;
    document.title = `avc explore: ${answer.title}`;
    get("headline").textContent = answer.headline;
  }
}

const MARKS = { pass: "✓ ", fail: "✗ ", caution: "! ", none: "" };

/** The columns of bar and table: your own gains and those of the method, of each column of settings. */
function judgements() {
  const judged = [];
  for (const column of columns()) {
    const { method } = state[column], letter = state.b ? `${column.toUpperCase()} ` : "";
    judged.push({ column, part: "own", name: `${letter}yours` });
    judged.push({ column, part: "method", name: `${letter}${method === "recommend" ? "recommended" : `by ${method}`}` });
  }
  return judged;
}

const late = (column, of) => of !== key(column) || shown[column].errors.length > 0;

/** The bar that stays in sight: verdict and margin of each column; its elements stay, so that a reader hears changes. */
function verdictBar(judged) {
  const bar = get("verdicts");
  while (bar.children.length > judged.length) bar.lastChild.remove();
  while (bar.children.length < judged.length) bar.append(made("p", {}, made("b"), made("span"), made("span", { class: "margin" })));
  judged.forEach(({ column, part, name }, at) => {
    const verdict = shown[column].verdicts[part], mark = verdict?.mark ?? "none";
    const [label, word, margin] = bar.children[at].children;
    bar.children[at].className = `verdict ${part}${!verdict || late(column, verdict.of) ? " stale" : ""}`;
    label.textContent = name;
    word.className = mark;
    word.textContent = `${MARKS[mark]}${verdict?.word ?? "computing"}`;
    margin.textContent = verdict?.margin ?? "";
  });
}

/** A text whose numbers keep their units on the same line. */
const tied = (text) => text.replace(/(\d) (?=(%|[A-Za-z.]{1,5}(\/[A-Za-z0-9]+)?)([ ,;:)]|$))/g, "$1\u00a0");

/** One table: a row a line, what is yours next to what is recommended. */
function table(judged) {
  const rows = judged.map(({ column, part }) => shown[column].rows[part] ?? []);
  const known = new Set(rows.flat().map((row) => row.label));
  const labels = [...LEADING.filter((label) => known.has(label)), ...[...known].filter((label) => !LEADING.includes(label))];
  const line = (row) => made("div", {}, made("span", { class: row.mark }, MARKS[row.mark]), tied(row.text));
  const cell = (mine, label, at) => made("td", { class: judged[at].part }, ...mine.filter((row) => row.label === label).map(line));
  const head = made("tr", {}, made("td", {}), ...judged.map(({ name, part }) => made("th", { scope: "col", class: part }, name)));
  const body = labels.map((label) => made("tr", {}, made("th", { scope: "row" }, label), ...rows.map((mine, at) => cell(mine, label, at))));
  get("rows").dataset.columns = judged.length;
  get("rows").replaceChildren(made("thead", {}, head), made("tbody", {}, ...body));
  get("rows").classList.toggle("stale", columns().some((column) => late(column, shown[column].of.rows)));
}

/** The charts of all columns by name; those of two columns lie in one, what is the same in both once. */
function overlaid() {
  const charts = new Map();
  for (const column of columns()) {
    for (const one of shown[column].charts.values()) {
      const whole = charts.get(one.id) ?? { ...one, series: [], bands: [], points: [], stale: false };
      for (const part of ["series", "bands", "points"]) {
        for (const line of one[part] ?? []) {
          const drawn = JSON.stringify(line), same = whole[part].find((other) => other.drawn === drawn);
          if (same) same.shared = true;
          else whole[part].push({ ...line, drawn, column });
        }
      }
      whole.stale ||= late(column, one.of);
      charts.set(one.id, whole);
    }
  }
  for (const one of charts.values()) for (const line of [...one.series, ...one.bands, ...one.points]) named(line);
  return charts;
}

/** Name a line after its column where two are compared and only one of them has it. */
function named(line) {
  if (!state.b || line.shared) return;
  line.name = `${line.column.toUpperCase()}: ${line.name}`;
  line.cls = `${line.cls} ${line.column}`;
}

/** Put the pictures in their places; a narrow screen shows the one that is picked. */
function place(charts) {
  const all = columns().every((column) => !late(column, shown[column].of.whole));
  const few = all && charts.size <= FEW;
  const leading = FIRST.filter((id) => charts.has(id));
  const first = few ? [...leading, ...[...charts.keys()].filter((id) => !leading.includes(id))] : leading;
  get("charts").dataset.count = all ? first.length : FEW;
  const open = charts.has(picked) ? picked : first[0] ?? charts.keys().next().value;
  const names = [...charts.values()].map((one) => made("option", { value: one.id, selected: one.id === open }, one.title));
  if (document.activeElement !== get("picture")) get("picture").replaceChildren(...names);
  for (const figure of document.querySelectorAll("figure")) if (!charts.has(figure.id.slice(2))) figure.remove();
  for (const [host, ids] of [["charts", first], ["more", [...charts.keys()].filter((id) => !first.includes(id))]]) {
    ids.forEach((id, at) => {
      const figure = get(`c-${id}`) ?? made("figure", { id: `c-${id}` });
      if (get(host).children[at] !== figure) get(host).insertBefore(figure, get(host).children[at] ?? null);
      figure.classList.toggle("picked", id === open);
    });
  }
}

/** Draw bar, pictures and table. */
function draw() {
  const judged = judgements(), charts = overlaid();
  verdictBar(judged);
  table(judged);
  place(charts);
  for (const one of charts.values()) {
    const figure = get(`c-${one.id}`);
    figure.classList.toggle("stale", one.stale);
    if (figure.offsetParent) chart(figure, one);
  }
  const behind = columns().some((column) => late(column, shown[column].of.whole));
  document.querySelector("main").classList.toggle("behind", behind);
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
  // A law in the problem is saved with it, and no scene touches it.
  if (!about.couples) {
    for (const id of ["save-coupling", "motion", "motion-label"]) get(id).hidden = true;
    get("method-label").textContent = "law by";
  }
  get("method").append(...[["at once", about.live], ["a run of seconds to minutes", about.slow]]
    .filter(([, names]) => names.length).map(([label, names]) => made("optgroup", { label }, ...names.map((one) => option(one)))));
  gains = new Fields(get("gains"), about.gains, (key, value, kind) => change(() => (current().gains[key] = value), kind), true);
  const wide = !window.matchMedia("(max-width: 800px)").matches;
  fields = new Fields(get("fields"), about.fields, (key, value, kind) => change(() => (current().values[key] = value), kind), wide);
  const on = (id, event, act) => get(id).addEventListener(event, act);
  on("method", "change", (event) => change(() => (current().method = event.target.value)));
  on("motion", "change", (event) => change(() => (current().motion = event.target.value)));
  on("picture", "change", (event) => {
    picked = event.target.value;
    event.target.blur();
    draw();
  });
  on("undo", "click", () => travel(past, future));
  on("redo", "click", () => travel(future, past));
  on("compare", "click", () => change(() => {
    shown.b = { ...empty(), ...shown.a, of: { ...shown.a.of }, busy: {}, charts: new Map(shown.a.charts), rows: { ...shown.a.rows }, verdicts: { ...shown.a.verdicts } };
    state = { a: state.a, b: copy(state.a), on: "b" };
  }));
  on("drop", "click", () => change(() => (state = { a: state.a, b: null, on: "a" })));
  for (const column of ["a", "b"]) on(`tab-${column}`, "click", () => {
    state.on = column;
    restate();
  });
  on("run", "click", () => progress(state.on, { begin: true }));
  on("cancel", "click", () => progress(state.on, { cancel: true }));
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
    while (!shown[state.on].answer && !shown[state.on].errors.length) await new Promise((resolve) => setTimeout(resolve, 50));
    progress(state.on, { begin: true });
  }
}

begin();
