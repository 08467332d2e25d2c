// What the page shows of the answers: charts with a sentence each, and the verdict as a table.

import { chart, number } from "./charts.js";
import { made } from "./fields.js";
import { unit } from "./units.js";

const get = (id) => document.getElementById(id);
const HZ = { label: "interaction frequency, Hz", kind: "log" };
const CLAIMS = { asymptotic: "✓ settles", "held-by-friction": "✗ settles by dry friction only", unstable: "✗ does not settle" };

export const named = (column, name) => `${column.toUpperCase()}: ${name}`;

export function span(values) {
  const known = values.filter((value) => value !== null);
  if (!known.length) return "nothing";
  return `${number(known.reduce((a, b) => Math.min(a, b)))} to ${number(known.reduce((a, b) => Math.max(a, b)))}`;
}

function summary(shown, columns, pick, unit) {
  return columns.filter((column) => shown[column].now && shown[column].now.gains)
    .map((column) => named(column, `${span(pick(shown[column].now.gains))} ${unit}`)).join("; ") || "no gains";
}

function drawImpedance(shown, columns) {
  const there = columns.filter((column) => shown[column].now);
  const base = shown[there[0]].now;
  const x = base.frequency_hz;
  const of = (name) => (there.length > 1 ? `${name}, ${there[0].toUpperCase()}` : name);
  const lines = (pick) => there.filter((column) => shown[column].now.gains).map((column) => ({
    name: named(column, shown[column].now.gains.method), cls: column, x: shown[column].now.frequency_hz, y: pick(shown[column].now.gains) }));
  const own = (pick) => there.filter((column) => shown[column].law && shown[column].law.rows).map((column) => ({
    name: named(column, "your k and b"), cls: "own", x: shown[column].law.frequency_hz, y: pick(shown[column].law) }));
  for (const id of ["c-damping", "c-stiffness"]) get(id).hidden = !there.some((column) => shown[column].now.gains);
  chart(get("c-magnitude"), {
    title: "Perceived impedance |Z|", x: HZ, y: { label: unit.impedance, kind: "log" },
    bands: [{ name: of("feels real"), cls: "real", x, low: base.lower, high: base.upper }],
    series: [{ name: of("desired"), cls: "desired", x, y: base.desired.magnitude }, { name: of("no coupling"), cls: "without", x, y: base.without.magnitude },
      ...lines((gains) => gains.magnitude), ...own((law) => law.magnitude)],
    summary: `${summary(shown, columns, (gains) => gains.magnitude, unit.impedance)}; desired ${span(base.desired.magnitude)} ${unit.impedance}`,
  });
  chart(get("c-real"), {
    title: "Real part of Z: below 0 the loop gives energy out", x: HZ, y: { label: unit.impedance, kind: "symlog" },
    series: [{ name: of("no coupling"), cls: "without", x, y: base.without.real }, ...lines((gains) => gains.real), ...own((law) => law.real)],
    summary: `${summary(shown, columns, (gains) => gains.real, unit.impedance)}; without coupling ${span(base.without.real)} ${unit.impedance}`,
  });
  chart(get("c-damping"), {
    title: "Damping b of the coupling", x: HZ, y: { label: unit.impedance, kind: "symlog" }, series: lines((gains) => gains.damping_ns_per_m),
    summary: summary(shown, columns, (gains) => gains.damping_ns_per_m, unit.impedance),
  });
  const limit = base.passive_limit_n_per_m;
  chart(get("c-stiffness"), {
    title: "Stiffness k of the coupling", x: HZ, y: { label: unit.stiffness, kind: "symlog" }, series: lines((gains) => gains.stiffness_n_per_m),
    lines: limit > 0 ? [{ name: "passive limit of DC stiffness", cls: "limit", y: limit }] : [],
    summary: `${summary(shown, columns, (gains) => gains.stiffness_n_per_m, unit.stiffness)}; passive limit ${number(limit)} ${unit.stiffness}`,
  });
}

