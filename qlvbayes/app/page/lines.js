// Which lines the charts hold: measured, the model in hand, the one before, the sampled band, drawn signatures.
import { report } from "./report.js";
import { plain } from "./numbers.js";

const { forceChart, residualChart, line } = report;
const PALE = "rgba(213, 94, 0, 0.6)"; // does not hide what it lies on
const BAND = 1.645; // sds on either side that hold 90 % of normal noise

/** Columns a sample of all that is drawn; a missing one is null. */
export function columnsOf(now, view) {
  const { shown, before, entry, moved } = now;
  const band = !moved && entry.bands?.converged && entry.bands.state === entry.current ? entry.bands : null;
  const ends = band && Object.fromEntries(band.tests.map((test) => [test.name, test]));
  return {
    depth: view.gather((test) => test.d),
    observed: view.gather((test) => test.observed),
    mean: view.gather((test) => shown.model[test.name]),
    before: before && view.gather((test) => before.model[test.name]),
    low: view.gather((test) => ends?.[test.name]?.low),
    high: view.gather((test) => ends?.[test.name]?.high),
    signatures: now.signatures.map((drawn) => view.gather((test) => drawn.curves[test.name])),
  };
}

export function linesOf(now, view, columns) {
  const { names, force } = now.entry.units;
  const data = { name: names.force, unit: force, noise: BAND * now.entry.noise, model: now.moved ? "model in hand" : "model", before: "before" };
  const test = { t: view.x, observed: columns.observed, mean: columns.mean, low: columns.low, high: columns.high, plain: columns.before };
  const residual = residualChart(data, test);
  residual.series[3].label = "residual";
  const measured = forceChart(data, test);
  for (const dotted of [measured.series[3], residual.series[3]]) dotted.points = { show: squares(dotted.points) };
  if (columns.before) Object.assign(residual.series[4], { label: "residual before", stroke: PALE, mark: report.ORANGE, width: 1 });
  now.signatures.forEach((drawn, k) => {
    residual.series.push(line(plain(drawn.effect), drawn.colour, { width: 2.5, dash: drawn.dash }));
    residual.values.push(columns.signatures[k]);
  });
  return { force: measured, residual };
}

/** A quantity's name with its unit, for an axis. */
export function axisLabel(units, quantity) { return report.unitOf(units.names[quantity], units[quantity]); }

/** Dots that are drawn as they are, without a path of thousands of arcs: a slider's every move draws them all. */
function squares({ size, fill }) {
  return (chart, number, first, last) => {
    const { ctx, bbox } = chart, side = size * (devicePixelRatio || 1), values = chart.data[number], places = chart.data[0];
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.fillStyle = fill;
    for (let k = first; k <= last; k++)
      if (values[k] != null) ctx.fillRect(chart.valToPos(places[k], "x", true) - side / 2, chart.valToPos(values[k], "y", true) - side / 2, side, side);
    ctx.restore();
    return false; // uPlot draws none
  };
}
