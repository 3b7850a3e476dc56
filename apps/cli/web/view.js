"use strict";
// The page: unpacks the data, sets up controls, plays frames. A picture can be named by what follows #, such as
// view.html#field=velocity&component=0&frame=12&warp=200&cut=y&bare=1.

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

/** A number as one would enter it. */
const entered = (x) => { const v = Number(x.toPrecision(4)); return v !== 0 && (Math.abs(v) >= 1e5 || Math.abs(v) < 1e-3) ? v.toExponential().replace("+", "") : String(v); };

/** The controls' state. `low` and `high` are the entered range, `least` and `most` limit which values are shown. */
const state = { frame: about.times.length - 1, field: "", component: 3, span: "run", low: 0, high: 1, logged: false, least: -Infinity, most: Infinity, warp: 1, cut: "", at: 500, flipped: false, perspective: false };
const shown = { edges: true, bonds: false, broken: true, once: true };
const words = ["x", "y", "z", "length"];
const tensor = ["xx", "yy", "zz", "xy", "yz", "xz"];
let reach = 1, timer = null;

/** What the address asks for. A value that does not fit is left out and named. */
const asked = (() => {
  const out = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  const number = (low, high) => (v) => v.trim() !== "" && Number(v) >= low && Number(v) <= high;
  const rules = {
    frame: number(0, about.times.length - 1), at: number(0, 1000), warp: number(0, 1e12), component: number(0, 8),
    cut: (v) => ["", "x", "y", "z"].includes(v), span: (v) => ["run", "now"].includes(v),
    range: (v) => v.split(",").length === 2 && v.split(",").every(number(-1e300, 1e300)),
    only: (v) => v.split(",").length === 2 && v.split(",").every((x) => x === "" || number(-1e300, 1e300)(x)),
    field: (v) => v === "" || about.parts.some((p) => p.fields.some((f) => f.name === v)),
    view: (v) => ["iso", "x", "y", "z"].includes(v) || (v.split(",").length === 3 && v.split(",").every(number(-1e9, 1e9))),
  };
  for (const p of about.parts) rules[p.name] ??= (v) => ["solid", "outline", "hidden"].includes(v);
  for (const key in out) {
    if (!rules[key] || rules[key](out[key])) continue;
    about.notices.push(`The address asks for ${key}=${out[key]}, which this page does not have.`);
    delete out[key];
  }
  return out;
})();

/** Everything that a frame or a choice changes. */
function update() {
  const field = fields().find((f) => f.name === state.field);
  shared.warp.value = state.warp;
  for (const p of parts) p.show(state.frame, state.field, state.component);
  if (limited() || (shown.once && parts.some((p) => p.weight?.frames > 1))) cutParts();
  if (parts.length) legend(field);
  const t = about.times[state.frame];
  element("frame").value = state.frame;
  element("time").textContent = si(t, "s");
  element("stamp").textContent = `t = ${si(t, "s")}` + (state.warp === 1 ? "" : state.warp === 0 ? ", at rest" : `, displacements × ${Number(state.warp.toPrecision(3))}`);
  element("times").textContent = `× ${Number(state.warp.toPrecision(3))}`;
  element("tip").hidden = true;
  for (const p of plots) p.redraw(false);
  if (parts.length) draw();
}

