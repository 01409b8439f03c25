// One session: what the page knows of it, kept up to date by the server's events; every pane reads from here.
import { get, post } from "./api.js";
import { calm, say, trouble, trying } from "./element.js";

export const RULE = { elastic: "elastic law", relaxation: "relaxation" };
const modelOf = ({ elastic, relaxation, effects, values }) => ({ elastic, relaxation, effects, values });

export class Session {
  constructor(id, store) {
    Object.assign(this, { id, store, path: `/api/s/${encodeURIComponent(id)}`, epoch: 0 });
  }

  padPath(pad = this.store.now.pad) { return `${this.path}/pads/${encodeURIComponent(pad)}`; }

  async begin() {
    await this.refresh();
    this.listen();
  }

  /** Asks for the whole state, and loads the pad if it has become ready. */
  async refresh() {
    const state = await get(this.path);
    const { name, stage, error, questions, pads, notices, found, jobs, pad, upload_limit_bytes: limit } = state;
    this.store.set({ name, error, questions, pads, notices, found, jobs, entries: pad, limit, stage });
    if (stage === "preparing" && pads.length) this.sketch(this.first(pads));
    if (stage !== "ready") return;
    const wanted = this.store.now.pad;
    if (wanted && pad[wanted]) this.store.set({ entry: { ...pad[wanted], current: this.store.now.entry?.current ?? pad[wanted].current } });
    else await (this.loading ??= this.choose(this.first(pads)).finally(() => { this.loading = null; }));
  }

  /** The measurements are shown before there is a model: preparing them is the first of what the worker does. */
  async sketch(pad) {
    if (this.store.now.sketch || this.sketching) return;
    this.sketching = true;
    try {
      const { units, tests } = await get(`${this.padPath(pad)}/measured`);
      if (this.store.now.stage === "preparing") this.store.set({ sketch: { units, tests: bySpeed(tests) } });
    } catch (refusal) {
      if (!refusal.error) throw refusal; // the session reports its own error
    } finally { this.sketching = false; }
  }

