// The pointer as the hand: the loop runs in real time in the page, one sample after the other.

import { number } from "./charts.js";
import { gainsAt, Loop } from "./loop.js";
import { turns, unit } from "./units.js";

// Shares of the way across the canvas, from its middle: a key's step, and where a device has flown off.
const KEY = 1 / 40;
const LOST = 15;
const SHOWN_S = 1.0;
const FELT_HZ = 30;

export class Toy {
  /** @param numbers asks the server for the numbers of the loop; without is true where no coupling is wanted. */
  constructor(numbers) {
    this.ask = numbers;
    this.canvas = document.getElementById("toy");
    this.button = document.getElementById("toy-run");
    this.says = document.getElementById("toy-says");
    this.sound = document.getElementById("toy-sound");
    this.with = document.getElementById("toy-with");
    this.hz = document.getElementById("toy-hz");
    this.running = false;
    this.reach = 0.02;
    this.aim = this.last = -this.reach / 2;
    this.canvas.addEventListener("pointermove", (event) => this.#point(event));
    this.canvas.addEventListener("pointerdown", (event) => this.#point(event));
    this.canvas.addEventListener("keydown", (event) => this.#key(event));
    this.button.addEventListener("click", () => (this.running ? this.stop() : this.start()));
    for (const input of [this.with, this.hz]) input.addEventListener("change", () => this.reload());
    this.sound.addEventListener("change", () => this.#listen());
    this.#invite();
  }

  /** Say on the empty canvas what to do with it. */
  #invite() {
    const { canvas } = this;
    [canvas.width, canvas.height] = [canvas.clientWidth, canvas.clientHeight];
    const pen = canvas.getContext("2d");
    pen.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--soft");
    pen.font = "15px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.fillText("Press Start, then move the pointer in here", canvas.width / 2, canvas.height / 2, canvas.width - 16);
    pen.textAlign = "start";
  }

  #point(event) {
    const box = this.canvas.getBoundingClientRect();
    this.aim = (2 * (event.clientX - box.left) / box.width - 1) * this.reach;
  }

  #key(event) {
    const by = { ArrowLeft: -KEY * this.reach, ArrowRight: KEY * this.reach }[event.key];
    if (by === undefined) return;
    event.preventDefault();
    this.aim = Math.max(-this.reach, Math.min(this.reach, this.aim + by));
  }

  async start() {
    await this.reload();
    if (!this.numbers) return;
    this.running = true;
    this.button.textContent = "Stop";
    this.button.setAttribute("aria-pressed", "true");
    this.canvas.focus();
    this.before = performance.now();
    requestAnimationFrame((time) => this.#frame(time));
  }

  stop() {
    this.running = false;
    this.button.textContent = "Start";
    this.button.setAttribute("aria-pressed", "false");
  }

  /** Take new numbers from the server, and begin again from where the hand is. */
  async reload() {
    const without = this.with.value === "none";
    const found = await this.ask(without);
    if (!found || found.errors || found.refused || (!without && !found.rows)) {
      this.numbers = null;
      this.says.textContent = "There are no gains to press with: choose another method, or let its run end.";
      this.stop();
      return;
    }
    this.aim *= found.reach / this.reach;
    this.numbers = found;
    this.reach = found.reach;
    this.hz.disabled = without || found.rows.length < 2;
    const gains = found.rows ? gainsAt(found.rows, Number(this.hz.value) || 1) : null;
    this.loop = new Loop(found, gains, Math.min(this.aim, 0));
    this.last = Math.min(this.aim, 0);
    this.traces = [];
    this.low = this.shake = this.owed = 0;
    const named = gains ? `b ${number(gains.b)} ${unit.impedance}, k ${number(gains.k)} ${unit.stiffness}, b_p ${number(gains.bp)} ${unit.impedance}` : "no coupling";
    const left = found.left_out.length ? `; left out here: ${found.left_out.join(", ")}` : "";
    this.named = `${named}${left}`;
    this.says.textContent = this.named;
  }

  #frame(time) {
    if (!this.running) return;
    const elapsed = Math.min(0.05, Math.max(0.001, (time - this.before) / 1000));
    this.before = time;
    this.owed += elapsed;
    const period = this.numbers.sample_time_s;
    const steps = Math.floor(this.owed / period);
    this.owed -= steps * period;
    const velocity = steps ? (this.aim - this.last) / (steps * period) : 0;
    const share = 1 - Math.exp(-2 * Math.PI * FELT_HZ * period);
    const heard = new Float32Array(steps);
    for (let step = 0; step < steps; step += 1) {
      this.loop.step(this.last, velocity);
      this.last += velocity * period;
      this.low += share * (this.loop.force - this.low);
      const shaking = this.loop.force - this.low;
      this.shake += 0.01 * (shaking * shaking - this.shake);
      heard[step] = shaking;
      this.traces.push([this.loop.handle_m, this.loop.force]);
    }
    this.traces.splice(0, Math.max(0, this.traces.length - Math.ceil(SHOWN_S / period)));
    if (!(Math.abs(this.loop.handle_m) < LOST * this.reach)) {
      this.says.textContent = `It flew off: with this hand the loop is unstable (${this.named}). Press Start to begin again.`;
      this.stop();
      return;
    }
    if (this.audio && this.sound.checked) this.#hear(heard, period);
    this.#draw();
    requestAnimationFrame((next) => this.#frame(next));
  }

  #listen() {
    if (this.sound.checked && !this.audio) this.audio = new AudioContext();
    this.heardUntil = 0;
  }

  /** Play the shaking of the force, a frame behind. */
  #hear(shaking, period) {
    if (!shaking.length) return;
    const rate = this.audio.sampleRate;
    const buffer = this.audio.createBuffer(1, Math.max(1, Math.round(shaking.length * period * rate)), rate);
    const out = buffer.getChannelData(0);
    out.forEach((_, at) => {
      const row = Math.min(shaking.length - 1, at / rate / period);
      const near = Math.floor(row), next = Math.min(shaking.length - 1, near + 1);
      const value = shaking[near] + (row - near) * (shaking[next] - shaking[near]);
      out[at] = Math.max(-0.5, Math.min(0.5, (0.1 * value) / this.numbers.least_force));
    });
    const source = this.audio.createBufferSource();
    source.buffer = buffer;
    source.connect(this.audio.destination);
    this.heardUntil = Math.max(this.heardUntil, this.audio.currentTime + 0.03);
    source.start(this.heardUntil);
    this.heardUntil += buffer.duration;
  }

