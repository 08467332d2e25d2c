// Line charts as SVG, drawn anew at every answer: axes chosen for what is shown, gaps where there is no number.

const SVG = "http://www.w3.org/2000/svg";
const EDGE = { left: 58, right: 12, top: 8, bottom: 38 };
/** Height of a picture, a share of its width between two ends. */
const heightOf = (width) => Math.round(Math.min(330, Math.max(215, 0.6 * width)));

function element(name, attributes, parent) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (parent) parent.append(made);
  return made;
}

const span = (values) => {
  const known = finite(values);
  return known.length ? `${number(known.reduce((a, b) => Math.min(a, b)))} to ${number(known.reduce((a, b) => Math.max(a, b)))}` : "nothing";
};
const finite = (values) => values.filter((value) => value !== null && Number.isFinite(value));

export function number(value, digits = 3) {
  if (value === null || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size >= 1e5 || size < 1e-3)) return value.toExponential(digits - 1).replace(/\.?0*e\+?/, "e");
  return String(Number(value.toPrecision(digits)));
}

/** A scale: place of a value from 0 to 1, and its ticks; around a mark there is room. */
function scale(kind, values, marked = false) {
  let known = finite(values);
  if (kind === "log") known = known.filter((value) => value > 0);
  let low = known.length ? known.reduce((a, b) => Math.min(a, b)) : 0.1;
  let high = known.length ? known.reduce((a, b) => Math.max(a, b)) : 1;
  if (kind === "log") {
    if (high <= low) [low, high] = [low / 2, high * 2];
    const room = marked ? 0.06 * Math.log10(high / low) : 0;
    const from = Math.log10(low) - room, to = Math.log10(high) + room;
    const every = Math.max(1, Math.ceil((to - from) / 6));
    const ticks = [];
    for (let power = Math.ceil(from / every) * every; power <= to; power += every) ticks.push(10 ** power);
    if (ticks.length < 2) for (const part of [1, 2, 5]) {
      for (let power = Math.floor(from); power <= to; power += 1) {
        const tick = part * 10 ** power;
        if (Math.log10(tick) >= from && Math.log10(tick) <= to && !ticks.includes(tick)) ticks.push(tick);
      }
    }
    return { place: (value) => (value > 0 ? (Math.log10(value) - from) / (to - from) : NaN), ticks };
  }
  if (kind === "symlog") {
    const sizes = known.map(Math.abs).filter((value) => value > 0).sort((a, b) => a - b);
    const largest = sizes.length ? sizes[sizes.length - 1] : 1;
    const small = sizes.length ? Math.max(sizes[Math.floor(sizes.length / 4)], largest * 1e-6) : 1;
    if (largest < 20 * small) return scale("linear", [...known, 0]);
    const unit = 10 ** Math.floor(Math.log10(small));
    const bend = (value) => Math.asinh(value / unit);
    const [from, to] = [bend(Math.min(low, 0)), bend(high)];
    const room = 0.04 * (to - from);
    const decades = Math.log10(largest / unit);
    const every = Math.max(1, Math.ceil((decades * (low < 0 ? 2 : 1)) / 6));
    const ticks = [0];
    for (let power = every; power <= decades + 1e-9; power += every) {
      for (const tick of [unit * 10 ** power, -unit * 10 ** power]) if (tick <= high && tick >= low) ticks.push(tick);
    }
    return { place: (value) => (bend(value) - from + room) / (to - from + 2 * room), ticks };
  }
  if (high <= low) [low, high] = low === 0 ? [-1, 1] : [low - Math.abs(low) * 0.1, high + Math.abs(high) * 0.1];
  const room = 0.05 * (high - low);
  [low, high] = [low - room, high + room];
  const rough = (high - low) / 5, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((part) => part * power >= rough);
  const ticks = [];
  for (let count = Math.ceil(low / step); count * step <= high; count += 1) ticks.push(count * step);
  return { place: (value) => (value - low) / (high - low), ticks };
}

/**
 * Draw a chart into a figure.
 * @param host the element to fill: a figure.
 * @param spec title, x and y ({label, kind, span}), series ({name, cls, x, y}), bands ({name, cls, x, low, high}) and
 *   points ({name, cls, x, y}).
 */
