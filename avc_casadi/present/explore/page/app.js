// The page: its settings stand in the address, every change is asked of the server, the last answer wins.

import { known, parsed } from "./address.js";
import { Client, Follow } from "./client.js";
import { Fields, made } from "./fields.js";
import { wall } from "./pictures.js";
import { tool } from "./tool.js";
import { speak } from "./units.js";

const UNDO_JOIN_MS = 900;
const ADDRESS_MS = 300;
const POLL_MS = 500;
const KEEP_MS = 4000;
const MOST_BYTES = 200000;
const FRESH = { device: null, values: {}, method: "direct", gains: {}, motion: "press", own: {} };

const get = (id) => document.getElementById(id);
const copy = (value) => JSON.parse(JSON.stringify(value));
const client = new Client((text) => (get("status").textContent = text));

let about;
let end;
let fields;
let gainFields;
let ownFields;
let state = { a: copy(FRESH), b: null, on: "a" };
const shown = { a: {}, b: {} };
const asking = { a: "", b: "" };
const past = [];
const future = [];
let joined = { kind: "", time: 0 };
let polling = null;
// Runs under way: the server ends one that no page asks for any more.
const runs = new Map();
// What is not known of the devices that were chosen, by what the settings hold of them.
const gaps = new Map();
let changedAt = 0;

const current = () => state[state.on];
const columns = () => (state.b ? ["a", "b"] : ["a"]);

// ---- state, undo, address

function readAddress(hash) {
  const left = new Set();
  const found = parsed(hash, left);
  const motions = [...get("motion").options].map((one) => one.value);
  const [a, b] = [found.a, found.b].map((one) => known(one, left, FRESH, about, motions));
  get("address-says").textContent = left.size ? `The address holds what this page does not know, and left out: ${[...left].join(", ")}.` : "";
  return { a, b: found.b ? b : null, on: found.b && found.on === "b" ? "b" : "a" };
}

let writing = null;
function writeAddress() {
  if (writing !== null) return;
  writing = setTimeout(() => {
    writing = null;
    history.replaceState(null, "", `#${encodeURIComponent(JSON.stringify(state))}`);
  }, ADDRESS_MS);
}

function change(edit, kind = "") {
  const time = performance.now();
  if (!kind || kind !== joined.kind || time - joined.time > UNDO_JOIN_MS) past.push(copy(state));
  if (past.length > 200) past.shift();
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
  get("file-says").textContent = "";
  get("command").hidden = true;
  writeAddress();
  showControls();
  for (const column of columns()) {
    const wanted = JSON.stringify(state[column]);
    if (wanted !== asking[column]) follow[column].changed(changedAt || performance.now());
    asking[column] = wanted;
  }
  changedAt = 0;
}

// ---- controls

function showControls() {
  const settings = current();
  get("undo").disabled = !past.length;
  get("redo").disabled = !future.length;
  get("tab-b").hidden = get("drop").hidden = !state.b;
  get("compare").hidden = Boolean(state.b);
  get("tab-a").setAttribute("aria-pressed", String(state.on === "a"));
  get("tab-b").setAttribute("aria-pressed", String(state.on === "b"));
  get("method").value = settings.method;
  const ofFile = settings.device !== null && typeof settings.device === "object";
  get("device-of-file").hidden = !ofFile;
  get("device").value = ofFile ? "(file)" : settings.device || "";
  const unknown = gaps.get(JSON.stringify(settings.device)) || [];
  get("device-note").textContent = unknown.length ? `Not known of it, and taken cautiously: ${unknown.join(", ")}.` : "";
  get("motion").value = settings.motion;
  const typing = settings.method === "constant";
  get("own-gains").hidden = end === wall && !typing;
  const gains = typing ? settings.gains : end.typed(shown[state.on].now);
  gainFields.show(Object.fromEntries(Object.entries(gains).map(([key, value]) => [`gains.${key}`, value])));
  ownFields.show(Object.fromEntries(Object.entries({ ...(shown[state.on].law || {}).own, ...settings.own }).map(([key, value]) => [`own.${key}`, value])));
  get("work").hidden = !about.slow.includes(settings.method);
  const known = shown[state.on].values || about.values;
  fields.show({ ...known, ...settings.values });
  const now = shown[state.on].now;
  get("kept").textContent = now && now.kept.length ? `Kept as in the file, without a field here: ${now.kept.join("; ")}.` : "";
  fields.dropped((now && now.dropped) || []);
  showFaults();
  if (get("work").hidden) get("told").replaceChildren();
  else watchWork();
}

function showFaults() {
  const errors = [...(shown[state.on].errors || []), ...((shown[state.on].law || {}).errors || [])];
  const rest = ownFields.faults(gainFields.faults(fields.faults(errors)));
  get("error-method").textContent = rest.filter((one) => one.key === "method").map((one) => one.message).join("; ");
  get("error-device").textContent = rest.filter((one) => one.key === "device").map((one) => one.message).join("; ");
  get("general-error").textContent = rest
    .filter((one) => !/^(method|device)$/.test(one.key))
    .map((one) => [one.key, one.message].filter(Boolean).join(" ")).join("; ");
}

