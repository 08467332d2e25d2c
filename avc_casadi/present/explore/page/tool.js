// What the page shows where an engine is at the other end: K against B, what is felt, and the claims as a table.

import { chart, number } from "./charts.js";
import { made } from "./fields.js";
import { drawTable, drawTouch, named, rested, span } from "./pictures.js";
import { unit } from "./units.js";

const get = (id) => document.getElementById(id);
const MARKS = { pass: "✓ ", fail: "✗ ", caution: "! ", none: "" };
const HZ = { label: "frequency of the motion, Hz", kind: "log" };

/** What a region depends on: all settings but the pair itself. */
const of = (settings) => JSON.stringify([settings.device, settings.values]);
const pair = ({ now }) => (now && now.gains ? now.gains : null);

function drawPairs(shown, columns, state) {
  const column = [state.on, ...columns].find((one) => shown[one].region || shown[one].curve);
  if (!column) return;
  const { region, curve } = shown[column];
  const fresh = (one) => one && one.of === of(state[column]);
  const found = fresh(region) ? region : fresh(curve) ? curve : region || curve;
  if (!found.curves) return;
  const x = found.damping_ns_per_m.slice(1);
  const declared = found.curves.findIndex((one) => one.declared);
  const lines = found.curves.map((one, place) => ({
    name: `${one.rate}${one.declared ? ", as declared" : ""}${one.stiffness_n_per_m.some((k) => k) ? "" : ": none"}`,
    cls: one.declared ? "declared" : `${place < declared ? "faster" : "slower"}${Math.abs(place - declared) > 1 ? " far" : ""}`,
    x, y: one.stiffness_n_per_m.slice(1) }));
  const beside = fresh(curve) && curve.with_own_damper;
  if (beside) lines.push({ name: "as declared, with the damper of this pair", cls: "own", x, y: beside.slice(1) });
  const points = columns.filter((one) => pair(shown[one])).map((one) => {
    const { damping_ns_per_m: b, stiffness_n_per_m: k } = pair(shown[one]);
    return { name: named(one, `K ${number(k, 4)} ${unit.stiffness}, B ${number(b, 4)} ${unit.impedance}${shown[one].now.stable ? "" : ", not stable"}`),
      cls: one, x: Math.max(b, x[0]), y: k };
  });
  const all = [...lines.flatMap((one) => one.y), ...points.map((one) => one.y)].filter((k) => k > 0);
  const top = all.reduce((a, b) => Math.max(a, b), 1e-9), bottom = Math.max(0.7 * all.reduce((a, b) => Math.min(a, b), top), 1e-4 * top);
  const stable = beside || found.curves[declared].stiffness_n_per_m;
  chart(get("c-pairs"), {
    title: `Stable with every hand and released, every tool and contact, below each curve${
      found.critical_damper ? "; with a critical damper in the device's loop" : ""}${columns.length > 1 ? ` (${column.toUpperCase()})` : ""}`,
    x: { label: `damper B, ${unit.impedance}`, kind: "log" }, y: { label: `spring K, ${unit.stiffness}`, kind: "log", span: [bottom, 1.5 * top] },
    bands: [{ name: "", cls: "stable", x, low: x.map(() => bottom), high: stable.slice(1) }], series: lines, points,
    summary: `${points.map((one) => one.name).join("; ") || "no pair"}; as declared up to ${span(found.curves[declared].stiffness_n_per_m)} ${unit.stiffness}`,
  });
}

