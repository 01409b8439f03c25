// The report's own chart code, which the page loads as a plain script before its modules: one look, one code.
/* global LogTime, borders, axes, line, forceChart, residualChart, isFast, short, unitOf, NAMES, INK, BLUE, ORANGE, GREY, BAND, NOISE, uPlot */

export const report = {
  LogTime, borders, axes, line, forceChart, residualChart, isFast, short, unitOf,
  NAMES, INK, BLUE, ORANGE, GREY, BAND, NOISE, Plot: uPlot,
};
