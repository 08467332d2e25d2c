// Questions to the server. Of each kind one is under way; what was asked meanwhile is asked once, as it is then.

// What follows would slow a slider down that still moves.
const PAUSE_MS = 120;

export class Client {
  /** @param tell is given a short text on what is under way. */
  constructor(tell) {
    this.tell = tell;
    this.waiting = 0;
    this.timer = null;
  }

  /** Ask; null where there is no answer. */
  async ask(part, question) {
    this.waiting += 1;
    this.timer ??= setTimeout(() => this.tell("computing"), 200);
    try {
      const answer = await fetch(part, {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify(question),
      });
      const found = await answer.json();
      if (!answer.ok) throw new Error(found.error);
      this.trouble = "";
      return found;
    } catch (error) {
      this.trouble = error instanceof TypeError ? "The server does not answer: has avc explore ended?" : error.message;
      return null;
    } finally {
      this.waiting -= 1;
      if (!this.waiting) {
        clearTimeout(this.timer);
        this.timer = null;
        this.tell(this.trouble || "ready");
      }
    }
  }
}

export class Follow {
  /**
   * Keep the answers of one column up to date with its settings.
   * @param client asks.
   * @param settings gives the settings of now, or null.
   * @param parts first: what is asked at every change; after: what follows when that has been answered and nothing has
   *   changed meanwhile; then: what follows one of these; answered(part, found, since) is given each answer, and when its oldest change was made.
   */
  constructor(client, settings, parts) {
    Object.assign(this, { client, settings, parts });
    this.version = 0;
    this.busy = new Set();
    this.unasked = this.since = 0;
  }

  changed(time) {
    this.version += 1;
    this.unasked ||= time;
    this.#run(this.parts.first);
  }

  async #run(part) {
    if (this.busy.has(part)) return;
    this.busy.add(part);
    const version = this.version;
    const settings = this.settings();
    if (part === this.parts.first) [this.since, this.unasked] = [this.unasked, 0];
    const since = this.since;
    const found = settings && await this.client.ask(part, { settings });
    this.busy.delete(part);
    const first = part === this.parts.first;
    if (found && (first || version === this.version)) this.parts.answered(part, found, since);
    if (version !== this.version) {
      if (first) this.#run(part);
      else this.#rest(part);
      return;
    }
    if (!found || found.errors || found.refused) return;
    if (!first) {
      if (this.parts.then?.[part]) this.#rest(this.parts.then[part]);
      return;
    }
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.parts.after.forEach((next) => this.#rest(next)), PAUSE_MS);
  }

  /** Ask for what follows, unless the first answer is still to come: that asks for it then. */
  #rest(part) {
    if (!this.busy.has(this.parts.first)) this.#run(part);
  }
}