/** Fields by name, those that most parts have first. */
function fields() {
  const all = new Map();
  for (const p of parts) for (const f of p.fields) if (!all.has(f.name)) all.set(f.name, f);
  return [...all.values()];
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

/** The field that tells most: damage if there is any. */
function telling() {
  const all = fields(), largest = (f) => Math.max(...parts.flatMap((p) => p.fields.filter((g) => g.name === f.name).map((g) => Math.max(...g.high))));
  const damage = all.find((f) => f.name === "damage" && largest(f) > 0);
  const preferred = ["von Mises", "velocity", "displacement"].map((n) => all.find((f) => f.name.startsWith(n)));
  return damage ?? preferred.find((f) => f && f.frames >= Math.min(2, about.times.length)) ?? all[0];
}

/** Begins with what the address asks for; where it asks for nothing, with the frame and the cut that show something. */
function begin() {
  state.field = asked.field ?? telling()?.name ?? "";
  reach = fitting();
  state.warp = asked.warp === undefined ? reach : Number(asked.warp);
  for (const k of ["cut", "span"]) state[k] = asked[k] ?? state[k];
  if (asked.at !== undefined) state.at = Number(asked.at);
  state.flipped = asked.flip !== undefined;
  state.logged = asked.log !== undefined;
  state.perspective = asked.perspective !== undefined;
  if (asked.range) [state.span, state.low, state.high] = ["own", ...asked.range.split(",").map(Number)];
  if (asked.only) [state.least, state.most] = limits(...asked.only.split(","));
  for (const k in shown) if (asked[k] !== undefined) shown[k] = asked[k] !== "0";
  for (const p of parts) p.mode = asked[p.name] ?? p.mode;
  components(asked.component);
  const field = fields().find((f) => f.name === state.field);
  state.frame = asked.frame === undefined ? (field ? tellingFrame(field) : state.frame) : Math.round(Number(asked.frame));
  look(asked.view ?? "iso");
  cut();
  resize();
  const chosen = ["cut", "bare", "view", "only"].some((k) => asked[k] !== undefined);
  if (field && !chosen) {
    tellingCut();
    cut();
  }
}

/** Entered limits of the values; an empty entry is no limit. */
function limits(least, most) {
  const value = (text, none) => (text.trim() === "" || !Number.isFinite(Number(text)) ? none : Number(text));
  return [value(least, -Infinity), value(most, Infinity)];
}

const limited = () => state.least > -Infinity || state.most < Infinity;

/** Gives the controls the values of the state. */
function settle() {
  const all = fields();
  options(element("field"), [["", "none"], ...all.map((f) => [f.name, f.unit ? `${f.name} [${f.unit}]` : f.name])], state.field);
  for (const k of ["cut", "span", "at"]) element(k).value = state[k];
  element("logged").checked = state.logged;
  element("perspective").checked = state.perspective;
  for (const k of ["least", "most"]) element(k).value = Number.isFinite(state[k]) ? entered(state[k]) : "";
  // From 0 by powers up to ten times what fits.
  element("warp").value = state.warp === 0 ? 0 : 100 * Math.log(1 + state.warp) / Math.log(1 + 10 * Math.max(reach, 1));
  element("frame").max = about.times.length - 1;
  element("film").hidden = !window.MediaRecorder || about.times.length < 2;
  list();
}

function wire() {
  const on = (id, what, act) => element(id).addEventListener(what, act);
  on("field", "change", (e) => { state.field = e.target.value; [state.least, state.most] = limits("", ""); components(); settle(); cut(); });
  on("component", "change", (e) => { state.component = Number(e.target.value); update(); });
  on("span", "change", (e) => {
    state.span = e.target.value;
    if (state.span === "own") [state.low, state.high] = shared.range.value;
    update();
  });
  for (const k of ["low", "high"]) on(k, "change", (e) => {
    if (!Number.isFinite(Number(e.target.value)) || e.target.value.trim() === "") return update();
    if (state.span !== "own") [state.low, state.high] = shared.range.value;
    [state.span, state[k]] = ["own", Number(e.target.value)];
    element("span").value = "own";
    update();
  });
  on("logged", "change", (e) => { state.logged = e.target.checked; update(); });
  for (const k of ["least", "most"]) on(k, "change", () => { [state.least, state.most] = limits(element("least").value, element("most").value); cut(); });
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
  on("perspective", "change", (e) => { state.perspective = e.target.checked; draw(); });
  on("save", "click", () => save(composed().toDataURL("image/png"), "arlequin.png"));
  on("film", "click", async (e) => {
    e.target.disabled = true;
    const blob = await film();
    save(URL.createObjectURL(blob), `arlequin.${blob.type.split("/")[1]}`);
    e.target.disabled = false;
  });
  for (const b of document.querySelectorAll("[data-view]")) b.addEventListener("click", () => look(b.dataset.view));
  document.addEventListener("keydown", (e) => {
    if (["INPUT", "SELECT", "BUTTON"].includes(e.target.tagName)) return;
    if (e.key === " ") play();
    else if (e.key === "ArrowRight" || e.key === "ArrowLeft") go(state.frame + (e.key === "ArrowRight" ? 1 : -1));
    else return;
    e.preventDefault();
  });
  // A press that turns the body is no click.
  let pressed = [0, 0];
  on("canvas", "pointerdown", (e) => { pressed = [e.clientX, e.clientY]; });
  on("canvas", "click", (e) => { if (Math.hypot(e.clientX - pressed[0], e.clientY - pressed[1]) < 4) pick(e); });
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
    options(select, [["solid", p.mediator ? "veil" : "solid"], ["outline", "outline"], ["hidden", "hidden"]], p.mode);
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
  for (const p of parts) p.reveal(shown);
  update();
}

/** Ends of the models along an axis. */
function span(name) {
  const axis = "xyz".indexOf(name);
  let [low, high] = [Infinity, -Infinity];
  for (const p of bodies()) for (let i = axis; i < p.places.length; i += 3) [low, high] = [Math.min(low, p.places[i]), Math.max(high, p.places[i])];
  return [low, high];
}

/** Leaves out what the cut and the limits take. */
function cutParts() {
  const axis = "xyz".indexOf(state.cut || "-"), [low, high] = axis < 0 ? [0, 0] : span(state.cut);
  // A cut between two layers of points takes neither by halves.
  const at = low + (high - low) * (state.at + 0.03) / 1000, side = state.flipped ? -1 : 1;
  // What lies before the plane, seen from the usual side, goes.
  const keep = (...x) => axis < 0 || side * (x[axis] - at) * (axis === 1 ? 1 : -1) > 0;
  for (const p of parts) p.cut(keep, shown.once, limited() ? [state.least, state.most] : null, state.frame);
}

function cut() {
  element("where").style.display = state.cut ? "" : "none";
  cutParts();
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

(async () => {
  if (asked.bare !== undefined) document.body.classList.add("bare");
  const items = (id, tag, texts) => element(id).append(...texts.map((t) => Object.assign(document.createElement(tag), { textContent: t })));
  items("facts", "span", about.facts);
  items("notices", "li", about.notices);
  for (const [name, text] of about.figures) items("figures", "dt", [name]), items("figures", "dd", [text]);
  const read = await unpack();
  try {
    setUp(read);
  } catch (e) {
    element("trouble").textContent = `No picture: this browser does not offer WebGL (${e.message}).`;
    parts = [];
  }
  if (parts.length) {
    begin();
    settle();
    wire();
  } else {
    element("trouble").hidden = false;
    element("trouble").textContent ||= "No picture: the run wrote no frames.";
  }
  drawPlots(read);
  document.body.dataset.ready = parts.length ? "yes" : "plots";
})();