export function drawTouch(shown, columns, begins = "the wall begins") {
  const runs = columns.flatMap((column) => [[column, "touch"], [column, "law"]])
    .filter(([column, part]) => shown[column][part] && shown[column][part].touch).map(([column, part]) => [column, shown[column][part].touch, part]);
  const words = runs.map(([column, run, part]) => named(column, `${part === "law" ? "your k and b: " : ""}${CLAIMS[run.claim].slice(2)}, peak ${number(run.peak_force_n)} ${unit.force}`)).join("; ") || "nothing simulated";
  const time = { label: "time, s", kind: "linear" };
  const series = (x, y, factor) => runs.map(([column, run, part]) => ({
    name: named(column, part === "law" ? "your k and b" : shown[column].now.gains ? shown[column].now.gains.method : ""), cls: part === "law" ? "own" : column,
    x: x(run), y: y(run).map((value) => (value === null ? null : factor * value)) }));
  const target = runs.length ? [{ name: "the hand's target", cls: "desired", x: runs[0][1].time_s, y: runs[0][1].target_m.map((value) => 1e3 * value) }] : [];
  chart(get("c-position"), {
    title: `Position (${begins} at 0)`, x: time, y: { label: unit.milli, kind: "linear", span: depthSpan(runs) },
    series: [...target, ...series((run) => run.time_s, (run) => run.position_m, 1e3)], summary: words,
  });
  chart(get("c-force"), { title: "Force", x: time, y: { label: unit.force, kind: "linear" }, series: series((run) => run.time_s, (run) => run.force_n, 1), summary: words });
}

/** Where the device is, not where the hand would like to be: a result of micrometres stays visible. */
function depthSpan(runs) {
  const deepest = Math.max(0, ...runs.map(([, run]) => run.position_m.reduce((a, b) => Math.max(a, b), 0)));
  return deepest > 0 ? [-1e3 * deepest, 1.3e3 * deepest] : null;
}

function drawRegion(shown, columns, state) {
  const column = shown[state.on].region ? state.on : columns.find((one) => shown[one].region);
  if (!column) return;
  const region = shown[column].region;
  if (region.refused || region.errors) {
    get("c-region").replaceChildren(made("figcaption", {}, `Not drawn: ${region.refused || "the settings are refused"}`));
    return;
  }
  const x = region.damping_ns_per_m.slice(1);
  const wall = (one) => [shown[one].values["environment.damping_ns_per_m"], shown[one].values["environment.stiffness_n_per_m"]];
  const points = columns.filter((one) => shown[one].values).map((one) => {
    const [b, k] = wall(one);
    return { name: named(one, `wall wanted, ${number(k)} ${unit.stiffness}, ${number(b)} ${unit.impedance}`), cls: one, x: Math.max(b, x[0]), y: k };
  });
  const limit = region.encoder_limit_n_per_m;
  chart(get("c-region"), {
    title: `Walls without coupling, stiffness below each curve (device ${column.toUpperCase()})`,
    x: { label: `wall damping B, ${unit.impedance}`, kind: "log" }, y: { label: `wall stiffness K, ${unit.stiffness}`, kind: "log" },
    series: region.curves.map((curve) => ({ name: curve.claim, cls: curve.key, x, y: curve.stiffness_n_per_m.slice(1) })),
    points, lines: limit ? [{ name: "encoder and friction, 2 f/Δ", cls: "limit", y: limit }] : [],
    summary: `${points.map((point) => point.name).join("; ")}; stable with every hand up to ${span(region.curves.at(-1).stiffness_n_per_m)} ${unit.stiffness}`,
  });
}

export const yes = (passed, text) => made("span", { class: passed ? "pass" : "fail" }, `${passed ? "✓" : "✗"} ${text}`);