export function chart(host, spec) {
  const width = Math.max(260, host.clientWidth);
  const height = heightOf(width);
  const inner = { w: width - EDGE.left - EDGE.right, h: height - EDGE.top - EDGE.bottom };
  const { series, bands, points } = spec;
  const caption = document.createElement("figcaption");
  caption.textContent = spec.title;
  if (!points.length && ![...series, ...bands].some((one) => finite(one.y || one.low).length)) {
    const nothing = document.createElement("p");
    nothing.className = "note";
    nothing.textContent = "Nothing to draw yet.";
    host.replaceChildren(caption, nothing);
    return;
  }
  const x = scale(spec.x.kind, spec.x.span || [...series, ...bands].flatMap((one) => one.x).concat(points.map((p) => p.x)), points.length > 0);
  const y = scale(spec.y.kind, spec.y.span || [
    ...series.flatMap((one) => one.y), ...bands.flatMap((one) => [...one.low, ...one.high]),
    ...points.map((p) => p.y)], points.length > 0);
  const across = (value) => EDGE.left + inner.w * x.place(value);
  const up = (value) => EDGE.top + inner.h * (1 - y.place(value));
  const svg = element("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `${spec.title}. ${series.map((one) => `${one.name}: ${span(one.y)} ${spec.y.label}`).join("; ")}` });
  const clip = `clip-${host.id}`;
  const frame = element("clipPath", { id: clip }, element("defs", {}, svg));
  element("rect", { x: EDGE.left - 1, y: EDGE.top - 1, width: inner.w + 2, height: inner.h + 2 }, frame);
  for (const tick of x.ticks) {
    const at = across(tick);
    element("line", { class: "grid", x1: at, x2: at, y1: EDGE.top, y2: EDGE.top + inner.h }, svg);
    element("text", { class: "tick", x: at, y: height - 22, "text-anchor": "middle" }, svg).textContent = number(tick);
  }
  for (const tick of y.ticks) {
    const at = up(tick);
    element("line", { class: tick === 0 ? "zero" : "grid", x1: EDGE.left, x2: EDGE.left + inner.w, y1: at, y2: at }, svg);
    element("text", { class: "tick", x: EDGE.left - 6, y: at + 4, "text-anchor": "end" }, svg).textContent = number(tick);
  }
  element("text", { class: "axis", x: EDGE.left + inner.w / 2, y: height - 5, "text-anchor": "middle" }, svg).textContent = spec.x.label;
  const turned = element("text", { class: "axis", transform: `translate(12 ${EDGE.top + inner.h / 2}) rotate(-90)`, "text-anchor": "middle" }, svg);
  turned.textContent = spec.y.label;
  const drawn = element("g", { "clip-path": `url(#${clip})` }, svg);
  for (const band of bands) {
    const there = band.x.map((value, i) => [value, band.low[i], band.high[i]]).filter((row) => finite(row).length === 3);
    const path = [...there.map(([at, , high]) => `${across(at).toFixed(1)} ${up(high).toFixed(1)}`),
      ...there.reverse().map(([at, low]) => `${across(at).toFixed(1)} ${up(low).toFixed(1)}`)];
    if (path.length) element("path", { class: `band ${band.cls}`, d: `M${path.join("L")}Z` }, drawn);
  }
  for (const one of series) {
    const { line, alone } = path(one, across, up);
    if (line) element("path", { class: `line ${one.cls}`, d: line }, drawn);
    for (const [cx, cy] of alone) element("circle", { class: `alone ${one.cls}`, cx, cy, r: 2.6 }, drawn);
  }
  for (const point of points) mark(point, across, up, drawn);
  host.replaceChildren(caption, svg, legend([...bands, ...series.filter((one) => drawable(one, y).length), ...points]));
}

/** The values of a series that stand on the axes. */
const drawable = (one, y) => one.y.filter((value) => value !== null && Number.isFinite(y.place(value)));

/** The stretches of a series as one path, and the points between two gaps, which no line shows. */
function path(one, across, up) {
  const stretches = [[]];
  one.y.forEach((value, row) => {
    const [left, top] = [across(one.x[row]), value === null ? NaN : up(value)];
    if (!Number.isFinite(left) || !Number.isFinite(top)) stretches.push([]);
    else stretches.at(-1).push([left.toFixed(1), Math.max(-1e5, Math.min(1e5, top)).toFixed(1)]);
  });
  return {
    line: stretches.filter((points) => points.length > 1).map((points) => `M${points.map((point) => point.join(" ")).join("L")}`).join(""),
    alone: stretches.filter((points) => points.length === 1).map(([point]) => point),
  };
}

function mark(point, across, up, parent) {
  const [cx, cy] = [across(point.x), up(point.y)];
  if (!Number.isFinite(cx) || !Number.isFinite(cy)) return;
  const star = Array.from({ length: 10 }, (_, i) => {
    const reach = i % 2 ? 3.2 : 8, angle = (Math.PI * i) / 5 - Math.PI / 2;
    return `${(cx + reach * Math.cos(angle)).toFixed(1)},${(cy + reach * Math.sin(angle)).toFixed(1)}`;
  });
  element("polygon", { class: `mark ${point.cls}`, points: star.join(" ") }, parent);
}

function legend(entries) {
  const list = document.createElement("ul");
  list.className = "legend";
  for (const { name, cls, low, x, y } of entries) {
    if (!name) continue;
    const item = document.createElement("li");
    const swatch = element("svg", { viewBox: "0 0 30 10", width: 30, height: 10, "aria-hidden": "true" });
    if (low) element("rect", { class: `band ${cls}`, x: 0, y: 0, width: 30, height: 10 }, swatch);
    else if (Array.isArray(y) || x === undefined) element("line", { class: `line ${cls}`, x1: 0, x2: 30, y1: 5, y2: 5 }, swatch);
    else mark({ cls, x: 15, y: 5 }, (v) => v, (v) => v, swatch);
    item.append(swatch, ` ${name}`);
    list.append(item);
  }
  return list;
}
