"use strict";
// What is drawn. Lengths are in units of the body's size; a part keeps its values as 16 bits and unpacks one frame at a time.

const RAMPS = {
  // From light to dark, so that what is at rest stays in the background; the blue-red of Moreland for values of both signs.
  even: [[228, 233, 238], [250, 223, 170], [253, 190, 112], [248, 144, 82], [229, 92, 84], [189, 54, 107], [138, 32, 118], [86, 21, 105], [42, 15, 74]],
  signed: [[59, 76, 192], [98, 130, 234], [141, 176, 254], [184, 208, 249], [221, 221, 221], [245, 196, 173], [244, 154, 123], [222, 96, 77], [180, 4, 38]],
};
const TINTS = ["#a9bccd", "#dcc09a", "#b0c9ab", "#c9b3cf", "#b9b9b9"];
const NONE = 0xffffffff;

/** The colour at s from 0 to 1. */
function colour(ramp, s) {
  const x = s * (ramp.length - 1), k = Math.min(Math.floor(x), ramp.length - 2);
  return ramp[k].map((a, c) => Math.round(a + (x - k) * (ramp[k + 1][c] - a)));
}

function texture(ramp) {
  const data = new Uint8Array(1024);
  for (let k = 0; k < 256; k++) data.set([...colour(ramp, k / 255), 255], 4 * k);
  const t = new THREE.DataTexture(data, 256, 1, THREE.RGBAFormat);
  t.minFilter = t.magFilter = THREE.LinearFilter;
  t.needsUpdate = true;
  return t;
}

/** Uniforms that all materials share. */
const shared = {
  ramp: { value: null }, range: { value: [0, 1] }, logged: { value: 0 }, warp: { value: 0 }, height: { value: 1 },
};

const PAINT = `
  uniform sampler2D ramp; uniform vec2 range; uniform float logged; uniform vec3 plain; uniform float painted;
  vec3 paint(float v) {
    float s = logged > 0.5 ? log(max(v, range.x) / range.x) / max(log(range.y / range.x), 1e-37)
      : (v - range.x) / max(range.y - range.x, 1e-37);
    s = clamp(s, 0.0, 1.0);
    return mix(plain, texture2D(ramp, vec2((s * 255.0 + 0.5) / 256.0, 0.5)).rgb, painted);
  }
  float lit(vec3 n) { return 0.7 + 0.34 * max(dot(n, vec3(0.25, 0.45, 0.857)), 0.0); }`;
const MOVE = `
  attribute vec3 move; attribute float value; uniform float warp; varying float v; varying vec3 eye;
  void main() {
    v = value;
    vec4 p = modelViewMatrix * vec4(position + warp * move, 1.0);
    eye = p.xyz;
    gl_Position = projectionMatrix * p;`;
const SHADERS = {
  faces: [MOVE + "}", `${PAINT} varying float v; varying vec3 eye; uniform float opacity;
    void main() {
      vec3 n = normalize(cross(dFdx(eye), dFdy(eye)));
      gl_FragColor = vec4(paint(v) * lit(n.z < 0.0 ? -n : n), opacity);
    }`],
  lines: [MOVE + "}", `${PAINT} varying float v; varying vec3 eye; uniform float opacity;
    void main() { gl_FragColor = vec4(paint(v), opacity); }`],
  // A disc that is lit, and lies in depth, as the ball it stands for.
  balls: [`attribute float radius; uniform float height; uniform float shrink; varying float rise; ` + MOVE + `
      float r = shrink * radius;
      vec4 front = projectionMatrix * (p + vec4(0.0, 0.0, r, 0.0));
      rise = 0.5 * (front.z / front.w - gl_Position.z / gl_Position.w);
      gl_PointSize = max(r * projectionMatrix[1][1] * height / gl_Position.w, 1.5);
    }`, `${PAINT} varying float v; varying vec3 eye; varying float rise;
    void main() {
      vec2 q = vec2(2.0, -2.0) * (gl_PointCoord - 0.5);
      float d = dot(q, q);
      if (d > 1.0) discard;
      vec3 n = vec3(q, sqrt(1.0 - d));
      gl_FragDepth = gl_FragCoord.z + rise * n.z;
      gl_FragColor = vec4(paint(v) * lit(n) * (d > 0.86 ? 0.82 : 1.0), 1.0);
    }`],
};

function material(kind, tint, more = {}) {
  const plain = new THREE.Color().setStyle(tint, THREE.LinearSRGBColorSpace);
  const own = { plain: { value: plain }, painted: { value: 0 }, opacity: { value: 1 }, shrink: { value: 1 } };
  return new THREE.ShaderMaterial({
    vertexShader: SHADERS[kind][0], fragmentShader: SHADERS[kind][1], uniforms: { ...shared, ...own },
    side: THREE.DoubleSide, ...more,
  });
}

