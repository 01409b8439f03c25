// Before there is a model to show: what can be opened, what a file leaves open, what is being done or went wrong.
import { at, calm, el, say, trying } from "./element.js";
import { get, post, remove, upload } from "./api.js";
import { axisLabel } from "./lines.js";
import { Loops } from "./loops.js";
import { report } from "./report.js";
import { TimeChart } from "./timechart.js";
import { View } from "./view.js";

const MIB = 1024 * 1024;

export async function start() {
  const host = at("#start");
  host.hidden = false;
  const known = await trying(() => get("/api/start"));
  if (!known) { host.replaceChildren(el("p", { class: "undone" }, "Nothing can be opened until the server answers. "), el("button", { type: "button", onclick: () => { calm(); start(); } }, "Try again")); return; }
  host.replaceChildren(
    el("p", { class: "under" }, "Lay the model over the measurements, see where it fails, add what is missing, and watch the error fall."),
    dropZone(known.upload_limit_bytes),
    el("div", { class: "boxes" }, bundled(known.bundled), earlier(known.sessions)),
    el("p", { class: "hint" }, `Version ${known.version}. All is computed on the machine that serves this page; nothing leaves it.`));
}

/** Where files are dropped or chosen; limit in bytes, where it is known. */
function dropZone(limit) {
  const wrong = el("p", { class: "wrong", role: "alert", hidden: true });
  const input = el("input", { type: "file", id: "files", multiple: true, onchange: () => take(input.files, limit, wrong) });
  const zone = el("div", { class: "drop" },
    el("p", { class: "line" }, "Drop measurements here"),
    el("p", {}, "A CSV file, or the files of a testing machine."),
    el("label", { for: "files" }, "Or choose files "), input,
    el("p", { class: "hint" }, `Columns time_s, displacement_mm and force_N are read as they are; you are asked about others.${limit ? ` Up to ${Math.round(limit / MIB)} MiB.` : ""}`), wrong);
  // elsewhere on the page a dropped file must not replace the page
  for (const name of ["dragover", "drop"]) addEventListener(name, (event) => event.preventDefault());
  zone.addEventListener("dragenter", () => zone.classList.add("over"));
  zone.addEventListener("dragleave", (event) => { if (!zone.contains(event.relatedTarget)) zone.classList.remove("over"); });
  zone.addEventListener("drop", (event) => { event.preventDefault(); zone.classList.remove("over"); take(event.dataTransfer.files, limit, wrong); });
  return zone;
}

async function take(files, limit, wrong) {
  if (!files.length) return;
  const size = [...files].reduce((sum, file) => sum + file.size, 0);
  const refuse = (text) => { wrong.textContent = text; wrong.hidden = false; };
  if (limit && size > limit) { refuse(`These files are ${(size / MIB).toFixed(0)} MiB together; ${Math.round(limit / MIB)} MiB can be taken. Reduce them, or open them from the command line: qlvbayes app FILE.csv`); return; }
  wrong.hidden = true;
  say("Sending the files …");
  try {
    open(await upload("/api/upload", files));
  } catch (refusal) {
    if (!refusal.error) throw refusal;
    refuse(refusal.message);
  }
}

function open({ id }) { location.assign(`/s/${encodeURIComponent(id)}`); }

function bundled(all) {
  const go = async (name) => { const made = await trying(() => post("/api/sessions", { open: name })); if (made) open(made); };
  return el("article", { class: "box" }, el("h2", {}, "Bundled pads"),
    el("ul", { class: "named" }, all.map(({ name, text }) => el("li", {}, el("button", { type: "button", onclick: () => go(name) }, `Open ${name}`), el("span", {}, ` ${text}`)))));
}

function earlier(sessions) {
  const row = ({ id, name, changed }) => {
    const item = el("li", {}, el("a", { href: `/s/${encodeURIComponent(id)}` }, name), el("span", {}, new Date(changed).toLocaleString([], { dateStyle: "medium", timeStyle: "short" })),
      el("button", { type: "button", class: "quiet", "aria-label": `Forget ${name}`, onclick: () => forget(id, name, item) }, "Forget"));
    return item;
  };
  return el("article", { class: "box" }, el("h2", {}, "Sessions"),
    sessions.length ? el("ul", { class: "named sessions" }, sessions.map(row)) : el("p", { class: "undone" }, "None yet. What you open stays here until you forget it."));
}

async function forget(id, name, item) {
  if (!confirm(`Forget ${name} and all that was computed for it?`)) return;
  await trying(async () => { await remove(`/api/s/${encodeURIComponent(id)}`); item.remove(); say(`${name} is forgotten.`); });
}