  first(pads) {
    const asked = decodeURIComponent((location.hash.match(/^#pad=(.+)$/) || [])[1] || "");
    return pads.includes(asked) ? asked : pads[0];
  }

  /** What is needed to draw a pad: its entry, samples, catalogue. */
  async load(pad) {
    const entry = this.store.now.entries[pad] || (await post(`${this.padPath(pad)}/open`));
    this.store.now.entries[pad] = entry;
    const [measured, catalogue] = await Promise.all([get(`${this.padPath(pad)}/measured`), get(`${this.padPath(pad)}/catalogue`)]);
    return { entry, tests: bySpeed(measured.tests), catalogue };
  }

  async choose(pad) {
    this.epoch += 1;
    this.store.set({ busy: `Opening pad ${pad} …` });
    try {
      const { entry: { history, current }, tests, catalogue } = await this.load(pad);
      const state = history.find((one) => one.id === current);
      const curves = await post(`${this.padPath(pad)}/curves`, modelOf(state));
      const entry = this.store.now.entries[pad]; // with what has come meanwhile
      this.store.set({ pad, entry, catalogue, tests, signatures: [], shown: null, hand: null, before: null });
      await this.take(state, curves);
    } finally { this.store.set({ busy: null }); }
  }

  /** Makes a state the one in hand. */
  async take(state, curves) {
    this.epoch += 1;
    const hand = { ...modelOf(state), values: { ...state.values, ...curves.values } };
    const mark = this.epoch, path = this.padPath();
    const [{ parameters }, before] = await Promise.all([post(`${path}/parameters`, hand), this.curvesBefore(state)]);
    if (mark !== this.epoch) return;
    this.epoch += 1; // curves asked for meanwhile, by a slider's move, are not this state's
    const { entry, entries, pad } = this.store.now; // as it is now: errors on tests left out have come meanwhile
    const taken = { ...entry, history: joined(entry.history, state), current: state.id };
    this.store.set({ entry: taken, entries: { ...entries, [pad]: taken }, hand, parameters, moved: false, shown: byTest(curves), before });
  }

  /** The curves of the state that this one came from, to see what changed. */
  async curvesBefore(state) {
    const parent = this.store.now.entry.history.find((one) => one.id === state.parent);
    if (!parent) return null;
    return { id: parent.id, ...byTest(await post(`${this.padPath()}/curves`, modelOf(parent))) };
  }

  /** Asks for a new state: { fit }, { add, model }, { remove, model }, { keep }, { elastic, model }, ... */
  async make(body, doing) { return this.change(doing, () => post(`${this.padPath()}/states`, body)); }

  async goTo(id) { return this.change("Going back …", () => post(`${this.padPath()}/current`, { state: id })); }

  async change(doing, ask) {
    if (this.store.now.busy) return null;
    this.epoch += 1;
    calm();
    this.store.set({ busy: doing });
    const made = await trying(ask);
    if (made) await trying(() => this.take(made.state, made.curves));
    this.store.set({ busy: null });
    return made;
  }

  listen() {
    const events = new EventSource(`${this.path}/events`);
    const on = (name, listener) => events.addEventListener(name, (event) => listener(JSON.parse(event.data || "{}")));
    const again = () => trying(() => this.refresh());
    on("hello", () => { if (this.lost) { this.lost = false; calm(); } again(); });
    on("session", again);
    on("result", async ({ pad, what }) => {
      await again();
      if (what !== "diagnose" || pad !== this.store.now.pad) return;
      const catalogue = await trying(() => get(`${this.padPath(pad)}/catalogue`)); // a described law has come
      if (catalogue) this.store.set({ catalogue });
    });
    on("job", (job) => this.heardJob(job));
    on("state", ({ pad, state }) => this.heardState(pad, state));
    on("ranking", ({ pad, ranking, laws }) => this.amend(pad, laws ? { ranking, laws } : { ranking }));
    on("worker", ({ worker }) => this.heardWorker(worker));
    events.addEventListener("error", () => {
      if (this.lost) return;
      this.lost = true;
      trouble(new Error("The server does not answer. Nothing is lost: the page goes on by itself once qlvbayes app runs again."));
    });
    addEventListener("pagehide", () => events.close());
  }

  heardJob(job) {
    const jobs = this.store.now.jobs.filter((one) => one.id !== job.id);
    this.store.set({ jobs: [...jobs, job].sort((a, b) => a.id.localeCompare(b.id, "en", { numeric: true })) });
  }

  heardState(pad, state) {
    const entry = pad === this.store.now.pad ? this.store.now.entry : this.store.now.entries[pad];
    if (!entry) return;
    this.amend(pad, { history: joined(entry.history, state) });
  }

  amend(pad, changes) {
    const { entries, entry } = this.store.now;
    if (!entries?.[pad]) return;
    const amended = { ...(pad === this.store.now.pad ? entry : entries[pad]), ...changes };
    this.store.set({ entries: { ...entries, [pad]: amended }, ...(pad === this.store.now.pad ? { entry: amended } : {}) });
  }

  heardWorker(worker) {
    this.store.set({ worker });
    say(worker === "ready" ? "The worker is ready." : "The worker is starting anew; nothing is lost.");
  }
}

/** A history with a state as it was last received; an error on tests left out, once known, stays. */
function joined(history, state) {
  const old = history.find((one) => one.id === state.id), received = { ...state, heldout: state.heldout ?? old?.heldout ?? null };
  return old ? history.map((one) => (one === old ? received : one)) : [...history, received];
}

/** Slowest first, as in the figures; tests without a rate last. */
function bySpeed(tests) {
  const rate = (test) => test.rate ?? Infinity;
  return tests
    .map((test) => ({ ...test, t: test.time, d: test.displacement, observed: test.force }))
    .sort((a, b) => (rate(a) === rate(b) ? 0 : rate(a) - rate(b)));
}

/** Curves of the server, with the model by name of the test. */
export function byTest({ rmse, tests, cells, values }) {
  return { rmse, cells, values, model: Object.fromEntries(tests.map((test) => [test.name, test.model])) };
}

/** What the page knows, and who hears of a change. */
export class Store {
  constructor(first) {
    this.now = first;
    this.listeners = [];
  }

  /** Calls `listener(now)` after a change of any of these names. */
  on(names, listener) { this.listeners.push([names, listener]); }

  set(changes) {
    const changed = Object.keys(changes).filter((name) => this.now[name] !== changes[name]);
    Object.assign(this.now, changes);
    if (!changed.length) return;
    for (const [names, listener] of this.listeners) if (names.some((name) => changed.includes(name))) listener(this.now);
  }
}

const KEPT = 500; // measurements of how long a redraw takes, for whoever looks at performance.getEntriesByName("redraw")

/** A slider's moves, one request at a time: the newest model is asked for, what came between is never asked. */
export class Redraw {
  constructor(session) {
    Object.assign(this, { session, store: session.store, wanted: null, asking: false });
  }

  /** The model as the sliders have it now; it is drawn as soon as can be. */
  want(hand) {
    this.wanted ??= { since: performance.now() };
    this.wanted.hand = hand;
    if (!this.asking) this.ask();
    this.store.set({ hand, moved: true });
  }

  async ask() {
    const { hand, since } = this.wanted, epoch = this.session.epoch;
    this.wanted = null;
    this.asking = true;
    let curves = null;
    try {
      curves = byTest(await post(`${this.session.padPath()}/curves`, hand));
    } catch (refusal) {
      if (!refusal.error) throw refusal;
      if (!refusal.overtaken) trouble(refusal);
    } finally { this.asking = false; }
    if (this.wanted && this.wanted.hand === this.store.now.hand) this.ask(); // computed while this one is drawn
    else this.wanted = null;
    if (!curves || epoch !== this.session.epoch) return; // a fit or another pad came between: stale
    this.store.set({ shown: curves });
    afterFrame(() => this.measure(since));
  }

  /** From the move to the frame that shows it. */
  measure(since) {
    if (performance.getEntriesByName("redraw").length >= KEPT) performance.clearMeasures("redraw");
    performance.measure("redraw", { start: since, end: performance.now() });
  }
}

/** Once the frame that comes next was drawn. */
function afterFrame(callback) {
  requestAnimationFrame(() => {
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = callback;
    port2.postMessage(null);
  });
}