/** A model, mediator or body: its arrays and its objects in the scene. */
class Part {
  constructor(about, read, number, size, scene) {
    Object.assign(this, about);
    this.size = size;
    this.tint = about.mediator ? "#d55e00" : TINTS[number % TINTS.length];
    this.places = read(about.places, Float32Array);
    this.count = this.places.length / 3;
    this.radii = read(about.radii, Float32Array);
    this.faces = read(about.faces, Uint32Array);
    this.centres = read(about.centres, Float32Array);
    this.lines = read(about.lines, Uint32Array);
    this.broken = read(about.broken, Uint16Array);
    for (const f of this.fields) { f.shorts = read(f.values, Uint16Array); f.part = this; f.ranges = {}; }
    this.motion = this.fields.find((f) => f.name === "displacement" && f.components === 3);
    this.attributes = {
      position: new THREE.BufferAttribute(this.places, 3),
      move: new THREE.BufferAttribute(new Float32Array(3 * this.count), 3),
      value: new THREE.BufferAttribute(new Float32Array(this.count), 1),
    };
    this.objects = {};
    // A plane would hide what is behind it.
    this.mode = !about.mediator && !about.kind && this.faces.length < 60 ? "outline" : "solid";
    this.share(0);
    const add = (name, Kind, mat, attributes) => {
      const g = new THREE.BufferGeometry();
      for (const k in attributes) g.setAttribute(k, attributes[k]);
      const o = new Kind(g, mat);
      o.frustumCulled = false;
      scene.add(o);
      this.objects[name] = o;
    };
    if (this.faces.length) {
      // A mediator is a veil over the bodies; models lie a little behind their edges.
      const depth = about.mediator ? { transparent: true, depthWrite: false } : {};
      const offset = about.mediator ? -1 : 1;
      add("faces", THREE.Mesh, material("faces", this.tint, { polygonOffset: true, polygonOffsetFactor: offset, polygonOffsetUnits: offset, ...depth }), this.attributes);
      add("edges", THREE.LineSegments, material("lines", "#1d2733", { transparent: true }), this.attributes);
      add("outline", THREE.LineSegments, material("lines", about.mediator ? this.tint : "#33475c", { transparent: true }), this.attributes);
      this.objects.edges.material.uniforms.opacity.value = 0.24;
      if (about.mediator) [this.objects.faces.material.uniforms.opacity.value, this.objects.outline.material.uniforms.opacity.value] = [0.13, 0.6];
    }
    if (this.radii.length) {
      add("balls", THREE.Points, material("balls", this.tint), { ...this.attributes, radius: new THREE.BufferAttribute(this.radii, 1) });
    }
    if (this.lines.length) {
      const n = this.lines.length;
      const own = (c) => new THREE.BufferAttribute(new Float32Array(c * n), c);
      add("bonds", THREE.LineSegments, material("lines", "#33475c"), { position: own(3), move: own(3), value: own(1) });
      const at = this.objects.bonds.geometry.attributes.position.array;
      this.lines.forEach((i, k) => at.set(this.places.subarray(3 * i, 3 * i + 3), 3 * k));
    }
    this.breaks = [...this.broken.keys()].filter((k) => this.broken[k] !== 0xffff);
    if (this.breaks.length) {
      const n = this.breaks.length, own = (c) => new THREE.BufferAttribute(new Float32Array(c * n), c);
      add("cracks", THREE.Points, material("balls", "#e3120b"), { position: own(3), move: own(3), value: own(1), radius: own(1) });
      const mean = this.radii.reduce((a, b) => a + b, 0) / Math.max(this.radii.length, 1) || 0.004;
      this.objects.cracks.geometry.attributes.radius.array.fill(0.42 * mean);
    }
  }

  /** Which points and cells have at least half of the weight of their place at a frame: in an overlap, one of the two models.
      Weights change where a zone moves. */
  share(frame) {
    this.weight ??= this.fields.find((f) => f.name === "alpha" && !f.onLines);
    const known = this.weight && Math.min(frame, this.weight.frames - 1);
    if (!this.weight || this.mine?.frame === known) return;
    const alpha = this.values(this.weight, known, 0, new Float32Array(this.count));
    const most = (w) => (w >= 0.4999 ? 1 : 0);
    this.mine = { frame: known, points: Uint8Array.from(alpha, most), cells: Uint8Array.from(this.cellMeans(alpha), most) };
  }

