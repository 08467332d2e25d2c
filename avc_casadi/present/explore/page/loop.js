// One sample of the loop, as the scene runs it with integrator = "projected": its numbers come from the server.

const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

/** b, k and b_p of a table at a frequency: its nearest row. */
export function gainsAt(rows, hz) {
  const near = rows.reduce((one, other) =>
    Math.abs(Math.log(other[0] / hz)) < Math.abs(Math.log(one[0] / hz)) ? other : one);
  return { b: near[1], k: near[2], bp: near[3] };
}

export class Loop {
  /**
   * @param numbers what the server says of the loop (SI units).
   * @param gains b, k and b_p; null joins device and wall without a coupling.
   * @param start_m where everything rests at first.
   */
  constructor(numbers, gains, start_m) {
    this.n = numbers;
    const { damping_ns_per_m: be, stiffness_n_per_m: ke } = numbers.wall;
    const period = numbers.sample_time_s;
    this.kappa_e = ke + be / period;
    this.surfaceShare = this.kappa_e > 0 ? be / this.kappa_e / period : 0;
    const kappa = gains ? gains.k + gains.b / period : Infinity;
    const rigid = !gains || kappa === 0;
    this.memory = rigid ? 0 : gains.b / kappa / period;
    this.compliance = rigid ? 0 : 1 / kappa;
    this.series = !gains ? this.kappa_e : kappa === 0 ? 0 : kappa * (this.kappa_e / (kappa + this.kappa_e));
    this.bp = gains ? gains.bp : 0;
    this.state = new Array(numbers.stretches[0].matrix.length).fill(0);
    for (let row = 0; row < this.state.length; row += 2) {
      if (row <= Math.max(numbers.held, numbers.measured)) this.state[row] = start_m;
    }
    this.stretchBefore = 0;
    this.surfaceBefore = numbers.clips_last ? start_m : Math.max(start_m, 0);
    this.positionBefore = start_m;
    this.detentBefore = start_m;
    this.believed = null;
    this.asked = 0;
    this.line = new Array(numbers.whole_delay + 1).fill(0);
    this.force = 0;
  }

  get position_m() {
    return this.state[0];
  }

  get handle_m() {
    return this.state[this.n.held];
  }

  /** Move by one sample while the hand's target goes on from target_m at velocity_m_per_s. */
  step(target_m, velocity_m_per_s) {
    const n = this.n;
    const step = n.encoder_resolution_m;
    const measured = this.state[n.measured];
    let seen = step > 0 ? step * Math.floor(measured / step + 0.5) : measured;
    if (n.state_feedback) seen = this.#believe(seen);
    const command = this.#wall(seen) + this.#detent(seen);
    const limit = n.max_force_n;
    this.asked = limit === null ? command : clamp(command, -limit, limit);
    this.line.unshift(this.asked);
    const [force, before] = this.line.slice(n.whole_delay, n.whole_delay + 2);
    this.line.length = n.whole_delay + 1;
    this.force = force;
    let begin = 0;
    n.stretches.forEach((stretch, index) => {
      const late = n.stretches.length === 2 && index === 0;
      this.#move(stretch, late ? before : force, target_m + velocity_m_per_s * begin, velocity_m_per_s);
      begin += stretch.step_s * n.substeps;
    });
  }

  #believe(measured) {
    const law = this.n.state_feedback;
    const seen = measured + law.face_m;
    const predicted = law.state.map((row, place) =>
      this.believed
        ? law.force_m_per_n[place] * this.asked + row.reduce((sum, a, from) => sum + a * this.believed[from], 0)
        : law.positions.includes(place) ? seen : 0);
    let error = seen - predicted[law.measures];
    error -= clamp(error, -law.dead_zone_m, law.dead_zone_m);
    this.believed = predicted.map((value, place) => value + law.innovation[place] * error);
    return this.believed.reduce((sum, value, place) => sum + law.feedback[place] * value, 0);
  }

  #wall(x) {
    if (this.kappa_e === 0) return 0;
    const lawful = this.n.clips_last;
    const free = x - this.memory * this.stretchBefore;
    let force = this.series * (free - this.surfaceShare * this.surfaceBefore);
    if (!lawful) force = Math.max(force, 0);
    const tool = free - this.compliance * force;
    this.stretchBefore = x - tool;
    this.surfaceBefore = lawful ? tool : Math.max(tool, 0);
    if (this.bp > 0) {
      force += (this.bp * (x - this.positionBefore)) / this.n.sample_time_s;
      this.positionBefore = x;
      if (!lawful) force = x > 0 ? Math.max(force, 0) : 0;
    }
    return Math.max(force, 0);
  }

  /** Valleys at equal distances, everywhere on the way. */
  #detent(x) {
    const one = this.n.detent;
    if (!one) return 0;
    const turns = (x - one.centre_m) / one.pitch_m;
    const share = (turns - Math.floor(turns + 0.5)) / one.width;
    const rate = (x - this.detentBefore) / this.n.sample_time_s;
    this.detentBefore = x;
    return (Math.abs(share) < 0.5 ? one.force_n * Math.sin(2 * Math.PI * share) : 0) + one.damping_ns_per_m * rate;
  }

  #move(stretch, force, target, velocity) {
    const limit = this.n.friction_n;
    for (let part = 0; part < this.n.substeps; part += 1) {
      const aim = target + velocity * stretch.step_s * part;
      const sliding = stretch.matrix.map((row, place) =>
        row.reduce((sum, a, from) => sum + a * this.state[from], 0) +
        stretch.force[place] * force + stretch.target[place][0] * aim + stretch.target[place][1] * velocity);
      const stopping = -sliding[1] / stretch.friction[1];
      const friction = clamp(stopping, -limit, limit);
      this.state = sliding.map((value, place) => value + stretch.friction[place] * friction);
      if (limit > 0 && Math.abs(stopping) <= limit) this.state[1] = 0;
    }
  }
}