function buildControls() {
  const named = { direct: "direct (the paper's NLP)", constant: "constant, typed", recommend: "recommend (a run)" };
  const option = (value, text) => made("option", { value }, text);
  get("method").append(
    made("optgroup", { label: "at once" }, ...about.live.map((one) => option(one, named[one] || one))),
    made("optgroup", { label: "a run, seconds to minutes" }, ...about.slow.map((one) => option(one, named[one] || one))));
  for (const one of about.devices) gaps.set(JSON.stringify(one.name), one.gaps);
  get("device").append(option("", "as in the problem"), ...about.devices.map((one) => option(one.name, one.title)),
    made("option", { value: "(file)", id: "device-of-file", hidden: true }, "from the file"));
  gainFields = new Fields(get("own-gains"), about.gains, (key, value, kind, event) => {
    changedAt = event ? event.timeStamp : 0;
    change(() => {
      type();
      if (value === null) delete current().gains[key.replace("gains.", "")];
      else current().gains[key.replace("gains.", "")] = value;
    }, kind);
  });
  ownFields = new Fields(get("own-law"), about.own, (key, value, kind, event) => {
    changedAt = event ? event.timeStamp : 0;
    change(() => (current().own[key.replace("own.", "")] = value), kind);
  });
  fields = new Fields(get("fields"), about.fields, (key, value, kind, event) => {
    changedAt = event ? event.timeStamp : 0;
    change(() => (current().values[key] = value), kind);
  });
  get("method").addEventListener("change", (event) => change(() => {
    if (event.target.value === "constant") type();
    else current().method = event.target.value;
  }));
  get("motion").addEventListener("change", (event) => change(() => (current().motion = event.target.value)));
  get("device").addEventListener("change", (event) => {
    if (event.target.value !== "(file)") chooseDevice({ name: event.target.value });
  });
  get("device-file").addEventListener("change", async (event) => {
    const [file] = event.target.files;
    if (!file) return;
    if (file.size > MOST_BYTES) get("error-device").textContent = `${file.name} has ${file.size} bytes; allowed: a device file of at most ${MOST_BYTES}`;
    else await chooseDevice({ text: await file.text(), file: file.name });
    event.target.value = "";
  });
  get("undo").addEventListener("click", () => travel(past, future));
  get("redo").addEventListener("click", () => travel(future, past));
  get("compare").addEventListener("click", () => change(() => (state = { a: state.a, b: copy(state.a), on: "b" })));
  get("drop").addEventListener("click", () => change(() => {
    state = { a: state.a, b: null, on: "a" };
    shown.b = {};
    asking.b = "";
    drawAll();
  }));
  for (const column of ["a", "b"]) get(`tab-${column}`).addEventListener("click", () => {
    state.on = column;
    get("file-says").textContent = "";
    writeAddress();
    showControls();
  });
  get("work-begin").addEventListener("click", () => watchWork(true));
  get("work-cancel").addEventListener("click", async () => {
    await client.ask("cancel", { settings: current() });
    watchWork();
  });
  get("save-problem").addEventListener("click", () => save("problem"));
  get("save-coupling").addEventListener("click", () => save("coupling"));
  get("copy-command").addEventListener("click", copyCommand);
  document.addEventListener("keydown", (event) => {
    const key = event.key.toLowerCase();
    if (!(event.ctrlKey || event.metaKey) || !["y", "z"].includes(key) || event.target.matches("input[type=text]")) return;
    event.preventDefault();
    if (event.shiftKey || key === "y") travel(future, past);
    else travel(past, future);
  });
  get("controls").addEventListener("submit", (event) => event.preventDefault());
}

/** Gains are typed from here on; they begin with those that are shown, where these are a few numbers. */
function type() {
  if (current().method !== "constant") current().gains = { ...current().gains, ...end.typed(shown[state.on].now) };
  current().method = "constant";
}

/** A device takes the place of all that the page says of one. */
async function chooseDevice(which) {
  const kept = (values) => Object.fromEntries(Object.entries(values).filter(([key]) => !key.startsWith("device.")));
  if (which.name === "") {
    change(() => Object.assign(current(), { device: null, values: kept(current().values) }));
    return;
  }
  const found = await client.ask("device", which);
  if (!found || found.errors) {
    get("error-device").textContent = found ? found.errors.map((one) => [one.key, one.message].filter(Boolean).join(" ")).join("; ") : "";
    return;
  }
  const device = which.name || found.device;
  gaps.set(JSON.stringify(device), found.gaps);
  if (which.file) get("device-of-file").textContent = `from ${which.file}`;
  change(() => Object.assign(current(), { device, values: kept(current().values) }));
}

// ---- slow methods