function drawFelt(shown, columns) {
  const there = columns.filter((one) => shown[one].now && shown[one].now.felt);
  const moved = there.filter((one) => shown[one].now.felt.mass_kg.some((mass) => mass !== null));
  get("c-free").hidden = there.length > 0 && !moved.length;
  const felt = (pick) => (one) => ({ name: named(one, "rendered"), cls: one, x: shown[one].now.felt.frequency_hz, y: pick(shown[one].now) });
  const wanted = (which, pick) => which.slice(0, 1).map((one) => ({ ...felt(pick)(one), name: which.length > 1 ? `wanted, ${one.toUpperCase()}` : "wanted", cls: "desired" }));
  const size = (hz, damping, mass) => (damping === null ? null : Math.hypot(damping, 2 * Math.PI * hz * mass));
  const free = ({ felt: one }) => one.frequency_hz.map((hz, row) => size(hz, one.drag_ns_per_m[row], one.mass_kg[row]));
  const body = ({ felt: one }) => one.frequency_hz.map((hz) => size(hz, one.wanted.damping_ns_per_m, one.wanted.mass_kg));
  const words = (which, pick, what) => which.map((one) => named(one, `${span(pick(shown[one].now))} ${what}`)).join("; ") || "no pair";
  if (!get("c-free").hidden) chart(get("c-free"), {
    title: "Impedance |Z| in free motion; wanted: device and tool as one body", x: HZ, y: { label: unit.impedance, kind: "log" },
    series: [...wanted(moved, body), ...moved.map(felt(free))], summary: words(moved, free, unit.impedance) });
  const rigid = (now) => now.felt.stiffness_n_per_m;
  const spring = (now) => now.felt.frequency_hz.map(() => now.gains.stiffness_n_per_m);
  const tops = there.flatMap((one) => [spring(shown[one].now)[0], rigid(shown[one].now)[Math.floor(rigid(shown[one].now).length / 2)]]);
  chart(get("c-rigid"), {
    title: "Stiffness on a rigid object; wanted: K", x: HZ, y: { label: unit.stiffness, kind: "linear", span: tops.length ? [0, 1.3 * Math.max(...tops)] : null },
    series: [...wanted(there, spring), ...there.map(felt(rigid))], summary: words(there, rigid, unit.stiffness) });
}

const told = (row) => made("span", {}, made("span", { class: row.mark }, MARKS[row.mark]), row.text);

/** The rows of an answer that have a label. */
const cells = (mine, label) => ["now", "judge"].flatMap((part) => (mine[part] && mine[part].rows) || []).filter((row) => row.label === label);

function drawClaims(shown, columns, state) {
  const there = columns.filter((one) => shown[one].now);
  const labels = (part) => there.flatMap((one) => ((shown[one][part] && shown[one][part].rows) || []).map((row) => row.label));
  const cell = (label) => [label, (mine) => made("div", {}, ...cells(mine, label).map((row) => made("div", {}, told(row))))];
  const touched = ["Simulated touch", ({ touch }) => (touch && touch.touch ? rested(touch.touch) : touch && touch.refused ? touch.refused : "–")];
  const names = [...new Set([...labels("now"), "", ...labels("judge")])];
  drawTable(names.map((label) => (label ? cell(label) : touched)), there, shown);
  const { now } = shown[state.on];
  get("headline").textContent = now ? now.headline : "";
  get("next").textContent = !now ? "" : now.awaited
    ? "The pair with which recommend begins: stable with its margin, and not tried yet. Run, under Method, lets simulated hands try it."
    : now.gains && !now.stable ? "Not stable as it is: less K, or recommend, under Method." : "";
}

/** What the page shows where the other end is a simulation. */
export const tool = {
  after: ["curve", "judge", "touch"],
  // The declared rate first: it is what the pair is judged by.
  then: { curve: "region" },
  /** Gains that typing begins with: those that are shown. */
  typed: (now) => (now && now.gains ? Object.fromEntries(Object.entries(now.gains).filter(([key]) => key !== "method")) : {}),
  draw(part, shown, columns, state) {
    if (part === "curve" || part === "region") for (const one of columns) if (shown[one][part]) shown[one][part].of ??= of(state[one]);
    if (part !== "judge" && part !== "touch") drawPairs(shown, columns, state);
    if (!part || part === "now") drawFelt(shown, columns);
    if (!part || part === "touch") drawTouch(shown, columns, "the contact begins");
    drawClaims(shown, columns, state);
  },
};
