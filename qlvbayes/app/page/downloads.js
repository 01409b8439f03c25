// What can be taken away: the report, the measurements, and how to repeat it all.
import { el } from "./element.js";

export function downloads(session) {
  const body = el("div", { class: "menu-body" });
  const menu = el("details", { class: "menu" }, el("summary", {}, "Save and export"), body);
  const fill = () => {
    const { pad } = session.store.now;
    body.replaceChildren(
      el("h3", {}, "All of it"), el("ul", { class: "named" },
        link(`${session.path}/report.html`, "Report", "with all figures, in one file; drawing it takes a moment", false),
        link(`${session.path}/tidy.csv`, "Measurements", "the tidy CSV that was read", true)),
      el("h3", {}, `Pad ${pad}, model in the list of errors`), el("ul", { class: "named" },
        link(`${session.padPath()}/repeat.sh`, "Command lines", "sample, check and diagnose it in a terminal", true)));
  };
  menu.addEventListener("toggle", fill);
  document.addEventListener("click", (event) => { if (!menu.contains(event.target)) menu.open = false; });
  menu.addEventListener("keydown", (event) => { if (event.key === "Escape") { menu.open = false; menu.firstChild.focus(); } });
  return menu;
}

function link(href, text, about, saved) {
  return el("li", {}, el("a", { href, download: saved, target: saved ? null : "_blank" }, text), el("span", {}, ` ${about}`));
}
