"use strict";
// Force and residual curves of every pad: drag to zoom, double-click for all, a button a phase.
document.documentElement.classList.add("js");

const INK = "#1b1f24", BLUE = "#0072b2", ORANGE = "#d55e00", GREY = "#8c959f";
const BAND = "rgba(0, 114, 178, 0.22)", NOISE = "rgba(140, 149, 159, 0.30)";
const NAMES = { ramp: "ramp", hold: "hold", unload: "unloading", recovery: "recovery" };
const short = (value) => (value == null ? "–" : String(+value.toPrecision(4)).replace("-", "−"));

function unitOf(name, unit) { return unit === "1" ? name : `${name} (${unit})`; }

function axes(label) {
  const look = { stroke: INK, grid: { stroke: "#eaeef2" }, font: "12px system-ui, sans-serif" };
  const ticks = (u, values) => values.map((v) => short(v));
  return [
    { ...look, label: "time since the test began (s)", size: 34, labelSize: 20, labelFont: look.font, values: ticks },
    { ...look, label, labelSize: 22, labelFont: look.font, size: 62, values: ticks },
  ];
}

function line(label, stroke, more) {
  return { label, stroke, width: 1.5, points: { show: false }, value: (u, v) => short(v), ...more };
}

function edge() { return { label: "", stroke: "transparent", width: 0, points: { show: false } }; }

function dots(label) {
  return line(label, INK, { width: 0, paths: () => null, points: { show: true, size: 3.5, width: 0, fill: INK }, mark: INK });
}

function forceChart(data, test) {
  const series = [line("time (s)"), edge(), edge(), dots("measured"), line(data.model, BLUE)];
  const values = [test.t, test.low, test.high, test.observed, test.mean];
  if (test.plain) {
    series.push(line("plain model", ORANGE, { dash: [6, 4] }));
    values.push(test.plain);
  }
  return { series, values, bands: [{ series: [2, 1], fill: BAND }], label: unitOf(data.name, data.unit) };
}

function residualChart(data, test) {
  const minus = (mean) => test.observed.map((value, k) => value - mean[k]);
  const flat = (value) => test.t.map(() => value);
  const series = [line("time (s)"), edge(), edge(), line(data.model, BLUE, { points: { show: true, size: 3, width: 0, fill: BLUE } })];
  const values = [test.t, flat(-data.noise), flat(data.noise), minus(test.mean)];
  if (test.plain) {
    series.push(line("plain model", ORANGE, { dash: [6, 4] }));
    values.push(minus(test.plain));
  }
  return { series, values, bands: [{ series: [2, 1], fill: NOISE }], label: unitOf("residual", data.unit) };
}

class Viewer {
  constructor(root) {
    this.root = root;
    this.data = JSON.parse(root.querySelector("script").textContent);
    this.charts = [];
    this.key = root.dataset.pad; // one cursor in both
    this.select = root.querySelector("select");
    this.buttons = root.querySelector(".phases");
    this.range = root.querySelector(".range");
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
    this.charts.forEach((chart) => chart.destroy());
    this.charts = [
      this.draw(".force", forceChart(this.data, this.test), 300),
      this.draw(".residual", residualChart(this.data, this.test), 210),
    ];
    this.offer();
    this.zoom(this.test.t[0], this.test.t[this.test.t.length - 1]);
  }

  draw(where, { series, values, bands, label }, height) {
    const options = {
      width: this.width(), height, series, bands, axes: axes(label),
      scales: { x: { time: false } },
      legend: { live: true, markers: { width: 0, fill: (chart, k) => series[k].mark || series[k].stroke } },
      cursor: { drag: { x: true, y: false }, y: false, sync: { key: this.key } },
      hooks: { setScale: [(chart, key) => key === "x" && this.follow(chart)] },
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
    this.tell(min, max);
  }

  zoom(min, max) { if (this.charts.length) this.charts[0].setScale("x", { min, max }); }

  tell(min, max) {
    this.root.dataset.min = min;
    this.root.dataset.max = max;
    this.range.textContent = `Shown: ${short(min)} s to ${short(max)} s.`;
    for (const button of this.buttons.children) {
      const near = (a, b) => Math.abs(a - b) < 1e-9 * (1 + Math.abs(b));
      button.setAttribute("aria-pressed", near(+button.dataset.min, min) && near(+button.dataset.max, max));
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