  #draw() {
    const { canvas } = this;
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio)) [canvas.width, canvas.height] = [width * ratio, height * ratio];
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name);
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const across = (place) => width * (0.5 + place / this.reach / 2);
    const scene = 90;
    pen.fillStyle = colour("--band");
    pen.fillRect(across(0), 0, width / 2, scene);
    this.#detents(pen, across, scene, colour);
    pen.strokeStyle = colour("--grey");
    pen.beginPath();
    pen.arc(across(this.last), scene / 2, 16, 0, 2 * Math.PI);
    pen.moveTo(across(this.last), scene / 2);
    pen.lineTo(across(this.loop.handle_m), scene / 2);
    pen.stroke();
    pen.fillStyle = colour("--a");
    pen.beginPath();
    pen.arc(across(this.loop.handle_m), scene / 2, 9, 0, 2 * Math.PI);
    pen.fill();
    if (turns()) this.#pointer(pen, across(this.loop.handle_m), scene / 2, colour);
    const force = this.loop.force, depth = this.loop.handle_m;
    const rms = Math.sqrt(Math.max(0, this.shake));
    const digits = turns() ? 2 : 0;
    const told = `${unit.pushed.toLowerCase()} ${force.toFixed(2 + digits)} ${unit.force}, ${this.#place(depth)}, shaking ${rms.toFixed(3 + digits)} ${unit.force}`;
    this.#trace(pen, 1, scene + 8, (height - scene) / 2 - 12, width, `${unit.pushed.toLowerCase()}, ${unit.force}`, colour);
    this.#trace(pen, 0, scene + (height - scene) / 2 + 4, (height - scene) / 2 - 12, width, `${unit.depth}, ${unit.milli}`, colour);
    pen.fillStyle = colour("--ink");
    pen.font = "13px system-ui, sans-serif";
    pen.fillText(told, 8, 16);
    canvas.setAttribute("aria-label", `hand, device and wall: ${told}`);
  }

  #trace(pen, column, top, tall, width, label, colour) {
    // The words stand above what is drawn, not on it.
    const words = top + 12;
    [top, tall] = [top + 18, tall - 18];
    const factor = column ? 1 : 1000;
    const values = this.traces.map((row) => factor * row[column]);
    const [low, high] = this.#span(column, values);
    pen.strokeStyle = colour("--grid");
    pen.strokeRect(0.5, top, width - 1, tall);
    pen.strokeStyle = colour("--a");
    pen.beginPath();
    values.forEach((value, row) => {
      const up = top + tall * (1 - (Math.max(low, Math.min(high, value)) - low) / (high - low));
      const left = (width * row) / Math.max(1, SHOWN_S / this.numbers.sample_time_s);
      if (row) pen.lineTo(left, up);
      else pen.moveTo(left, up);
    });
    pen.stroke();
    pen.fillStyle = colour("--soft");
    pen.font = "12px system-ui, sans-serif";
    pen.fillText(`${label}, ${low < -0.2 * high ? number(low) : ""} up to ${number(high)}; last ${SHOWN_S} s`.replace(",  up", ", up"), 8, words);
  }

  /** What a trace reaches over; with detents it has two signs. */
  #span(column, values) {
    const way = column ? (this.numbers.detent ? this.numbers.detent.force_n : this.numbers.least_force) : this.reach / 2;
    if (this.numbers.detent) {
      const most = 1.1 * values.slice(-4000).reduce((found, value) => Math.max(found, Math.abs(value)), column ? way : 1e3 * way);
      return [-most, most];
    }
    const high = 1.1 * values.slice(-4000).reduce((found, value) => Math.max(found, value), column ? way : 0.5 * this.reach);
    return [column ? 0 : -0.15 * high, high];
  }

  #place(depth) {
    if (depth > 0 && !turns()) return `${(1e6 * depth).toFixed(0)} ${unit.micro} in the wall`;
    if (depth > 0) return `${(1e3 * depth).toFixed(2)} ${unit.milli} in the wall`;
    return turns() ? `free, ${((-180 * depth) / Math.PI).toFixed(1)}° before the wall` : "free";
  }

  /** The mark of a knob, up where it meets the wall. */
  #pointer(pen, left, top, colour) {
    pen.strokeStyle = colour("--a");
    pen.lineWidth = 4;
    pen.beginPath();
    pen.moveTo(left, top);
    pen.lineTo(left + 22 * Math.sin(this.loop.handle_m), top - 22 * Math.cos(this.loop.handle_m));
    pen.stroke();
    pen.lineWidth = 1;
  }

  /** A line at each valley of the detents. */
  #detents(pen, across, tall, colour) {
    const one = this.numbers.detent;
    if (!one || one.pitch_m < this.reach / 60) return;
    pen.strokeStyle = colour("--grey");
    pen.lineWidth = 2;
    pen.beginPath();
    for (let count = Math.ceil((-this.reach - one.centre_m) / one.pitch_m); one.centre_m + count * one.pitch_m <= this.reach; count += 1) {
      const left = across(one.centre_m + count * one.pitch_m);
      pen.moveTo(left, tall - 22);
      pen.lineTo(left, tall);
    }
    pen.stroke();
    pen.lineWidth = 1;
  }
}
