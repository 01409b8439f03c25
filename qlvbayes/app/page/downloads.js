// What can be taken away: the report, figures, residuals, constants, and how to repeat it all.
import { el } from "./element.js";
import { get } from "./api.js";
import { plain } from "./numbers.js";
import { trying } from "./say.js";

const ALL = "-"; // the server's pad for figures of all pads

export function downloads(session, jobs) {
  const menu = el("details", { class: "menu" }, el("summary", {}, "Save and export"));
  const body = el("div", { class: "menu-body" });
  menu.append(body);
  const fill = async () => {
    if (!menu.open) return;
    const { pad, entry } = session.store.now;
    const [figures, repeat] = await Promise.all([trying(() => get(`${session.path}/figures`)), pad ? trying(() => get(`${session.padPath()}/repeat`)) : null]);
    body.replaceChildren(...[
      el("h3", {}, "All of it"), list([
        link(`${session.path}/report.html`, "Report", "report.html, in one file", false),
        link(`${session.path}/tidy.csv`, "Measurements", "the tidy CSV that was read", true)]),
      pad && el("h3", {}, `Pad ${pad}, model in the list of errors`), pad && list([
        link(`${session.padPath()}/residuals.csv?state=${entry.current}`, "Residuals", "every sample: measured, model, residual", true),
        link(`${session.padPath()}/constants.csv`, "Constants", "with priors, initial values and fit range", true),
        link(`${session.padPath()}/repeat.py`, "Python script", "repeats what was clicked", true),
        link(`${session.padPath()}/repeat.sh`, "Command lines", "do the same in a terminal", true)]),
      repeat && el("pre", {}, el("code", {}, repeat.commands)),
      el("h3", {}, "Figures"), figuresOf(session, figures?.figures || []),
      el("button", { type: "button", onclick: () => jobs.start("report") }, "Draw the figures and the report anew"),
    ].filter(Boolean));
  };
  menu.addEventListener("toggle", fill);
  session.store.on(["entries"], fill);
  document.addEventListener("click", (event) => { if (!menu.contains(event.target)) menu.open = false; });
  menu.addEventListener("keydown", (event) => { if (event.key === "Escape") { menu.open = false; menu.firstChild.focus(); } });
  return menu;
}

const list = (links) => el("ul", { class: "named" }, links);

function link(href, text, about, saved) {
  return el("li", {}, el("a", { href, download: saved, target: saved ? null : "_blank" }, text), el("span", {}, ` ${about}`));
}

function figuresOf(session, figures) {
  if (!figures.length) return el("p", { class: "undone" }, "None yet: sample or search first, or draw them now.");
  return el("ul", { class: "named" }, figures.map(({ pad, name, formats }) => el("li", {}, `${pad && pad !== ALL ? `${pad}: ` : ""}${plain(name)} `,
    formats.map((format) => el("span", {}, el("a", { href: `${session.padPath(pad || ALL)}/figures/${encodeURIComponent(name)}.${format}`, download: true, "aria-label": `${plain(name)} as ${format.toUpperCase()}` }, format.toUpperCase()), " ")))));
}
