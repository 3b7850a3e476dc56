"use strict";
// Curves: quantities over time, and one quantity over another.

const INKS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#505050"];
let plots = [];

const unitless = (unit) => (unit === "-" ? "" : unit);
const nearest = (times, t) => times.reduce((best, x, k) => (Math.abs(x - t) < Math.abs(times[best] - t) ? k : best), 0);

/** Axes with tick marks in their units. */
function axes(units) {
  return units.map((unit, k) => ({ values: (_, v) => v.map((x) => si(x, unit)), grid: { stroke: "#e6ebf0" }, ...(k ? { size: 84 } : { space: 70, size: 32 }) }));
}

/** Draws on a plot without leaving its brush behind. */
function sketch(u, act) {
  u.ctx.save();
  act(u.ctx);
  u.ctx.restore();
}

/** Quantities over time with a line at the present frame; a click goes to the nearest one. */
function overTime(p, columns, common) {
  const unit = unitless(p.unit);
  const now = (u) => sketch(u, (c) => {
    const x = u.valToPos(about.times[state.frame], "x", true);
    [c.strokeStyle, c.lineWidth] = ["#1d273399", devicePixelRatio];
    c.beginPath();
    c.moveTo(x, u.bbox.top);
    c.lineTo(x, u.bbox.top + u.bbox.height);
    c.stroke();
  });
  return {
    options: {
      ...common,
      cursor: { sync: { key: "time" }, drag: { x: true, y: false } },
      axes: axes(["s", unit]),
      series: [
        { label: "t", value: (_, v) => (v === null ? "" : si(v, "s")) },
        ...p.names.map((n, k) => ({ label: n, stroke: INKS[k % INKS.length], width: 1.6, points: { show: false }, value: (_, v) => (v === null ? "" : si(v, unit)) })),
      ],
      hooks: { draw: [now] },
    },
    data: columns,
    pick: (plot) => plot.posToVal(plot.cursor.left, "x"),
  };
}

/** One quantity over another with a dot at the present frame. The horizontal axis may go back and forth, so the path is drawn here. */
function overEachOther(p, [times, x, y], common) {
  const ends = (v) => v.reduce(([low, high], a) => [Math.min(low, a), Math.max(high, a)], [Infinity, -Infinity]);
  const path = (u) => sketch(u, (c) => {
    const place = (k) => [u.valToPos(x[k], "x", true), u.valToPos(y[k], "y", true)];
    [c.strokeStyle, c.lineWidth, c.lineJoin, c.fillStyle] = [INKS[0], 1.6 * devicePixelRatio, "round", INKS[1]];
    c.beginPath();
    times.forEach((_, k) => c.lineTo(...place(k)));
    c.stroke();
    if (!about.times.length) return;
    c.beginPath();
    c.arc(...place(nearest(times, about.times[state.frame])), 4 * devicePixelRatio, 0, 7);
    c.fill();
  });
  return {
    options: {
      ...common,
      legend: { show: false },
      cursor: { drag: { x: false, y: false } },
      axes: axes([unitless(p.over.unit), unitless(p.unit)]),
      series: [{}, { stroke: "transparent", points: { show: false } }],
      hooks: { draw: [path] },
    },
    data: [ends(x), ends(y)],
    pick: (u) => times[times.reduce((best, _, k) => {
      const far = (j) => Math.hypot(u.valToPos(x[j], "x") - u.cursor.left, u.valToPos(y[j], "y") - u.cursor.top);
      return far(k) < far(best) ? k : best;
    }, 0)],
  };
}

function drawPlots(read) {
  const box = element("plots");
  plots = about.plots.map((p) => {
    const figure = document.createElement("figure"), caption = document.createElement("figcaption");
    const named = (title, unit) => (unitless(unit) ? `${title} [${unit}]` : title);
    caption.textContent = named(p.title, p.unit) + (p.over ? ` over ${named(p.over.title, p.over.unit)}` : "");
    figure.append(caption);
    box.append(figure);
    const columns = [p.times, ...p.columns].map((c) => read(c, Float32Array));
    const common = { width: box.clientWidth, height: 180, scales: { x: { time: false } } };
    const { options, data, pick } = (p.over ? overEachOther : overTime)(p, columns, common);
    const plot = new uPlot(options, data, figure);
    plot.over.addEventListener("click", () => about.times.length && go(nearest(about.times, pick(plot))));
    return plot;
  });
  new ResizeObserver(() => plots.forEach((p) => p.setSize({ width: box.clientWidth, height: 180 }))).observe(box);
}