async function watchWork(begin = false) {
  clearTimeout(polling);
  if (!about.slow.includes(current().method)) return;
  const settings = copy(current());
  const found = await askWork(settings, begin);
  if (!found || JSON.stringify(settings) !== JSON.stringify(current())) return;
  const running = found.state === "running";
  const says = {
    "not-begun": "Not run for these settings yet.",
    running: `${found.what || "starting"}: ${found.done} of ${found.total || "?"} in this step, ${found.seconds} s`,
    done: `Done in ${found.seconds} s.`,
    error: `Ended: ${found.error}`,
    refused: found.error,
  };
  get("work-says").textContent = found.errors ? "" : says[found.state];
  const bar = get("work-progress");
  bar.hidden = !running;
  bar.value = found.total ? found.done / found.total : 0;
  get("work-begin").hidden = running || found.state === "done";
  get("work-cancel").hidden = !running;
  get("told").replaceChildren(...(found.lines || []).map((line) => made("li", {}, line)));
  if (running) polling = setTimeout(watchWork, POLL_MS);
  else if (found.state === "done" && !(shown[state.on].now && shown[state.on].now.gains && !shown[state.on].now.awaited)) follow[state.on].changed(performance.now());
}

/** Ask how far a run is; one that is under way is asked for again, whatever the page shows meanwhile. */
async function askWork(settings, begin) {
  const found = await client.ask("work", { settings, begin, column: state.on });
  const key = JSON.stringify(settings);
  if (found && found.state === "running") runs.set(key, settings);
  else runs.delete(key);
  return found;
}

setInterval(() => {
  for (const [key, settings] of runs) if (key !== JSON.stringify(current())) askBeside(key, settings);
}, KEEP_MS);

async function askBeside(key, settings) {
  const found = await askWork(settings, false);
  if (!found || found.state !== "done") return;
  for (const column of columns()) if (JSON.stringify(state[column]) === key) follow[column].changed(performance.now());
}

// ---- answers

const follow = {};
const followed = (column) => new Follow(client, () => state[column], {
  first: "now",
  after: end.after,
  then: end.then,
  answered(part, found, since) {
    const mine = shown[column];
    if (part === "now") {
      mine.errors = found.errors || (found.refused ? [{ key: "", message: found.refused }] : []);
      if (found.values) mine.values = found.values;
      if (found.title && column === state.on) get("title").textContent = document.title = `avc explore: ${found.title}`;
      if (column === state.on) showControls();
      if (mine.errors.length) {
        markStale();
        return;
      }
      Object.assign(mine, { now: found, judge: null, touch: null });
    } else {
      mine[part] = found;
      if (part === "law" && column === state.on) showControls();
    }
    end.draw(part, shown, columns(), state, about);
    markStale();
    painted(part === "now" ? "picture" : part, since);
  },
});

/** Note how long it took from a change to what it made visible, for whoever measures. */
function painted(what, since) {
  requestAnimationFrame(() => setTimeout(() => performance.measure(what, { start: since, end: performance.now() })));
}

/** Faded is what does not belong to the settings as they stand. */
function markStale() {
  const late = columns().some((one) => !shown[one].judge || shown[one].errors.length);
  document.querySelector("main").classList.toggle("stale", late);
}

function drawAll() {
  const there = columns().filter((column) => shown[column].now);
  if (!there.includes("a")) return;
  end.draw("", shown, columns(), state, about);
}

// ---- files

async function save(kind) {
  const found = await client.ask("file", { settings: current(), kind, column: state.on });
  if (!found) return;
  if (found.errors || found.refused) {
    get("file-says").textContent = `Not saved: ${found.refused || found.errors.map((one) => one.message).join("; ")}`;
    return;
  }
  const link = made("a", { href: URL.createObjectURL(new Blob([found.text])), download: found.name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  get("file-says").textContent = `Saved ${found.name}${found.told ? `; ${found.told}` : ""}.`;
}

async function copyCommand() {
  const found = await client.ask("file", { settings: current(), kind: "command", column: state.on });
  if (!found || !found.text) return;
  get("command").textContent = found.text;
  get("command").hidden = false;
  try {
    await navigator.clipboard.writeText(found.text);
    get("file-says").textContent = "Copied.";
  } catch {
    get("file-says").textContent = "Copy it from below.";
  }
}

// ---- begin

async function begin() {
  about = await client.ask("start", {});
  if (!about) return;
  FRESH.method = about.opens;
  end = about.end === "wall" ? wall : tool;
  for (const section of document.querySelectorAll("[data-end]")) section.hidden = section.dataset.end !== about.end;
  for (const column of ["a", "b"]) follow[column] = followed(column);
  speak(about.words);
  state = readAddress(location.hash);
  buildControls();
  window.addEventListener("hashchange", (event) => {
    document.activeElement.blur();
    past.push(copy(state));
    future.length = 0;
    joined = { kind: "", time: 0 };
    // Not location.hash: a write of this page that was due may have taken its place.
    state = readAddress(new URL(event.newURL).hash);
    restate();
  });
  let width = window.innerWidth;
  window.addEventListener("resize", () => {
    if (window.innerWidth !== width) drawAll();
    width = window.innerWidth;
  });
  restate();
  if (current().method === about.opens) watchWork(true);
}

begin();
