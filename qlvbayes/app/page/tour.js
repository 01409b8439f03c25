// Five steps on the first visit: what each pane is for, and in which order to use them.
import { at, el } from "./element.js";

const SEEN = "qlvbayes-tour-seen";
const STEPS = [
  [".measured", "Measurements and model", "Dots are measured, the blue line is the model. Drag across to zoom, point at a sample: the same one is marked in every chart."],
  [".map", "Where it fails", "Each cell is the error in one phase of one test, in units of the noise. Choose a dark one: the charts go there, and the line below says what is wrong."],
  [".hypotheses", "What may be missing", "“Draw it” lays what an effect would do over the residual. Where it matches, add it. The search gives every effect its probability."],
  [".constants", "By hand", "Move a constant and see what it does. “Fit from here” finds the best from where you are; “Sample” shows how sure the constants are."],
  [".errors", "Watch the error fall", "Every model you tried, its error on all tests and on tests left out, down to the noise. Click one to go back to it."],
];

export function firstVisit() { return localStorage.getItem(SEEN) == null; }

export function tour(from = document.activeElement) {
  const host = at("#tour");
  let k = 0;
  const end = () => {
    localStorage.setItem(SEEN, "1");
    host.replaceChildren();
    document.querySelectorAll(".toured").forEach((pane) => pane.classList.remove("toured"));
    removeEventListener("keydown", keys);
    if (from?.isConnected) from.focus();
  };
  const keys = (event) => { if (event.key === "Escape") end(); };
  const show = (next) => {
    k = next;
    const [where, title, text] = STEPS[k], pane = at(where), last = k === STEPS.length - 1;
    document.querySelectorAll(".toured").forEach((one) => one.classList.remove("toured"));
    pane.classList.add("toured");
    pane.scrollIntoView({ block: "nearest" });
    const on = el("button", { type: "button", class: "main", onclick: () => (last ? end() : show(k + 1)) }, last ? "Begin" : "Next");
    host.replaceChildren(el("div", { class: "tour", role: "dialog", "aria-labelledby": "tour-title", "aria-describedby": "tour-text" },
      el("h2", { id: "tour-title" }, `${k + 1} of ${STEPS.length}: ${title}`), el("p", { id: "tour-text" }, text),
      el("div", { class: "controls" }, el("button", { type: "button", onclick: end }, "Skip the tour"), k ? el("button", { type: "button", onclick: () => show(k - 1) }, "Back") : null, on)));
    on.focus({ preventScroll: true });
  };
  addEventListener("keydown", keys);
  show(0);
}
