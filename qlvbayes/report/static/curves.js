"use strict";
// What every chart of a test is made of: axes of time, lines, bands, names of phases.

const INK = "#1b1f24", BLUE = "#0072b2", ORANGE = "#e69f00", GREY = "#8c959f";
const BAND = "rgba(0, 114, 178, 0.22)", NOISE = "rgba(140, 149, 159, 0.30)";
const NAMES = { ramp: "ramp", hold: "hold", unload: "unloading", recovery: "recovery" };
const short = (value) => (value == null ? "–" : String(+value.toPrecision(4)).replace("-", "−"));

function unitOf(name, unit) { return unit === "1" ? name : `${name} (${unit})`; }

// Logarithmic time since the last change of motion: phases side by side, each as wide as the others.
const FEWEST_NUMBERS = 3, FEWEST_PIXELS = 46, FAST = 0.02; // between numbers; of a test, a phase that no eye finds on it
const LOG_LABEL = "time since the last change of motion (s), logarithmic", LINEAR_LABEL = "time since the test began (s)";

class LogTime {
  constructor(test) {
    this.parts = test.phases.map(([kind, start, stop]) => {
      const inside = test.t.filter((t) => t > start && t <= stop).map((t) => t - start);
      const first = Math.min(0.5 * (stop - start), Math.max(inside.length ? inside[0] : 0, 1e-4 * (stop - start)));
      return { kind, start, first, decades: Math.log((stop - start) / first) };
    });
  }
  at(place) { return Math.max(0, Math.min(this.parts.length - 1, place)); }
  to(time) {
    let k = this.parts.findIndex((part) => time <= part.start);
    k = this.at((k < 0 ? this.parts.length : k) - 1);
    const { start, first, decades } = this.parts[k];
    return Math.min(k + Math.log(Math.max(time - start, first) / first) / decades, k + 1);
  }
  from(place) {
    const k = this.at(Math.floor(place)), { start, first, decades } = this.parts[k];
    return place <= k ? start : start + first * Math.exp(Math.min(place - k, 1) * decades);
  }
  // Powers of ten; of a short stretch, which holds few of them, twice and five times each too.
  numbers(chart) {
    const powers = this.marks(chart, [1]);
    return powers.length < FEWEST_NUMBERS ? this.marks(chart, [1, 2, 5]) : powers;
  }
  marks(chart, multiples) {
    const found = [];
    const { min, max } = chart.scales.x;
    let last = -Infinity;
    this.parts.forEach(({ first, decades }, k) => {
      for (let power = Math.floor(Math.log10(first)); power <= Math.log10(first) + decades / Math.LN10; power++) {
        for (const multiple of multiples) {
          const place = k + Math.log((multiple * 10 ** power) / first) / decades, pixel = chart.valToPos(place, "x");
          const inside = place >= Math.max(min, k) && place <= Math.min(max, k + 1);
          if (inside && pixel - last > FEWEST_PIXELS) { found.push(place); last = pixel; }
        }
      }
    });
    return found;
  }
  elapsed(place) { const k = this.at(Math.floor(place)); return this.parts[k].first * Math.exp((place - k) * this.parts[k].decades); }
}

// Where one phase ends and the next begins, with their names.
function borders(chart, time) {
  const { ctx, bbox } = chart, ratio = devicePixelRatio || 1;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.strokeStyle = ctx.fillStyle = GREY;
  ctx.textAlign = "left";
  ctx.textBaseline = "alphabetic";
  ctx.setLineDash([3, 3]);
  ctx.font = `${11 * ratio}px system-ui, sans-serif`;
  time.parts.forEach(({ kind }, k) => {
    const [left, right] = [k, k + 1].map((place) => Math.max(bbox.left, Math.min(bbox.left + bbox.width, chart.valToPos(place, "x", true))));
    const name = NAMES[kind] || kind;
    if (right - left > ctx.measureText(name).width + 8 * ratio) ctx.fillText(name, left + 4 * ratio, bbox.top + 11 * ratio);
    if (k) { ctx.beginPath(); ctx.moveTo(left, bbox.top); ctx.lineTo(left, bbox.top + bbox.height); ctx.stroke(); }
  });
  ctx.restore();
}

// Readings that were left out: grey crosses, at the chart's edge where they lie beyond it.
function crosses(chart, points, place) {
  const { ctx, bbox } = chart, ratio = devicePixelRatio || 1, arm = 4 * ratio;
  const { min, max } = chart.scales.x;
  ctx.save();
  ctx.strokeStyle = GREY;
  ctx.lineWidth = 1.5 * ratio;
  for (const [time, force] of points) {
    const at = place(time);
    if (at < min || at > max) continue;
    const x = chart.valToPos(at, "x", true), y = Math.max(bbox.top, Math.min(bbox.top + bbox.height, chart.valToPos(force, "y", true)));
    ctx.beginPath();
    for (const way of [-arm, arm]) { ctx.moveTo(x - arm, y - way); ctx.lineTo(x + arm, y + way); }
    ctx.stroke();
  }
  ctx.restore();
}

function isFast(test) {
  const whole = test.t[test.t.length - 1] - test.t[0];
  return test.phases.some(([, start, stop]) => stop > start && stop - start < FAST * whole);
}

function axes(label, time) {
  const look = { stroke: INK, grid: { stroke: "#eaeef2" }, font: "12px system-ui, sans-serif" };
  const ticks = (u, values) => values.map((v) => short(v));
  const along = time
    ? { label: LOG_LABEL, splits: (u) => time.numbers(u), values: (u, places) => places.map((place) => short(time.elapsed(place + 1e-9))) }
    : { label: LINEAR_LABEL, values: ticks };
  return [
    { ...look, size: 34, labelSize: 20, labelFont: look.font, ...along },
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
    series.push(line(data.before || "plain model", ORANGE, { dash: [6, 4] }));
    values.push(test.plain);
  }
  return { series, values, bands: [{ series: [2, 1], fill: BAND }], label: unitOf(data.name, data.unit), leftOut: test.left_out || [] };
}

function residualChart(data, test) {
  const minus = (mean) => test.observed.map((value, k) => (value == null ? null : value - mean[k]));
  // what noise may do: as wide everywhere, or a width a sample
  const floor = (sign) => test.t.map((_, k) => sign * (test.floor ? test.floor[k] : data.noise));
  const series = [line("time (s)"), edge(), edge(), line(data.model, BLUE, { points: { show: true, size: 3, width: 0, fill: BLUE } })];
  const values = [test.t, floor(-1), floor(1), minus(test.mean)];
  if (test.plain) {
    series.push(line(data.before || "plain model", ORANGE, { dash: [6, 4] }));
    values.push(minus(test.plain));
  }
  return { series, values, bands: [{ series: [2, 1], fill: NOISE }], label: unitOf("residual", data.unit) };
}
