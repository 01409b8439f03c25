// Before there is anything to show: what is being done, or why it cannot go on.
import { at, el } from "./element.js";
import { dropZone } from "./start.js";

const DOING = {
  reading: ["Reading the measurements", "Columns, units, tests and phases are found."],
  preparing: ["Preparing the pad", "Motion, phases and the noise floor are found, and the model is compiled. The first time on a machine this takes some seconds more."],
};

export function waitFor({ stage, error, name, worker }) {
  const host = at("#wait");
  if (stage === "failed") {
    host.replaceChildren(el("div", {}, el("h2", {}, `${name || "This"} cannot be opened`),
      el("p", { class: "wrong", role: "alert" }, error?.text || error?.message || "No reason is known."),
      el("p", {}, error?.file ? "Correct the file and drop it here again, or " : "Drop measurements here, or ", el("a", { href: "/" }, "open something else"), "."), dropZone(null)));
    return;
  }
  const [title, text] = DOING[stage] || ["Opening the session", "A moment."];
  host.replaceChildren(el("div", {}, el("h2", {}, `${title} …`), el("p", { role: "status" }, text),
    worker && worker !== "ready" ? el("p", { class: "hint" }, "The worker is starting.") : null, el("progress", { "aria-label": title })));
}