/** A file that does not say all: its first lines, and a field for each thing that is open. */
export function ask(session) {
  const { questions } = session.store.now, host = at("#asking");
  const wrong = el("p", { class: "wrong", role: "alert", hidden: true });
  const read = el("button", { type: "submit", class: "main" }, "Read it so");
  const send = async (event) => {
    event.preventDefault();
    wrong.hidden = true;
    read.disabled = true;
    try {
      const answers = Object.fromEntries([...new FormData(event.target)].map(([name, value]) => [name, value.trim()]).filter(([, value]) => value));
      session.store.set({ busy: "Reading …" });
      await post(`${session.path}/answers`, { answers });
      host.hidden = true; // another question is then asked anew
      await session.refresh();
    } catch (refusal) {
      if (!refusal.error) throw refusal;
      wrong.textContent = refusal.message;
      wrong.hidden = false;
    } finally {
      read.disabled = false;
      session.store.set({ busy: null });
    }
  };
  const several = questions.kind === "specimens";
  const form = el("form", { onsubmit: send }, several ? specimens(questions) : el("div", { class: "fields" }, questions.ask.map(field)),
    wrong, el("div", { class: "controls" }, read, el("a", { href: "/" }, "Open something else")));
  host.replaceChildren(
    el("h2", {}, several ? "Which test is of which pad?" : `What is what in ${questions.file}?`),
    el("p", {}, questions.text), form,
    questions.lines ? el("figure", {}, el("figcaption", {}, "The first lines of the file"), el("pre", { tabindex: "0" }, questions.lines)) : "");
  form.querySelector("select, input:checked, input:not([type=radio])").focus();
}

function field({ name, text, choices, value }) {
  const id = `ask-${name}`;
  const input = choices
    ? el("select", { id, name, required: true }, el("option", { value: "" }, "choose …"), choices.map((choice) => el("option", { value: choice, selected: choice === value }, choice)))
    : el("input", { id, name, required: true, value: value ?? "", autocomplete: "off" });
  return el("div", {}, el("label", { for: id }, text[0].toUpperCase() + text.slice(1)), input);
}

/** The tests of the file; with several pads a name for each test, which the server suggests. */
function specimens({ rows: [head, ...rows], ask: [how, ...tests] }) {
  const inputs = tests.map(({ name, text, value }) => el("input", { id: `ask-${name}`, name, value: value ?? "", "aria-label": `Pad of ${text}`, autocomplete: "off", spellcheck: "false" }));
  const cells = [el("th", { scope: "col" }, "Pad"), ...inputs.map((input) => el("td", {}, input))];
  const show = (value) => {
    for (const cell of cells) cell.hidden = value === "one";
    for (const input of inputs) input.required = value !== "one";
  };
  const choice = (value, text) => el("label", {}, el("input", { type: "radio", name: how.name, value, checked: value === how.value, onchange: () => show(value) }), text);
  show(how.value);
  return [
    el("fieldset", { class: "choices" }, el("legend", {}, "These tests are of"), choice("one", "one pad"), choice("several", "several pads, named in the table")),
    el("div", { class: "wide", tabindex: "0" }, el("table", {}, el("caption", {}, "The tests of the file"),
      el("thead", {}, el("tr", {}, el("th", { scope: "col" }, head[0]), cells[0], head.slice(1).map((name) => el("th", { scope: "col", class: "n" }, name)))),
      el("tbody", {}, rows.map(([test, ...facts], row) => el("tr", {}, el("th", { scope: "row" }, test), cells[row + 1], facts.map((text) => el("td", { class: "n" }, text)))))))];
}

const DOING = {
  reading: ["Reading the measurements", "Columns, units and tests are found."],
  preparing: ["Preparing the pad", "Motion, phases and the noise floor are found."],
  fitting: ["Fitting the baseline model", "These are your measurements. The model is fitted to them."],
};

/** What is being done before there is a model, or why it cannot go on. */
export function waitFor({ stage, error, name, worker, sketch, limit }) {
  const host = at("#waiting");
  if (stage === "failed") {
    at("#sketch").hidden = true;
    host.replaceChildren(el("div", {}, el("h2", {}, `${name || "This"} cannot be opened`),
      el("p", { class: "wrong", role: "alert" }, error?.text || error?.message || "No reason is known."),
      el("p", {}, error?.file ? "Correct the file and drop it here again, or " : "Drop measurements here, or ", el("a", { href: "/" }, "open something else"), "."), dropZone(limit)));
    return;
  }
  const [title, text] = DOING[sketch && stage !== "reading" ? "fitting" : stage] || ["Opening the session", "A moment."];
  host.replaceChildren(el("div", {}, el("h2", {}, `${title} …`), el("p", { role: "status" }, text),
    worker && worker !== "ready" ? el("p", { class: "hint" }, "The worker is starting: this takes some seconds.") : null, el("progress", { "aria-label": title })));
}

/** The measurements alone, all tests side by side. */
export function drawSketch({ units, tests }) {
  at("#sketch").hidden = false;
  const idle = { zoomed: () => {}, pointed: () => {} }, view = new View(tests, "log");
  const [depth, observed] = [view.gather((test) => test.d), view.gather((test) => test.observed)], none = observed.map(() => null);
  const label = axisLabel(units, "force"), names = { names: units.names, name: units.names.force, unit: units.force, model: "model" };
  const { series, values } = report.forceChart(names, { t: view.x, low: none, high: none, observed, mean: none });
  new TimeChart(at("#sketch-force"), 250, idle).show(view, { series: series.slice(0, 4), values: values.slice(0, 4), bands: [], label });
  new Loops(at("#sketch-loops"), 230, idle.pointed).show({ depth, observed, mean: none }, [axisLabel(units, "displacement"), label]);
}
