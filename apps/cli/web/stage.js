"use strict";
// The picture: camera, legend, the first view, and what leaves the page (a picture, a film).

let parts = [], renderer, scene, camera, controls, ramps;
/** Distance of the eye from the middle of the body in perspective, in sizes of the body. */
const NEAR = 1.5;

function setUp(read) {
  const canvas = element("canvas");
  scene = new THREE.Scene();
  parts = about.parts.map((p, k) => new Part(p, read, k, about.size, scene));
  if (!parts.length) return;
  renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
  camera = new THREE.OrthographicCamera(-0.5, 0.5, 0.5, -0.5, 0.01, 20);
  camera.up.set(0, 0, 1);
  controls = new THREE.OrbitControls(camera, canvas);
  controls.addEventListener("change", () => { element("tip").hidden = true; draw(); });
  ramps = { even: texture(RAMPS.even), signed: texture(RAMPS.signed), hot: texture(HOT) };
  new ResizeObserver(resize).observe(element("stage"));
}

function draw() {
  shared.height.value = renderer.domElement.height;
  camera.updateProjectionMatrix();
  if (state.perspective) foreshorten();
  renderer.render(scene, camera);
}

/** Replaces the parallel projection by one from an eye nearer than the camera; lengths at the middle of the body stay as they are. */
function foreshorten() {
  const e = camera.projectionMatrix.elements, shift = camera.position.distanceTo(controls.target) - NEAR;
  const [near, far] = [0.05, 20], a = (far + near) / (near - far), b = (2 * far * near) / (near - far);
  camera.projectionMatrix.set(NEAR * e[0], 0, 0, 0, 0, NEAR * e[5], 0, 0, 0, 0, a, a * shift + b, 0, 0, -1, -shift);
  camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
}

function resize() {
  const { clientWidth: w, clientHeight: h } = element("stage");
  if (!renderer || !w || !h) return;
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  renderer.setSize(w, h, false);
  [camera.left, camera.right] = [-0.5 * w / h, 0.5 * w / h];
  look(null);
}

/** The models; everything where there are none. Rigid bodies may be far larger. */
function bodies() {
  const models = parts.filter((p) => p.kind);
  return models.length ? models : parts;
}

/** Half the width and height of the picture that holds the models with displacements times `warp`. */
function spread(warp) {
  const [right, up] = [0, 1].map((k) => new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, k));
  let [wide, high] = [1e-6, 1e-6];
  const x = new THREE.Vector3();
  for (const p of bodies()) {
    const step = Math.max(1, Math.floor(p.count / 3000)), move = p.attributes.move.array;
    for (let i = 0; i < p.count; i += step) {
      x.set(...[0, 1, 2].map((c) => p.places[3 * i + c] + warp * move[3 * i + c])).sub(controls.target);
      [wide, high] = [Math.max(wide, Math.abs(x.dot(right))), Math.max(high, Math.abs(x.dot(up)))];
    }
  }
  return [wide, high];
}

/** Looks along a direction (as before without one), so that everything is in the picture, at rest and in the frame shown. */
function look(name) {
  const directions = { iso: [-0.55, -1, 0.6], x: [1, 0, 0], y: [0, -1, 0], z: [0, -1e-3, 1] };
  if (name) {
    const [x, y, z] = name.split(",").map(Number);
    const turned = [x, y, z].every(Number.isFinite) && Math.hypot(x, y, z) > 0 ? [x, y, z] : directions[name] ?? directions.iso;
    camera.position.set(...turned).normalize().multiplyScalar(5);
    controls.target.set(0, 0, 0);
    camera.lookAt(0, 0, 0);
    controls.update();
  }
  camera.updateMatrixWorld();
  // Pieces that have flown away may leave the picture.
  const rest = spread(0), most = 3 * Math.max(...rest), now = spread(state.warp);
  const [wide, high] = rest.map((r, k) => Math.max(r, Math.min(now[k], most)));
  camera.zoom = 0.42 * Math.min((camera.right - camera.left) / wide, 1 / high);
  draw();
}

/** Lowest and highest value of the colours; signed ranges have zero in their middle. */
function extent(field) {
  if (state.span === "own") return [state.low, state.high];
  let [low, high] = [Infinity, -Infinity];
  for (const p of parts.filter((p) => p.mode !== "hidden")) {
    for (const f of p.fields.filter((f) => f.name === field.name)) {
      const r = p.range(f, state.component, state.span === "now" ? state.frame : null);
      [low, high] = [Math.min(low, r[0]), Math.max(high, r[1])];
    }
  }
  if (low > high) return [0, 0];
  // A scale begins at zero where it nearly does.
  if (low > 0 && low < 0.05 * high) low = 0;
  const signed = low < 0 && high > 0 && Math.min(-low, high) > 0.02 * Math.max(-low, high);
  return signed ? [-Math.max(-low, high), Math.max(-low, high)] : [low, high];
}

function legend(field) {
  const box = element("legend");
  box.hidden = !field;
  if (!field) return;
  let [low, high] = extent(field);
  // A logarithm needs positive values: three decades below the highest.
  if (state.logged && high > 0 && low <= 0) low = 1e-3 * high;
  const logged = state.logged && low > 0 && high > low;
  const ramp = low < 0 && high > 0 && !logged ? "signed" : "even";
  shared.range.value = [low, high > low ? high : low + (Math.abs(low) || 1)];
  shared.logged.value = logged ? 1 : 0;
  shared.ramp.value = ramps[ramp];
  box.querySelector("b").textContent = field.name + (field.components > 1 ? ` ${component(field, state.component)}` : "") + (logged ? ", log" : "");
  const [from, to] = box.querySelectorAll("output");
  [from.textContent, to.textContent] = [si(low, field.unit), si(high, field.unit)];
  box.querySelector("i").style.background = `linear-gradient(90deg, ${RAMPS[ramp].map((x) => `rgb(${x})`)})`;
  for (const [id, value] of [["low", low], ["high", high]]) if (document.activeElement !== element(id)) element(id).value = entered(value);
}

