// A file that does not say all: its first rows, its curves, and a field for each thing that is open.
import { at, el } from "./element.js";
import { post } from "./api.js";
import { report } from "./report.js";
import { Loops } from "./loops.js";
import { TimeChart } from "./timechart.js";
import { plain } from "./numbers.js";
import { specimens } from "./specimens.js";

export function ask(session) {
  const { questions } = session.store.now, host = at("#asking");
  const wrong = el("p", { class: "wrong", role: "alert", hidden: true });
  const { title, fields, below, given, shown } = questions.kind === "specimens" ? specimens(session, questions) : unknown(questions);
  const read = el("button", { type: "submit", class: "main" }, "Read it so");
  const send = async (event) => {
    event.preventDefault();
    wrong.hidden = true;
    read.disabled = true;
    try {
      const answers = await given();
      if (!answers) return;
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
  host.replaceChildren(
    el("h2", {}, title),
    el("p", {}, questions.text),
    el("form", { onsubmit: send }, fields, wrong, el("div", { class: "controls" }, read, el("a", { href: "/" }, "Open something else"))),
    ...below);
  shown(); // once the curves have a width
  host.querySelector("select, input:checked, input:not([type=radio])")?.focus();
}

/** A field for each thing that is open, above the first rows and the curves. */
function unknown({ file, ask: asked, rows, curves }) {
  const fields = el("div", { class: "fields" }, asked.map((one) => field(one)));
  const drawn = el("div", { class: "asked-curves" });
  return { title: `What is what in ${file}?`, fields: [fields], below: [table(rows), drawn], given: () => answersOf(fields, asked), shown: () => curves && draw(drawn, curves) };
}

function field({ name, text, choices, value, optional }) {
  const id = `ask-${name}`, required = !optional;
  const input = choices
    ? el("select", { id, name, required }, el("option", { value: "" }, optional ? "none" : "choose …"), choices.map((choice) => el("option", { value: choice, selected: choice === value }, choice)))
    : el("input", { id, name, required, value: value ?? "", autocomplete: "off" });
  const label = text || plain(name);
  return el("div", {}, el("label", { for: id }, label[0].toUpperCase() + label.slice(1)), input);
}

function answersOf(host, asked) {
  const given = asked.map(({ name }) => [name, at(`#ask-${CSS.escape(name)}`, host).value.trim()]);
  return Object.fromEntries(given.filter(([, value]) => value !== ""));
}

function table(rows) {
  if (!rows?.length) return "";
  const [head, ...body] = rows;
  return el("div", { class: "wide", tabindex: "0" }, el("table", {}, el("caption", {}, "The first rows of the file"),
    el("thead", {}, el("tr", {}, head.map((cell) => el("th", { scope: "col" }, cell)))),
    el("tbody", {}, body.map((row) => el("tr", {}, row.map((cell) => el("td", {}, cell)))))));
}

/** Force against time and against displacement, in the file's own numbers. */
function draw(host, { time, displacement, force }) {
  const [left, right] = ["Force against time, as in the file", "Force against displacement, as in the file"].map((label) => el("div", { class: "chart", role: "img", "aria-label": label }));
  host.replaceChildren(left, right);
  const idle = { zoomed: () => {}, pointed: () => {} };
  const view = { x: time, samples: time, many: false, time: null, whole: () => [Math.min(...time), Math.max(...time)], moment: (place) => [0, place], axis: (along) => ({ ...along, label: "time (as in the file)" }), drawBorders: () => {} };
  new TimeChart(left, 220, idle).show(view, { series: [report.line("time"), report.line("force", report.INK)], values: [time, force], bands: [], label: "force (as in the file)" });
  new Loops(right, 220, idle).show({ depth: displacement, observed: force, mean: force }, ["displacement (as in the file)", "force (as in the file)"]);
}