/** Whether a run settles, and what is left of it at the end. */
export function rested(run) {
  const claim = CLAIMS[run.claim].slice(2);
  if (!run.buzzing || run.claim === "unstable") return yes(run.claim === "asymptotic", claim);
  return yes(false, `${claim}, but buzzes: the force ripples by ${number(run.ripple_n, 2)} ${unit.force} (rms)`);
}

/** What to do about a coupling that may not go into a device. */
function nextStep({ now, judge }, method, papers) {
  if (now && !now.gains && method === "recommend") return "Press Run: it looks for a coupling that may go into the device, and takes some seconds to a minute.";
  if (now && !now.gains) return "Press Run, under Method.";
  if (!judge || !judge.deployable || judge.deployable.pass || method === "recommend") return "";
  const what = papers.includes(method) ? "These gains answer the paper's question." : "These gains may not go into a device.";
  return `${what} For a coupling that may choose recommend, under Method.`;
}

/** The table of the verdict: rows of a name and what stands in the cell of a column. */
export function drawTable(rows, there, shown, host = "verdict") {
  const head = made("thead", {}, made("tr", {}, made("th", { scope: "col" }, "what"), ...there.map((column) => made("th", { scope: "col" }, column.toUpperCase()))));
  const body = made("tbody", {}, ...rows.map(([name, cell]) => made("tr", {}, made("th", { scope: "row" }, name),
    ...there.map((column) => made("td", {}, cell(shown[column], column))))));
  get(host).replaceChildren(head, body);
}

function drawVerdict(shown, columns, state, papers) {
  const rows = [
    ["gains by", (mine, column) => state[column].method],
    ["frequencies with gains", ({ now }) => now.gains ? Object.entries(now.gains.counts).map(([name, count]) => `${count} ${name}`).join(", ") : "not run"],
    ["may go into a device", ({ judge }) => judge && judge.deployable ? yes(judge.deployable.pass, judge.deployable.pass ? "deployable" : "not deployable") : "–"],
    ["simulated touch", ({ touch }) => touch && touch.touch ? rested(touch.touch) : touch && touch.refused ? touch.refused : "–"],
    [`stiffness felt, ${unit.stiffness}`, ({ touch }) => touch && touch.touch ? number(touch.touch.stiffness_n_per_m, 4) : "–"],
    [`stiffest wall with a spring and damper, every hand and let go, ${unit.stiffness}`, ({ judge }) => judge && judge.stiffest ? number(judge.stiffest.stiffness_n_per_m, 4) : "–"],
    [`passive limit of stiffness at rest, ${unit.stiffness}`, ({ now }) => number(now.passive_limit_n_per_m, 4)],
  ];
  const there = columns.filter((column) => shown[column].now);
  drawTable(rows, there, shown);
  get("next").textContent = nextStep(shown[state.on], state[state.on].method, papers);
}

const MARKS = { "✓": "pass", "✗": "fail", "!": "caution" };

/** Your own k and b: a row of the command a line. */
function drawLaw(shown, columns) {
  const there = columns.filter((column) => shown[column].law && shown[column].law.rows);
  const labels = [...new Set(there.flatMap((column) => shown[column].law.rows.map((row) => row.label)))];
  drawTable(labels.map((label) => [label, (mine) => {
    const row = mine.law.rows.find((one) => one.label === label);
    return row ? made("span", { class: MARKS[row.mark] || null }, `${row.mark} ${row.text}`.trim()) : "–";
  }]), there, shown, "law");
}

/** What the page shows where the other end is a wall. */
export const wall = {
  after: ["law", "judge", "touch", "region"],
  then: {},
  /** Gains that typing begins with. */
  typed: () => ({}),
  draw(part, shown, columns, state, about) {
    if (!part || part === "now" || part === "law") drawImpedance(shown, columns);
    if (!part || part === "touch" || part === "law") drawTouch(shown, columns);
    drawLaw(shown, columns);
    if (!part || part === "now" || part === "region") drawRegion(shown, columns, state);
    drawVerdict(shown, columns, state, about.papers);
  },
};
