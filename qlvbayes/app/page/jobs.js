// Long work: what runs, how far it is, how long it takes, and how to stop it.
import { at, el, refill, say, trying } from "./element.js";
import { get, post, remove } from "./api.js";
import { plain, span } from "./numbers.js";

const live = (job) => ["waiting", "running"].includes(job.state);

/** Whether a job of this kind is on its way for a pad. */
export const running = (kind, { jobs, pad }) => jobs.some((job) => job.kind === kind && live(job) && (!job.pad || job.pad === pad));

const NAMES = { sample: "Sample", diagnose: "Search" };

export class Jobs {
  constructor(session) {
    Object.assign(this, { session, store: session.store, states: new Map() });
    this.store.on(["jobs"], ({ jobs }) => jobs.forEach((job) => this.announce(job)));
    this.store.on(["jobs", "entry"], () => this.show());
  }

  async start(kind) {
    const { pad, hand: model } = this.store.now;
    const job = await trying(() => post(`${this.session.path}/jobs`, { kind, pad, model }));
    if (job) this.session.heardJob(job);
  }

  async stop(id) {
    const job = this.store.now.jobs.find((one) => one.id === id);
    if (!job) return;
    await trying(() => remove(`${this.session.path}/jobs/${encodeURIComponent(job.id)}`));
    if (live(job)) await trying(async () => this.session.heardJob(await get(`${this.session.path}/jobs/${encodeURIComponent(job.id)}`)));
    else this.store.set({ jobs: this.store.now.jobs.filter((one) => one.id !== job.id) });
  }

  /** A search ends with what it knows by its next step. */
  async enough(id) {
    const job = await trying(() => post(`${this.session.path}/jobs/${encodeURIComponent(id)}/enough`));
    if (!job) return;
    this.session.heardJob(job);
    say("The search sums up what it knows.");
  }

  show() {
    const { jobs, entry } = this.store.now, searches = (job) => job.kind === "diagnose";
    refill(at("#search-jobs"), jobs.filter(searches).map((job) => this.row(job)));
    refill(at("#jobs"), [...jobs.filter((job) => !searches(job)).map((job) => this.row(job)), bandsLine(entry)].filter(Boolean));
  }

  row(job) {
    const known = job.total ? job.done / job.total : null;
    const bar = live(job) ? el("progress", known == null ? { "aria-label": NAMES[job.kind] } : { max: "1", value: known, "aria-label": NAMES[job.kind] }) : null;
    return el("div", { class: `job ${job.state}`, "data-key": job.id },
      el("div", { class: "head" }, el("b", {}, NAMES[job.kind]), el("span", { class: "small" }, ` ${progressOf(job)}`),
        this.enoughButton(job),
        el("button", { type: "button", class: "quiet", "data-act": "stop", "aria-label": `${live(job) ? "Cancel" : "Put away"}: ${NAMES[job.kind]}`, onclick: () => this.stop(job.id) }, live(job) ? "Cancel" : "✕")),
      bar, job.error ? el("p", { class: "wrong", role: "alert" }, job.error.text || job.error.message) : null);
  }

  /** Offered once something is known; then it says that it was heard. */
  enoughButton(job) {
    if (!live(job) || job.enough == null) return null;
    return el("button", { type: "button", "data-act": "enough", disabled: job.enough, title: "End the search here and sum up what is known so far", onclick: () => this.enough(job.id) },
      job.enough ? "Summing up …" : "That is enough");
  }

  /** Says once when a job begins, ends or fails, not at every step. */
  announce(job) {
    const before = this.states.get(job.id);
    this.states.set(job.id, job.state);
    if (before !== job.state && (before || live(job))) say(`${NAMES[job.kind]}: ${progressOf(job)}`);
  }
}

/** What is being done; of one pad the page need not say of which. */
const stageOf = (job) => plain(job.text || "").replace(job.pad ? `pad ${job.pad}: ` : "", "");

function progressOf(job) {
  if (job.state === "waiting") return job.place > 0 ? `waiting, place ${job.place} in the queue` : "waiting";
  if (job.state === "running") {
    const left = job.left_s == null ? (job.elapsed_s == null ? "" : `, ${span(job.elapsed_s)} so far`) : `, ${span(job.left_s)} left`;
    return `${stageOf(job) || "running"}${left}`;
  }
  return { done: `done after ${span(job.elapsed_s ?? 1)}`, failed: "failed", cancelled: "cancelled" }[job.state] || job.state;
}

/** Whether the bands that are drawn are good, and why none is. */
function bandsLine(entry) {
  const bands = entry?.bands;
  if (!bands) return null;
  if (!bands.converged) return el("p", { class: "warning small" }, `The sampling has not converged, so no band is drawn. ${(bands.summary?.troubles || []).join("; ")}`);
  if (bands.state == null) return el("p", { class: "hint" }, "A command sampled another model of this pad. Sample here to see the band.");
  if (bands.state !== entry.current) return el("p", { class: "hint" }, "The sampled band belongs to an earlier model; go back to it to see it.");
  return el("p", { class: "hint" }, "Blue band: 90 % of what the sampled model predicts.");
}
