// A slider's moves, one request at a time: the newest model is asked for, what came between is never asked.
import { post } from "./api.js";
import { byTest } from "./session.js";
import { trouble } from "./say.js";

const KEPT = 500; // measurements of how long a redraw takes, for whoever looks at performance.getEntriesByName("redraw")

export class Redraw {
  constructor(session) {
    Object.assign(this, { session, store: session.store, wanted: null, running: false });
  }

  /** The model as the sliders have it now; it is drawn as soon as can be. */
  want(hand) {
    this.store.set({ hand, moved: true });
    this.wanted ??= { since: performance.now() };
    this.wanted.hand = hand;
    if (!this.running) { this.running = true; requestAnimationFrame(() => this.next()); }
  }

  async next() {
    const { hand, since } = this.wanted, epoch = this.session.epoch;
    this.wanted = null;
    if (hand !== this.store.now.hand) { this.running = false; return; } // a fit came between
    try {
      const curves = byTest(await post(`${this.session.padPath()}/curves`, hand));
      if (epoch === this.session.epoch) { // else a fit or another pad came between: stale
        this.store.set({ shown: curves });
        this.measure(since);
      }
    } catch (refusal) {
      if (!refusal.told) throw refusal;
      if (!refusal.overtaken) trouble(refusal);
    }
    if (this.wanted) requestAnimationFrame(() => this.next());
    else this.running = false;
  }

  measure(since) {
    if (performance.getEntriesByName("redraw").length >= KEPT) performance.clearMeasures("redraw");
    performance.measure("redraw", { start: since, end: performance.now() });
  }
}
