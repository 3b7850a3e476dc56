"use strict";
// The page: unpacks the data, sets up picture and controls, plays frames, draws plots. A picture can be named by what follows #,
// such as view.html#field=velocity&component=0&frame=12&warp=200&cut=y&bare=1.

const element = (id) => document.getElementById(id);
const about = JSON.parse(element("about").textContent);

/** The numbers that the page brings. */
async function unpack() {
  const packed = Uint8Array.from(atob(element("data").textContent.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = await new Response(stream).arrayBuffer();
  return ([at, count], Kind) => new Kind(bytes, at, count);
}

/** A number with its unit: prefixes where the unit takes one. */
function si(x, unit, digits = 3) {
  if (!Number.isFinite(x)) return "–";
  if (x === 0) return unit ? `0 ${unit}` : "0";
  const plain = !unit || /^(m²|m³|kg|rad|–|1\/)/.test(unit);
  const power = plain ? 0 : Math.max(-5, Math.min(4, Math.floor(Math.log10(Math.abs(x) * 1.0000001) / 3)));
  const prefix = ["f", "p", "n", "µ", "m", "", "k", "M", "G", "T"][power + 5];
  const v = x / 1000 ** power, size = Math.abs(v);
  const text = size < 1e-3 || size >= 1e5 ? v.toExponential(digits - 1) : String(Number(v.toPrecision(digits)));
  return `${text.replace("-", "−")} ${prefix}${unit ?? ""}`.trim();
}

/** The controls' state, and what an address asks for. */
const state = { frame: about.times.length - 1, field: "", component: 3, span: "run", warp: 1, cut: "", at: 500, flipped: false, view: "iso" };
const shown = { edges: true, bonds: false, broken: true, once: true };
const asked = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
const words = ["x", "y", "z", "length"];
const tensor = ["xx", "yy", "zz", "xy", "yz", "xz"];

let parts = [], renderer, scene, camera, controls, ramps, reach = 1, plots = [], timer = null;

function setUp(read) {
  const canvas = element("canvas");
  scene = new THREE.Scene();
  parts = about.parts.map((p, k) => new Part(p, read, k, about.size, scene));
  renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
  camera = new THREE.OrthographicCamera(-0.5, 0.5, 0.5, -0.5, 0.01, 20);
  camera.up.set(0, 0, 1);
  controls = new THREE.OrbitControls(camera, canvas);
  controls.addEventListener("change", draw);
  ramps = { even: texture(RAMPS.even), signed: texture(RAMPS.signed) };
  new ResizeObserver(resize).observe(element("stage"));
  canvas.addEventListener("click", pick);
}

function draw() {
  shared.pixels.value = renderer.domElement.height * camera.zoom;
  renderer.render(scene, camera);
}

function resize() {
  const { clientWidth: w, clientHeight: h } = element("stage");
  if (!renderer || !w || !h) return;
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  renderer.setSize(w, h, false);
  [camera.left, camera.right] = [-0.5 * w / h, 0.5 * w / h];
  camera.updateProjectionMatrix();
  look(null);
}

/** Looks along a direction (as before without one), so that everything at rest is in the picture. */
function look(name) {
  const directions = { iso: [-0.55, -1, 0.6], x: [1, 0, 0], y: [0, -1, 0], z: [0, -1e-3, 1] };
  if (name) {
    const turned = name.includes(",") ? name.split(",").map(Number) : directions[name] ?? directions.iso;
    camera.position.set(...turned).normalize().multiplyScalar(5);
    controls.target.set(0, 0, 0);
    camera.lookAt(0, 0, 0);
    controls.update();
  }
  camera.updateMatrixWorld();
  const [right, up] = [0, 1].map((k) => new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, k));
  let [wide, high] = [1e-6, 1e-6];
  const x = new THREE.Vector3();
  const models = parts.filter((p) => p.kind);
  for (const p of models.length ? models : parts) {
    const step = Math.max(1, Math.floor(p.count / 3000));
    for (let i = 0; i < p.count; i += step) {
      x.fromArray(p.places, 3 * i).sub(controls.target);
      [wide, high] = [Math.max(wide, Math.abs(x.dot(right))), Math.max(high, Math.abs(x.dot(up)))];
    }
  }
  camera.zoom = 0.42 * Math.min((camera.right - camera.left) / wide, 1 / high);
  camera.updateProjectionMatrix();
  draw();
}

/** Everything that a frame or a choice changes. */
function update() {
  const field = fields().find((f) => f.name === state.field);
  shared.warp.value = state.warp;
  for (const p of parts) p.show(state.frame, state.field, state.component);
  legend(field);
  const t = about.times[state.frame];
  element("frame").value = state.frame;
  element("time").textContent = si(t, "s");
  element("stamp").textContent = `t = ${si(t, "s")}` + (state.warp === 1 ? "" : state.warp === 0 ? ", at rest" : `, displacements × ${Number(state.warp.toPrecision(3))}`);
  element("times").textContent = `× ${Number(state.warp.toPrecision(3))}`;
  for (const p of plots) p.redraw(false);
  draw();
}

/** Fields by name, those that most parts have first. */
function fields() {
  const all = new Map();
  for (const p of parts) for (const f of p.fields) if (!all.has(f.name)) all.set(f.name, f);
  return [...all.values()];
}

function legend(field) {
  const box = element("legend");
  box.hidden = !field;
  if (!field) return;
  const c = state.component;
  let [low, high] = [Infinity, -Infinity];
  for (const p of parts.filter((p) => p.mode !== "hidden")) {
    for (const f of p.fields.filter((f) => f.name === field.name)) {
      const r = p.range(f, c, state.span === "now" ? state.frame : null);
      [low, high] = [Math.min(low, r[0]), Math.max(high, r[1])];
    }
  }
  if (low > high) [low, high] = [0, 0];
  // A scale begins at zero where it nearly does.
  if (low > 0 && low < 0.05 * high) low = 0;
  const signed = low < 0 && high > 0 && Math.min(-low, high) > 0.02 * Math.max(-low, high);
  if (signed) [low, high] = [-Math.max(-low, high), Math.max(-low, high)];
  shared.range.value = [low, high > low ? high : low + (Math.abs(low) || 1)];
  const ramp = signed ? "signed" : "even";
  shared.ramp.value = ramps[ramp];
  box.querySelector("b").textContent = field.name + (field.components > 1 ? ` ${component(field, c)}` : "");
  const [from, to] = box.querySelectorAll("output");
  [from.textContent, to.textContent] = [si(low, field.unit), si(high, field.unit)];
  box.querySelector("i").style.background = `linear-gradient(90deg, ${RAMPS[ramp].map((x) => `rgb(${x})`)})`;
}

const ranked = (field) => field.name.startsWith("principal");
const component = (field, c) => (field.components === 6 ? tensor[c] : ranked(field) ? `no. ${c + 1}` : field.components === 3 ? words[c] : `${c}`);

/** A warp that shows the largest displacement as a twelfth of the body; none where it is seen as it is. */
function fitting() {
  const moved = parts.filter((p) => p.motion && !p.mediator).map((p) => p.range(p.motion, 3)[1] / about.size);
  const most = Math.max(0, ...moved);
  if (most === 0 || most > 0.02) return 1;
  const raw = 0.08 / most, ten = 10 ** Math.floor(Math.log10(raw));
  return ten * [5, 2, 1].find((k) => k * ten <= raw);
}

function options(select, list, chosen) {
  select.replaceChildren(...list.map(([value, text]) => new Option(text, value, false, String(value) === String(chosen))));
}

function wire() {
  const all = fields();
  const preferred = ["damage", "von Mises", "velocity", "displacement"];
  const first = preferred.map((n) => all.find((f) => f.name.startsWith(n))).find((f) => f && f.frames >= Math.min(2, about.times.length));
  state.field = asked.field ?? first?.name ?? all[0]?.name ?? "";
  options(element("field"), [["", "none"], ...all.map((f) => [f.name, f.unit ? `${f.name} [${f.unit}]` : f.name])], state.field);
  reach = fitting();
  state.warp = asked.warp === undefined ? reach : Number(asked.warp);
  for (const k of ["cut", "span"]) if (asked[k] !== undefined) element(k).value = state[k] = asked[k];
  for (const k of ["frame", "at"]) if (asked[k] !== undefined) state[k] = Number(asked[k]);
  state.flipped = asked.flip !== undefined;
  for (const k in shown) if (asked[k] !== undefined) shown[k] = asked[k] !== "0";
  for (const p of parts) p.mode = asked[p.name] ?? p.mode;
  state.frame = Math.max(0, Math.min(state.frame, about.times.length - 1));
  components(asked.component);

  const on = (id, what, act) => element(id).addEventListener(what, act);
  on("field", "change", (e) => { state.field = e.target.value; components(); update(); });
  on("component", "change", (e) => { state.component = Number(e.target.value); update(); });
  on("span", "change", (e) => { state.span = e.target.value; update(); });
  // From 0 by powers up to ten times what fits.
  element("warp").value = state.warp === 0 ? 0 : 100 * Math.log(1 + state.warp) / Math.log(1 + 10 * Math.max(reach, 1));
  on("warp", "input", (e) => {
    const w = (1 + 10 * Math.max(reach, 1)) ** (e.target.value / 100) - 1;
    state.warp = w < 0.05 ? 0 : Math.abs(w - 1) < 0.08 ? 1 : Number(w.toPrecision(2));
    update();
  });
  on("cut", "change", (e) => { state.cut = e.target.value; cut(); });
  on("at", "input", (e) => { state.at = Number(e.target.value); cut(); });
  on("flip", "click", () => { state.flipped = !state.flipped; cut(); });
  on("frame", "input", (e) => { state.frame = Number(e.target.value); update(); });
  on("play", "click", play);
  on("save", "click", () => {
    const link = document.createElement("a");
    [link.href, link.download] = [renderer.domElement.toDataURL("image/png"), "arlequin.png"];
    link.click();
  });
  for (const b of document.querySelectorAll("[data-view]")) b.addEventListener("click", () => look(b.dataset.view));
  document.addEventListener("keydown", (e) => {
    if (["INPUT", "SELECT", "BUTTON"].includes(e.target.tagName)) return;
    if (e.key === " ") play();
    else if (e.key === "ArrowRight" || e.key === "ArrowLeft") go(state.frame + (e.key === "ArrowRight" ? 1 : -1));
    else return;
    e.preventDefault();
  });
  element("frame").max = about.times.length - 1;
  element("at").value = state.at;
  list();
}

/** Which components the field has. */
function components(wanted) {
  const field = fields().find((f) => f.name === state.field);
  const n = field?.components ?? 1;
  const vector = n === 3 && !ranked(field);
  const all = n === 1 ? [] : [...Array(n + vector).keys()];
  state.component = Number(wanted ?? (vector ? 3 : 0));
  element("of").hidden = n === 1;
  element("of").style.display = n === 1 ? "none" : "";
  options(element("component"), all.map((c) => [c, component(field, c)]), state.component);
}

/** Parts with their modes, and what is shown of all. */
function list() {
  element("parts").replaceChildren(...parts.map((p) => {
    const label = document.createElement("label"), tint = document.createElement("i"), select = document.createElement("select");
    tint.style.background = p.tint;
    options(select, ["solid", "outline", "hidden"].map((m) => [m, m]), p.mode);
    select.addEventListener("change", () => { p.mode = select.value; reveal(); });
    label.append(tint, p.mediator ? `overlap: ${p.name}` : p.kind ? `${p.name} (${p.kind})` : p.name, select);
    return label;
  }));
  const has = { once: parts.some((p) => p.mine?.points.includes(0)), edges: parts.some((p) => p.faces.length), bonds: parts.some((p) => p.lines.length && p.radii.length), broken: parts.some((p) => p.breaks.length) };
  const names = { once: "overlap: the model of more weight", edges: "element edges", bonds: "bonds", broken: "broken bonds" };
  element("shown").replaceChildren(...Object.keys(shown).filter((k) => has[k]).map((k) => {
    const label = document.createElement("label"), box = document.createElement("input");
    [box.type, box.checked] = ["checkbox", shown[k]];
    box.addEventListener("change", () => { shown[k] = box.checked; cut(); });
    label.append(box, names[k]);
    return label;
  }));
}

function reveal() {
  for (const p of parts) { p.isCut = state.cut !== ""; p.reveal(shown); }
  update();
}

function cut() {
  const axis = state.cut ? "xyz".indexOf(state.cut) : -1;
  element("where").style.display = axis < 0 ? "none" : "";
  let [low, high] = [Infinity, -Infinity];
  if (axis >= 0) for (const p of parts) for (let i = axis; i < p.places.length; i += 3) [low, high] = [Math.min(low, p.places[i]), Math.max(high, p.places[i])];
  // A cut between two layers of points takes neither by halves.
  const at = low + (high - low) * (state.at + 0.03) / 1000, side = state.flipped ? -1 : 1;
  // What lies before the plane, seen from the usual side, goes.
  const keep = (...x) => axis < 0 || side * (x[axis] - at) * (axis === 1 ? 1 : -1) > 0;
  for (const p of parts) p.cut(p.mediator ? () => true : keep, shown.once, state.frame);
  reveal();
}

function go(frame) {
  state.frame = (frame + about.times.length) % about.times.length;
  update();
}

function play() {
  element("play").textContent = timer ? "▶" : "❚❚";
  if (timer) timer = clearInterval(timer);
  else timer = setInterval(() => go(state.frame + 1), Math.max(60, Math.min(250, 4000 / about.times.length)));
}

/** Says what the point under the pointer is, and its value. */
function pick(event) {
  const box = renderer.domElement.getBoundingClientRect(), x = new THREE.Vector3();
  const at = [event.clientX - box.left, event.clientY - box.top];
  let best = null;
  for (const p of parts.filter((p) => p.mode === "solid" && !p.mediator)) {
    const move = p.attributes.move.array;
    for (let i = 0; i < p.count; i++) {
      if (p.kept && !p.kept[i]) continue;
      x.set(...[0, 1, 2].map((c) => p.places[3 * i + c] + state.warp * move[3 * i + c])).project(camera);
      const d = Math.hypot((x.x + 1) / 2 * box.width - at[0], (1 - x.y) / 2 * box.height - at[1]);
      // The nearest to the eye of those under the pointer.
      if (d < 12 && (!best || x.z < best.z - 1e-3 || (x.z < best.z + 1e-3 && d < best.d))) best = { p, i, d, z: x.z };
    }
  }
  const tip = element("tip");
  tip.hidden = !best;
  if (!best) return;
  const field = best.p.fields.find((f) => f.name === state.field && !f.onLines);
  const value = field ? `\n${field.name} ${si(best.p.attributes.value.array[best.i], field.unit, 4)}` : "";
  tip.textContent = `${best.p.name}, ${best.p.radii.length ? "particle" : "node"} ${best.i}${value}`;
  tip.style.left = `${Math.min(at[0] + 12, box.width - 190)}px`;
  tip.style.top = `${at[1] + 12}px`;
}

const INKS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#505050"];

/** Curves over time with a line at the present frame; a click goes to the nearest one. */
function drawPlots(read) {
  const box = element("plots");
  const make = (p) => {
    const figure = document.createElement("figure"), caption = document.createElement("figcaption");
    caption.textContent = p.unit && p.unit !== "-" ? `${p.title} [${p.unit}]` : p.title;
    figure.append(caption);
    box.append(figure);
    const unit = p.unit === "-" ? "" : p.unit;
    const now = (u) => {
      const x = u.valToPos(about.times[state.frame], "x", true);
      u.ctx.save();
      [u.ctx.strokeStyle, u.ctx.lineWidth] = ["#1d273399", devicePixelRatio];
      u.ctx.beginPath();
      u.ctx.moveTo(x, u.bbox.top);
      u.ctx.lineTo(x, u.bbox.top + u.bbox.height);
      u.ctx.stroke();
      u.ctx.restore();
    };
    const plot = new uPlot({
      width: box.clientWidth, height: 180, scales: { x: { time: false } },
      cursor: { sync: { key: "time" }, drag: { x: true, y: false } },
      axes: [
        { values: (_, v) => v.map((x) => si(x, "s")), space: 70, size: 32, grid: { stroke: "#e6ebf0" } },
        { values: (_, v) => v.map((x) => si(x, unit)), size: 84, grid: { stroke: "#e6ebf0" } },
      ],
      series: [
        { label: "t", value: (_, v) => (v === null ? "" : si(v, "s")) },
        ...p.names.map((n, k) => ({ label: n, stroke: INKS[k % INKS.length], width: 1.6, points: { show: false }, value: (_, v) => (v === null ? "" : si(v, unit)) })),
      ],
      hooks: { draw: [now] },
    }, [read(p.times, Float32Array), ...p.columns.map((c) => read(c, Float32Array))], figure);
    plot.over.addEventListener("click", () => {
      const t = plot.posToVal(plot.cursor.left, "x");
      go(about.times.reduce((best, x, k) => (Math.abs(x - t) < Math.abs(about.times[best] - t) ? k : best), 0));
    });
    return plot;
  };
  plots = about.plots.map(make);
  new ResizeObserver(() => plots.forEach((p) => p.setSize({ width: box.clientWidth, height: 180 }))).observe(box);
}

(async () => {
  if (asked.bare !== undefined) document.body.classList.add("bare");
  element("facts").append(...about.facts.map((f) => Object.assign(document.createElement("span"), { textContent: f })));
  element("notices").append(...about.notices.map((n) => Object.assign(document.createElement("li"), { textContent: n })));
  const read = await unpack();
  try {
    setUp(read);
  } catch (e) {
    element("trouble").hidden = false;
    element("trouble").textContent = `No picture: this browser does not offer WebGL (${e.message}).`;
    parts = [];
  }
  if (parts.length) {
    wire();
    look(asked.view ?? state.view);
    cut();
    resize();
  }
  drawPlots(read);
  document.body.dataset.ready = parts.length ? "yes" : "plots";
})();