  /** Means of values at points over the corners of each cell. */
  cellMeans(values) {
    const n = this.centres.length / 3, sums = new Float32Array(n), counts = new Float32Array(n), f = this.faces;
    for (let k = 0; k < f.length; k += 6) {
      for (const cell of [f[k + 4], f[k + 5]]) {
        if (cell === NONE) continue;
        for (let j = 0; j < 4; j++) sums[cell] += values[f[k + j]];
        counts[cell] += 4;
      }
    }
    return sums.map((s, k) => s / Math.max(counts[k], 1));
  }

  /** Edges at which the surface of the kept cells turns by more than 30°, as pairs of points. */
  creases(surface) {
    const normal = new Map(), out = [], x = this.places, f = this.faces;
    for (const k of surface) {
      const [a, b, c] = [f[k], f[k + 1], f[k + 2]].map((i) => [x[3 * i], x[3 * i + 1], x[3 * i + 2]]);
      const u = b.map((v, j) => v - a[j]), w = c.map((v, j) => v - a[j]);
      const n = [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]];
      const l = Math.hypot(...n) || 1;
      for (let j = 0; j < 4; j++) {
        const i = f[k + j], e = f[k + (j + 1) % 4];
        if (i === e) continue;
        const key = Math.min(i, e) * this.count + Math.max(i, e), other = normal.get(key);
        if (!other) normal.set(key, n.map((v) => v / l));
        else {
          // A face of the cut may be met from behind.
          if (Math.abs(n[0] * other[0] + n[1] * other[1] + n[2] * other[2]) < 0.86 * l) out.push(i, e);
          normal.delete(key);
        }
      }
    }
    // What has one face only is a border.
    for (const key of normal.keys()) out.push(Math.floor(key / this.count), key % this.count);
    return out;
  }

  /** Component c of a field (3 of a vector: its length) for all points at a frame. */
  values(field, frame, c, out) {
    const n = field.shorts.length / (field.components * field.frames);
    const start = Math.min(frame, field.frames - 1) * field.components * n;
    const read = (k, write) => {
      const low = field.low[k], step = (field.high[k] - low) / 65535, s = field.shorts.subarray(start + k * n);
      for (let i = 0; i < n; i++) write(i, low + step * s[i]);
    };
    if (c < field.components) return read(c, (i, v) => { out[i] = v; }), out;
    out.fill(0, 0, n);
    for (let k = 0; k < field.components; k++) read(k, (i, v) => { out[i] += v * v; });
    for (let i = 0; i < n; i++) out[i] = Math.sqrt(out[i]);
    return out;
  }

  /** Lowest and highest value, of the whole run or of one frame. */
  range(field, c, frame = null) {
    const key = `${c} ${frame}`;
    if (field.ranges[key]) return field.ranges[key];
    if (frame === null && c < field.components) return [field.low[c], field.high[c]];
    let low = Infinity, high = -Infinity;
    const n = field.shorts.length / (field.components * field.frames), out = new Float32Array(n);
    for (let f = 0; f < field.frames; f++) {
      if (frame !== null && f !== Math.min(frame, field.frames - 1)) continue;
      for (const v of this.values(field, f, c, out)) { low = Math.min(low, v); high = Math.max(high, v); }
    }
    return (field.ranges[key] = [low, high]);
  }

  /** Shows a frame: displacements, and values where it has the field. */
  show(frame, name, c) {
    const { move, value } = this.attributes;
    if (this.motion) {
      const one = new Float32Array(this.count);
      for (let k = 0; k < 3; k++) {
        this.values(this.motion, frame, k, one);
        for (let i = 0; i < this.count; i++) move.array[3 * i + k] = one[i] / this.size;
      }
      move.needsUpdate = true;
    }
    const of = (onLines) => this.fields.find((f) => f.name === name && f.onLines === onLines);
    const [onPoints, onLines] = [of(false), of(true)];
    if (onPoints) { this.values(onPoints, frame, c, value.array); value.needsUpdate = true; }
    for (const k of ["faces", "balls"]) if (this.objects[k]) this.objects[k].material.uniforms.painted.value = onPoints ? 1 : 0;
    this.showLines(frame, onPoints, onLines, c);
  }

  showLines(frame, onPoints, onLines, c) {
    const { bonds, cracks } = this.objects, { move, value } = this.attributes;
    if (bonds && bonds.visible) {
      const own = bonds.geometry.attributes, each = onLines && this.values(onLines, frame, c, new Float32Array(this.lines.length / 2));
      this.lines.forEach((i, k) => {
        for (let j = 0; j < 3; j++) own.move.array[3 * k + j] = move.array[3 * i + j];
        own.value.array[k] = each ? each[k >> 1] : value.array[i];
      });
      own.move.needsUpdate = own.value.needsUpdate = true;
      bonds.material.uniforms.painted.value = onPoints || onLines ? 1 : 0;
    }
    if (cracks) {
      const own = cracks.geometry.attributes, x = this.places;
      let n = 0;
      for (const k of this.breaks) {
        const i = this.lines[2 * k], e = this.lines[2 * k + 1];
        if (this.broken[k] > frame || (this.kept && !(this.kept[i] && this.kept[e]))) continue;
        for (let j = 0; j < 3; j++) {
          own.position.array[3 * n + j] = 0.5 * (x[3 * i + j] + x[3 * e + j]);
          own.move.array[3 * n + j] = 0.5 * (move.array[3 * i + j] + move.array[3 * e + j]);
        }
        n++;
      }
      cracks.geometry.setDrawRange(0, n);
      own.position.needsUpdate = own.move.needsUpdate = true;
    }
    this.cutLines(frame);
  }

  /** Leaves out what a cut, the other model of an overlap and the limits of the values take: whole cells, balls and bonds, so
      that what is seen is what was computed. */
  cut(keep, once, limits, frame) {
    if (once) this.share(frame);
    const own = once ? this.mine : undefined, f = this.faces;
    const valued = limits && this.objects[this.faces.length ? "faces" : "balls"]?.material.uniforms.painted.value;
    const within = (v) => v >= limits[0] && v <= limits[1];
    const all = (x, mine, inside) => Uint8Array.from({ length: x.length / 3 }, (_, k) => (!mine || mine[k]) && (!inside || inside(k)) && keep(x[3 * k], x[3 * k + 1], x[3 * k + 2]) ? 1 : 0);
    const value = this.attributes.value.array;
    const means = valued && f.length ? this.cellMeans(value) : null;
    this.kept = all(this.places, own?.points, valued && !f.length ? (k) => within(value[k]) : null);
    const { faces, edges, outline, balls } = this.objects;
    if (faces) {
      const cells = all(this.centres, own?.cells, means && ((k) => within(means[k]))), corners = [], pairs = [], surface = [];
      for (let k = 0; k < f.length; k += 6) {
        const inner = cells[f[k + 4]], outer = f[k + 5] !== NONE && cells[f[k + 5]];
        if (inner == outer) continue;
        surface.push(k);
        corners.push(f[k], f[k + 1], f[k + 2]);
        if (f[k + 3] !== f[k + 2]) corners.push(f[k], f[k + 2], f[k + 3]);
        // Every edge of a closed surface is met once in each direction.
        for (let j = 0; j < 4; j++) {
          const a = f[k + j], b = f[k + (j + 1) % 4];
          if (inner ? a < b : b < a) pairs.push(a, b);
        }
      }
      faces.geometry.setIndex(corners);
      edges.geometry.setIndex(pairs);
      // The outline of a larger surface takes longer than a frame of a film.
      outline.geometry.setIndex(surface.length < 60000 ? this.creases(surface) : []);
    }
    if (balls) balls.geometry.setIndex([...this.kept.keys()].filter((k) => this.kept[k]));
    this.cutLines(frame);
  }

  cutLines(frame) {
    const { bonds } = this.objects;
    if (!bonds || !bonds.visible) return;
    const index = [];
    for (let k = 0; k < this.lines.length / 2; k++) {
      const whole = !this.broken.length || this.broken[k] > frame;
      if (whole && (!this.kept || (this.kept[this.lines[2 * k]] && this.kept[this.lines[2 * k + 1]]))) index.push(2 * k, 2 * k + 1);
    }
    bonds.geometry.setIndex(index);
  }

  /** Which objects are there: by the part's mode and what is shown of all. */
  reveal(shown) {
    const on = { solid: ["faces", "outline", "balls"], outline: ["outline", "balls"], hidden: [] }[this.mode];
    for (const k in this.objects) this.objects[k].visible = on.includes(k);
    if (this.objects.balls) this.objects.balls.material.uniforms.shrink.value = this.mode === "outline" ? 0.22 : 1;
    if (this.objects.edges) this.objects.edges.visible = shown.edges && this.mode === "solid" && !this.mediator;
    // Lines without balls are all there is of a bar.
    const bar = !this.radii.length && !this.faces.length;
    if (this.objects.bonds) this.objects.bonds.visible = this.mode !== "hidden" && (shown.bonds || bar);
    if (this.objects.cracks) this.objects.cracks.visible = shown.broken && this.mode !== "hidden";
  }
}
