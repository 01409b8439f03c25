// Two pads in one chart: the same motion, measured and modelled.
import { post } from "./api.js";
import { report } from "./report.js";
import { axisLabel } from "./lines.js";
import { TimeChart } from "./timechart.js";
import { byTest } from "./session.js";

const { line, LogTime, BLUE, ORANGE } = report;
const SAME = 0.05; // rates that differ by less are the same programme

/** What is drawn of a pad: its tests and its current model's curves. */
export async function sideOf(session, pad) {
  const { entry, tests } = await session.load(pad);
  const { elastic, relaxation, effects, values } = entry.history.find((one) => one.id === entry.current);
  return { pad, entry, tests, curves: byTest(await post(`${session.padPath(pad)}/curves`, { elastic, relaxation, effects, values })) };
}

/** The other pad's test at the same rate, or of the same name. */
export function partner(test, tests) {
  const near = (other) => other.rate != null && test.rate != null && Math.abs(other.rate / test.rate - 1) < SAME;
  return tests.find(near) || tests.find((other) => other.name === test.name) || null;
}

export class Overlay {
  constructor(host) { this.chart = new TimeChart(host, 300, { zoomed: () => {}, pointed: () => {} }); }

  /** sides: two of sideOf; tests: the test of each. */
  show(sides, tests) {
    const log = new LogTime(tests[0]);
    const samples = tests.flatMap((test, n) => test.t.map((time, k) => ({ place: log.to(time), n, k }))).sort((a, b) => a.place - b.place);
    const column = (n, value) => samples.map((sample) => (sample.n === n ? value(sample.k) : null));
    const looks = [{ colour: BLUE, dash: [] }, { colour: ORANGE, dash: [6, 4] }];
    const series = [line("time (s)")], values = [samples.map((sample) => sample.place)];
    sides.forEach(({ pad, curves }, n) => {
      const { colour, dash } = looks[n], test = tests[n];
      series.push(line(`${pad} measured`, colour, { width: 0, paths: () => null, points: { show: true, size: 4, width: n ? 1 : 0, fill: n ? "#fff" : colour, stroke: colour }, mark: colour }));
      values.push(column(n, (k) => test.observed[k]));
      series.push(line(`${pad} model`, colour, { dash, spanGaps: true }));
      values.push(column(n, (k) => curves.model[test.name][k]));
    });
    const view = {
      x: values[0], samples, many: false, time: log, tests: [tests[0]],
      whole: () => [0, log.parts.length], moment: (place) => [0, log.from(place)], axis: (along) => along, drawBorders: (chart) => report.borders(chart, log),
    };
    this.chart.show(view, { series, values, bands: [], label: axisLabel(sides[0].entry.units, "force") });
  }
}
