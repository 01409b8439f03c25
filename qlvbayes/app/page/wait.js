// Before there is a model to show: what is being done, the measurements as soon as they are read, or why it cannot go on.
import { at, el } from "./element.js";
import { axisLabel } from "./lines.js";
import { Loops } from "./loops.js";
import { report } from "./report.js";
import { dropZone } from "./start.js";
import { TimeChart } from "./timechart.js";
import { View } from "./view.js";

const DOING = {
  reading: ["Reading the measurements", "Columns, units and tests are found."],
  preparing: ["Preparing the pad", "Motion, phases and the noise floor are found."],
  fitting: ["Fitting the baseline model", "These are your measurements. The model is fitted to them."],
};

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
