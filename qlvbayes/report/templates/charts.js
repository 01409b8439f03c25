"use strict";
// A viewer a pad in the report: drag to zoom, double-click for all, a button a phase.
document.documentElement.classList.add("js");

const sideways = new ResizeObserver((seen) => {
  for (const { target } of seen) target.classList.toggle("cut", target.scrollWidth > target.clientWidth);
});
for (const wide of document.querySelectorAll(".wide")) sideways.observe(wide);

class Viewer {
  constructor(root) {
    this.root = root;
    this.data = JSON.parse(root.querySelector("script").textContent);
    this.charts = [];
    this.key = root.dataset.pad; // one cursor in both
    this.select = root.querySelector("select");
    this.buttons = root.querySelector(".phases");
    this.range = root.querySelector(".range");
    this.scales = [...root.querySelectorAll(".scale button")];
    this.scale = null; // until the reader chooses: logarithmic where a phase is too short to be seen
    for (const button of this.scales) button.addEventListener("click", () => { this.scale = button.value; this.show(); });
    for (const test of this.data.tests) {
      const rate = test.rate == null ? "" : `, ${test.rate} ${test.speed}`.replace(" 1/", "/");
      this.select.add(new Option(`${test.name}${rate}, ${test.fitted ? "fitted" : "predicted"}`));
    }
    this.select.selectedIndex = this.data.first;
    this.select.addEventListener("change", () => this.show());
    this.show();
    new ResizeObserver(() => this.resize()).observe(root);
  }

  show() {
    this.test = this.data.tests[this.select.selectedIndex];
    const scale = this.scale || (isFast(this.test) ? "log" : "linear");
    this.time = scale === "log" ? new LogTime(this.test) : null;
    this.root.dataset.scale = scale;
    for (const button of this.scales) button.setAttribute("aria-pressed", button.value === scale);
    this.charts.forEach((chart) => chart.destroy());
    this.charts = [
      this.draw(".force", forceChart(this.data, this.test), 300),
      this.draw(".residual", residualChart(this.data, this.test), 210),
    ];
    this.offer();
    this.zoom(this.test.t[0], this.test.t[this.test.t.length - 1]);
  }

  place(time) { return this.time ? this.time.to(time) : time; }

  timeAt(place) { return this.time ? this.time.from(place) : place; }

  draw(where, { series, values, bands, label, leftOut = [] }, height) {
    const time = this.time;
    if (time) values[0] = values[0].map((t) => time.to(t));
    series[0].value = (u, place) => short(place == null ? null : this.timeAt(place));
    const options = {
      width: this.width(), height, series, bands, axes: axes(label, time),
      scales: { x: { time: false } },
      legend: { live: true, markers: { width: 0, fill: (chart, k) => series[k].mark || series[k].stroke } },
      cursor: { drag: { x: true, y: false }, y: false, sync: { key: this.key } },
      hooks: { setScale: [(chart, key) => key === "x" && this.follow(chart)], draw: [(chart) => { if (time) borders(chart, time); crosses(chart, leftOut, (t) => this.place(t)); }] },
    };
    const chart = new uPlot(options, values, this.root.querySelector(where));
    chart.root.querySelectorAll(".u-series").forEach((row, k) => {
      if (k === 1 || k === 2) row.style.display = "none"; // edges of the band
    });
    return chart;
  }

  width() { return Math.max(240, Math.floor(this.root.clientWidth)); }

  resize() {
    if (!this.root.clientWidth) return; // on paper
    for (const chart of this.charts) if (chart.width !== this.width()) chart.setSize({ width: this.width(), height: chart.height });
  }

  follow(chart) {
    const { min, max } = chart.scales.x;
    if (min == null || this.following) return;
    this.following = true;
    for (const other of this.charts) if (other !== chart) other.setScale("x", { min, max });
    this.following = false;
    this.showRange(min, max);
  }

  zoom(min, max) { if (this.charts.length) this.charts[0].setScale("x", { min: this.place(min), max: this.place(max) }); }

  showRange(min, max) {
    const [first, last] = [min, max].map((place) => this.timeAt(place));
    this.root.dataset.min = first;
    this.root.dataset.max = last;
    this.range.textContent = `Shown: ${short(first)} s to ${short(last)} s of the test.`;
    for (const button of this.buttons.children) {
      const near = (a, b) => Math.abs(a - b) < 1e-9 * (1 + Math.abs(b));
      button.setAttribute("aria-pressed", near(this.place(+button.dataset.min), min) && near(this.place(+button.dataset.max), max));
    }
  }

  offer() {
    const time = this.test.t, seen = {}, many = {};
    for (const [kind] of this.test.phases) many[kind] = (many[kind] || 0) + 1;
    const choices = [["whole test", time[0], time[time.length - 1]]];
    for (const [kind, start, stop] of this.test.phases) {
      seen[kind] = (seen[kind] || 0) + 1;
      const room = 0.08 * (stop - start);
      const name = NAMES[kind] || kind;
      choices.push([many[kind] > 1 ? `${name} ${seen[kind]}` : name, start - room, stop + room]);
    }
    this.buttons.replaceChildren(...choices.map(([label, min, max]) => this.button(label, min, max)));
  }

  button(label, min, max) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = label;
    Object.assign(button.dataset, { min, max });
    button.addEventListener("click", () => this.zoom(min, max));
    return button;
  }
}

const viewers = [...document.querySelectorAll(".live")].map((root) => new Viewer(root));
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((d) => { d.open = true; }));
