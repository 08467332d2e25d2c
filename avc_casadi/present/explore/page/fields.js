// The controls: one slider and one field a value, in the units of the page; errors stand next to the field.

const STEPS = 1000;

export function made(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === true) element.setAttribute(key, "");
    else if (value !== false && value !== null) element.setAttribute(key, value);
  }
  element.append(...children);
  return element;
}

// Decimal numbers alone: Number("0x10") is 16.
export const number = (text) => (/^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i.test(text) ? Number(text) : NaN);
const plain = (value) => String(Number(value.toPrecision(6)));
const toPage = (field, value) => (typeof value === "number" ? plain(value / field.factor) : value === null || value === undefined ? "" : String(value));

/** What was typed: a number, null where nothing was, or the text itself, which is refused beside the field. */
export function typed(text) {
  // "1,000" may be a thousand or one.
  if (/^[^.]*,\d{3}$/.test(text.trim())) return text.trim();
  const trimmed = text.trim().replace(",", ".");
  if (trimmed === "") return null;
  const value = number(trimmed);
  return Number.isFinite(value) ? value : text.trim();
}

function fromPage(field, text) {
  const value = typed(text);
  return typeof value === "number" ? Number((value * field.factor).toPrecision(12)) : value;
}

const place = (field, value) => field.log
  ? Math.log(value / field.low) / Math.log(field.high / field.low)
  : (value - field.low) / (field.high - field.low);

function placed(field, share) {
  const value = field.log ? field.low * (field.high / field.low) ** share : field.low + (field.high - field.low) * share;
  return field.whole ? Math.round(value) : Number(value.toPrecision(2));
}

/** Build the controls of all fields, in groups that are open or folded. `changed(key, value, kind)` hears of every change; kind joins undo steps. */
export class Fields {
  constructor(host, fields, changed, open) {
    this.entries = new Map();
    const groups = new Map();
    for (const field of fields) {
      if (!groups.has(field.group)) {
        const box = made("details", { open }, made("summary", {}, field.group));
        groups.set(field.group, box);
        host.append(box);
      }
      groups.get(field.group).append(this.#entry(field, changed));
    }
  }

  #entry(field, changed) {
    const id = `f-${field.key.replaceAll(".", "-")}`;
    const error = made("p", { class: "error", id: `${id}-error` });
    const name = made("label", { for: id }, field.label);
    const note = made("p", { class: "note" });
    const entry = { field, error, note };
    const row = made("div", { class: "field" }, name);
    if (field.choices.length) {
      entry.input = made("select", { id, "aria-describedby": error.id }, ...field.choices.map((one) => made("option", { value: one }, one)));
      entry.input.addEventListener("change", () => changed(field.key, field.choices[entry.input.selectedIndex], field.key));
      row.append(entry.input, error);
    } else {
      entry.input = made("input", { id, type: "text", inputmode: "decimal", placeholder: field.blank, "aria-describedby": error.id });
      entry.slider = made("input", { type: "range", min: 0, max: STEPS, step: 1, "aria-label": `${field.group}: ${field.label}` });
      entry.input.addEventListener("input", () => changed(field.key, fromPage(field, entry.input.value), field.key));
      entry.slider.addEventListener("input", () => {
        const value = placed(field, entry.slider.value / STEPS);
        entry.input.value = plain(value);
        changed(field.key, fromPage(field, entry.input.value), field.key);
      });
      row.append(entry.input, made("span", { class: "unit" }, field.unit), entry.slider, error, note);
    }
    this.entries.set(field.key, entry);
    return row;
  }

  /** Show values; the field that is being typed in is left alone. */
  show(values) {
    for (const [key, { field, input, slider }] of this.entries) {
      const value = values[key];
      if (input !== document.activeElement) input.value = toPage(field, value);
      if (slider && typeof value === "number") {
        if (slider !== document.activeElement) slider.value = Math.round(STEPS * Math.min(1, Math.max(0, place(field, value / field.factor) || 0)));
        slider.setAttribute("aria-valuetext", `${toPage(field, value)} ${field.unit}`);
      } else if (slider) {
        slider.setAttribute("aria-valuetext", field.blank || "none");
      }
    }
  }

  /** Say something next to some fields, and nothing next to the others. */
  note(keys, text) {
    for (const [key, { note }] of this.entries) note.textContent = keys.includes(key) ? text : "";
  }

  /** Show faults next to their fields; returns those that belong to none. */
  faults(errors) {
    const rest = [];
    for (const { input, error } of this.entries.values()) {
      error.textContent = "";
      input.removeAttribute("aria-invalid");
    }
    for (const fault of errors) {
      const entry = this.entries.get(fault.key);
      if (!entry) {
        rest.push(fault);
        continue;
      }
      entry.error.textContent = `${entry.error.textContent} ${fault.message}`.trim();
      entry.input.setAttribute("aria-invalid", "true");
      entry.input.closest("details").open = true;
    }
    return rest;
  }
}