/** Grey below half of the range, magenta above it: tells whether a picture shows the large values. */
const HOT = [...Array(4).fill([128, 128, 128]), ...Array(4).fill([255, 0, 255])];

/** Share of the picture with values above half of the range, or with broken bonds. */
function hotShare() {
  const ramp = shared.ramp.value, { width, height } = renderer.domElement, gl = renderer.getContext();
  shared.ramp.value = ramps.hot;
  draw();
  shared.ramp.value = ramp;
  const pixels = new Uint8Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  let [hot, drawn] = [0, 1];
  for (let k = 0; k < pixels.length; k += 4) {
    if (pixels[k + 3]) drawn++;
    if (pixels[k] > 120 && pixels[k + 1] < 40) hot++;
  }
  return hot / drawn;
}

/** The last frame in which the field is nearly as large as ever. */
function tellingFrame(field) {
  const sizes = about.times.map((_, k) => {
    const of = parts.flatMap((p) => p.fields.filter((f) => f.name === field.name && (f.frames > 1 || k === 0)).map((f) => p.range(f, state.component, k)));
    return Math.max(0, ...of.map(([low, high]) => Math.max(high, -low)));
  });
  const most = Math.max(...sizes);
  return most > 0 ? sizes.findLastIndex((s) => s >= 0.98 * most) : about.times.length - 1;
}

/** Middle of the broken bonds, or the place of the largest value. */
function tellingPlace() {
  const sum = [0, 0, 0];
  let [count, most, place] = [0, 0, null];
  for (const p of bodies()) {
    for (const k of p.breaks.filter((k) => p.broken[k] <= state.frame)) {
      for (let c = 0; c < 3; c++) sum[c] += 0.5 * (p.places[3 * p.lines[2 * k] + c] + p.places[3 * p.lines[2 * k + 1] + c]);
      count++;
    }
    if (p.fields.some((f) => f.name === state.field && !f.onLines)) {
      p.attributes.value.array.forEach((v, i) => {
        if (Math.abs(v) > most) [most, place] = [Math.abs(v), [...p.places.subarray(3 * i, 3 * i + 3)]];
      });
    }
  }
  return count ? sum.map((x) => x / count) : place;
}

/** Cuts through the largest values if the whole body hides them. */
function tellingCut() {
  const place = tellingPlace();
  if (!place) return;
  const choices = [["", false], ["y", false], ["x", true], ["z", false]].map(([axis, flipped]) => {
    [state.cut, state.flipped] = [axis, flipped];
    if (axis) {
      const [low, high] = span(axis);
      state.at = Math.round(1000 * (place["xyz".indexOf(axis)] - low) / (high - low || 1));
    }
    cut();
    return { axis, flipped, at: state.at, share: hotShare() };
  });
  const [whole, ...cuts] = choices, best = cuts.reduce((a, b) => (b.share > 1.5 * a.share ? b : a));
  const { axis, flipped, at } = whole.share < 0.005 && best.share > 3 * whole.share ? best : whole;
  [state.cut, state.flipped, state.at] = [axis, flipped, axis ? at : 500];
}

/** The picture with its legend and time on white, as it is saved. */
function composed(paper = document.createElement("canvas")) {
  const { width, height } = renderer.domElement, unit = height / element("stage").clientHeight;
  // Films need even sizes.
  [paper.width, paper.height] = [width & ~1, height & ~1];
  const c = paper.getContext("2d"), field = fields().find((f) => f.name === state.field);
  c.fillStyle = "#fff";
  c.fillRect(0, 0, width, height);
  c.drawImage(renderer.domElement, 0, 0);
  c.scale(unit, unit);
  [c.fillStyle, c.font] = ["#1d2733", "13px system-ui, 'DejaVu Sans', sans-serif"];
  c.fillText(element("stamp").textContent, 18, height / unit - 16);
  if (!field) return paper;
  const [from, to] = [...element("legend").querySelectorAll("output")].map((o) => o.textContent), wide = c.measureText(from).width;
  c.fillText(element("legend").querySelector("b").textContent, 18, 26);
  c.fillText(from, 18, 48);
  c.fillText(to, 18 + wide + 166, 48);
  const ramp = RAMPS[shared.ramp.value === ramps.signed ? "signed" : "even"];
  for (let k = 0; k < 150; k++) {
    c.fillStyle = `rgb(${colour(ramp, k / 149)})`;
    c.fillRect(18 + wide + 8 + k, 37, 1.5, 13);
  }
  return paper;
}

function save(address, name) {
  const link = document.createElement("a");
  [link.href, link.download] = [address, name];
  link.click();
}

/** Records all frames, one after another, as a film; its format is the browser's first of these. */
async function film(perSecond = 12) {
  const type = ["video/webm;codecs=vp9", "video/webm", "video/mp4"].find((t) => MediaRecorder.isTypeSupported(t));
  const paper = composed(), before = state.frame, chunks = [];
  const recorder = new MediaRecorder(paper.captureStream(perSecond), { mimeType: type, videoBitsPerSecond: 8e6 });
  recorder.addEventListener("dataavailable", (e) => chunks.push(e.data));
  const ended = new Promise((end) => recorder.addEventListener("stop", end));
  recorder.start();
  for (let k = 0; k < about.times.length; k++) {
    go(k);
    composed(paper);
    await new Promise((next) => setTimeout(next, 1000 / perSecond));
  }
  recorder.stop();
  await ended;
  go(before);
  return new Blob(chunks, { type: type.split(";")[0] });
}
