// The page of a run. Its numbers come from the store, rounded to 1/65534 of the range that a quantity has in a frame; nothing is
// fetched, and names reach the page as text only.
(() => {
const data = JSON.parse(document.getElementById('data').textContent);
const at = id => document.getElementById(id);
const element = (name, text, attributes) => {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  for (const key in attributes || {}) made.setAttribute(key, attributes[key]);
  return made;
};
const bytesOf = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
const inflate = async text => {
  const stream = new Blob([bytesOf(text)]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
};
const MISSING = 65535;
const NORMAL_95 = 1.959963984540054;
// Within a report its own title and verdict stand, and keys are for what has the focus.
const alone = data.title !== null;
data.frames.forEach((frame, k) => { frame.at = k; });
const layers = data.layers, frames = data.frames.filter(frame => frame.field);
const nodes = new Float32Array(bytesOf(data.mesh.nodes).buffer), corners = new Uint32Array(bytesOf(data.mesh.elements).buffer);
const nNodes = nodes.length / 2, nElements = corners.length / 4;
const index = key => layers.findIndex(layer => layer.key === key);
const UX = index('ux'), UY = index('uy'), MARK = index('mark');

// --- fields
const cache = new Map();
const KEPT = 24;
/** All layers of a shown frame: an array of Float32Array, NaN where there is no value. */
function fieldOf(k) {
  if (!cache.has(k)) {
    cache.set(k, inflate(frames[k].field).then(bytes => {
      const count = bytes.length / 2, out = [];
      let from = 0;
      for (const [i, layer] of layers.entries()) {
        const n = layer.place === 'node' ? nNodes : nElements, values = new Float32Array(n), [low, step] = frames[k].scale[i];
        let code = 0;
        for (let j = 0; j < n; j++) {
          code = (code + (bytes[from + j] | bytes[count + from + j] << 8)) & 0xffff;
          values[j] = code === MISSING ? NaN : low + step * code;
        }
        from += n;
        out.push(values);
      }
      return out;
    }));
    if (cache.size > KEPT) cache.delete(cache.keys().next().value);
  }
  return cache.get(k);
}

// --- what is shown
const state = { frame: Math.max(0, frames.length - 1), layer: Math.max(0, UY), mode: 'value', deformed: false, magnify: 1, scale: 'series', picked: { profile: [], gauge: [] }, against: 0 };
let field = null, positions = nodes;
const canvas = at('map'), pen = canvas.getContext('2d'), over = document.createElement('canvas'), overPen = over.getContext('2d');
const picture = new Image();
const palettes = {};
for (const name in data.palettes) palettes[name] = bytesOf(data.palettes[name]);

/** Ends of the colours that were set by hand: of a quantity in all frames, or in one. */
const byHand = new Map();
const endsOf = () => state.scale === 'frame' ? `${state.layer} of ${state.frame}` : String(state.layer);
/** Between which ends the colours go, and what the bar shows: a tenth more on either side, to pull them out to. */
let range = [0, 1], track = [0, 1];
function automatic() {
  const layer = layers[state.layer];
  if (state.scale === 'frame') {
    const values = Array.from(field[state.layer]).filter(v => !Number.isNaN(v)).sort((a, b) => a - b);
    if (values.length) {
      const cut = Math.floor(values.length * .005);
      return spread(layer, values[cut], values[values.length - 1 - cut]);
    }
  }
  return layer.range;
}
function spread(layer, low, high) {
  if (layer.signed) { const most = Math.max(Math.abs(low), Math.abs(high)); [low, high] = [-most, most]; }
  if (!(high > low)) { const half = Math.abs(low) * .1 || 1; [low, high] = [low - half, high + half]; }
  return [low, high];
}

/** Numbers of the first and the last colour: of quantities with a sign white stays at zero, wherever the ends of the range are. */
function colourEnds(layer) {
  const most = Math.max(Math.abs(range[0]), Math.abs(range[1]));
  return layer.signed ? [-most, most] : range;
}
const within = v => v < range[0] ? range[0] : v > range[1] ? range[1] : v;

function place() {
  positions = nodes;
  if (!state.deformed || !field) return;
  positions = new Float32Array(nodes);
  for (let k = 0; k < nNodes; k++) {
    const u = field[UX][k], v = field[UY][k];
    positions[2 * k] += state.magnify * u;
    positions[2 * k + 1] += state.magnify * v;
  }
}

function draw() {
  view.paint(pen, picture);
  if (field) {
    const own = byHand.get(endsOf()), all = automatic();
    range = own || all;
    if (held < 0) {
      const low = Math.min(all[0], range[0]), high = Math.max(all[1], range[1]), room = .1 * (high - low);
      track = [low - room, high + room];
    }
    paint(); legend(Boolean(own)); marks(); steps();
  }
  tools();
}

function paint() {
  const layer = layers[state.layer], values = field[state.layer], colours = palettes[layer.palette];
  const w = canvas.width, h = canvas.height, image = pen.createImageData(w, h), out = image.data;
  const alpha = layer.signed ? 205 : 180, [first, last] = colourEnds(layer), scale = 255 / (last - first);
  const triangle = (ax, ay, av, bx, by, bv, cx, cy, cv) => {
    const area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay);
    if (!area) return;
    const y0 = Math.max(0, Math.ceil(Math.min(ay, by, cy) - .5)), y1 = Math.min(h - 1, Math.floor(Math.max(ay, by, cy) - .5));
    for (let y = y0; y <= y1; y++) {
      const py = y + .5;
      let from = Infinity, to = -Infinity;
      const cut = (x0, s0, x1, s1) => {
        if ((s0 <= py && s1 > py) || (s1 <= py && s0 > py)) {
          const x = x0 + (py - s0) * (x1 - x0) / (s1 - s0);
          if (x < from) from = x;
          if (x > to) to = x;
        }
      };
      cut(ax, ay, bx, by); cut(bx, by, cx, cy); cut(cx, cy, ax, ay);
      const x0 = Math.max(0, Math.ceil(from - .5)), x1 = Math.min(w, Math.ceil(to - .5));
      for (let x = x0; x < x1; x++) {
        const px = x + .5, b = ((px - ax) * (cy - ay) - (cx - ax) * (py - ay)) / area, c = ((bx - ax) * (py - ay) - (px - ax) * (by - ay)) / area;
        let t = (within(av + b * (bv - av) + c * (cv - av)) - first) * scale | 0;
        t = 3 * (t < 0 ? 0 : t > 255 ? 255 : t);
        const o = 4 * (y * w + x);
        out[o] = colours[t]; out[o + 1] = colours[t + 1]; out[o + 2] = colours[t + 2]; out[o + 3] = alpha;
      }
    }
  };
  const s = view.factor(), [ox, oy] = view.toCanvas([0, 0]);
  const x = [0, 0, 0, 0], y = [0, 0, 0, 0], v = [0, 0, 0, 0];
  for (let e = 0; e < nElements; e++) {
    let bad = false;
    for (let c = 0; c < 4; c++) {
      const n = corners[4 * e + c];
      x[c] = positions[2 * n] * s + ox; y[c] = positions[2 * n + 1] * s + oy;
      v[c] = layer.place === 'node' ? values[n] : values[e];
      bad = bad || Number.isNaN(v[c]) || Number.isNaN(x[c]);
    }
    if (bad || Math.max(...x) < 0 || Math.min(...x) > w || Math.max(...y) < 0 || Math.min(...y) > h) continue;
    const mx = (x[0] + x[1] + x[2] + x[3]) / 4, my = (y[0] + y[1] + y[2] + y[3]) / 4, mv = (v[0] + v[1] + v[2] + v[3]) / 4;
    for (let c = 0; c < 4; c++) { const d = (c + 1) % 4; triangle(x[c], y[c], v[c], x[d], y[d], v[d], mx, my, mv); }
  }
  if (over.width !== w || over.height !== h) { over.width = w; over.height = h; }
  overPen.putImageData(image, 0, 0);
  pen.drawImage(over, 0, 0);
}

// --- the bar of the colours: its ends are pulled, typed or stepped
/** Which end is held by the pointer: 0, 1, or none (-1). */
let held = -1;
const ENDS = ['low', 'high'];
function legend(isByHand) {
  const layer = layers[state.layer], colours = palettes[layer.palette], span = track[1] - track[0];
  const pen = at('colours').getContext('2d'), strip = pen.createImageData(256, 1), [first, last] = colourEnds(layer);
  for (let x = 0; x < 256; x++) {
    const v = track[0] + (x + .5) / 256 * span, t = Math.max(0, Math.min(255, Math.floor(255 * (within(v) - first) / (last - first))));
    for (let c = 0; c < 4; c++) strip.data[4 * x + c] = c < 3 ? colours[3 * t + c] : 255;
  }
  pen.putImageData(strip, 0, 0);
  ENDS.forEach((name, k) => {
    const handle = at(`bar-${name}`), words = isByHand ? String(range[k]) : written(range[k], (range[1] - range[0]) / 200);
    handle.style.left = `${100 * (range[k] - track[0]) / span}%`;
    for (const [key, value] of [['min', track[0]], ['max', track[1]], ['now', range[k]], ['text', words + unitOf(layer)]]) handle.setAttribute(`aria-value${key}`, value);
    if (document.activeElement !== at(name)) at(name).value = words;
  });
  at('bar-unit').textContent = unitOf(layer);
  at('automatic').disabled = !isByHand;
}
/** The colours go from `low` to `high` from now on, where these are ends. */
function setEnds(low, high) {
  if (!(high > low && Number.isFinite(high - low))) return false;
  byHand.set(endsOf(), [low, high]);
  draw();
  return true;
}
/** Moves an end to a value, and not over the other one; both are then what is written beside the bar. */
function pull(k, to) {
  const span = track[1] - track[0], short = v => +written(v, (range[1] - range[0]) / 200), v = short(to), ends = range.map(short);
  ends[k] = k ? Math.max(v, range[0] + span / 100) : Math.min(v, range[1] - span / 100);
  setEnds(...ends);
}

// --- the same by the commands
/** A word of a command line. */
const word = text => /^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`;
function steps() {
  const { figure, python } = layers[state.layer], [low, high] = ENDS.map((_, k) => String(+range[k].toPrecision(6))), { number } = frames[state.frame];
  const colours = { viridis: 'viridis', plasma: 'plasma', 'blue-red': 'RdBu_r' }[layers[state.layer].palette];
  const lines = { figure: figure && `quadrille figures ${word(data.folder)} --frames ${number} --quantity ${figure} --range=${low},${high}` };
  if (python) {
    const read = `quadrille.to_xarray(${JSON.stringify(data.folder)})`, frame = [`frame=${number}`, ...(python.select ? [python.select] : [])].join(', ');
    lines.python = layers[state.layer].place === 'node'
      ? `${read}.sel(${frame}).plot.scatter(x="x", y="y", hue="${python.name}", vmin=${low}, vmax=${high}, cmap="${colours}", yincrease=False)`
      : `${read}["${python.name}"].sel(${frame})`;
  }
  for (const name of ['figure', 'python']) {
    at(`step-${name}`).hidden = !lines[name];
    at(`line-${name}`).textContent = lines[name] || '';
  }
}

/** Elements of which something is to be said are crossed out. */
function marks() {
  if (MARK < 0) return;
  pen.strokeStyle = 'rgba(0,0,0,.55)';
  pen.lineWidth = Math.max(1, canvas.width / 1200);
  pen.beginPath();
  for (let e = 0; e < nElements; e++) {
    const mark = field[MARK][e];
    if (!(mark >= 1 && mark < 255)) continue;
    const p = c => view.toCanvas([positions[2 * corners[4 * e + c]], positions[2 * corners[4 * e + c] + 1]]);
    for (const [a, b] of mark >= 3 ? [[0, 2], [1, 3]] : [[0, 2]]) { pen.moveTo(...p(a)); pen.lineTo(...p(b)); }
  }
  pen.stroke();
}

function tools() {
  const line = (points, round) => {
    pen.lineWidth = 3 * window.devicePixelRatio;
    for (const [style, width] of [['#fff', 5], ['#000', 2]]) {
      pen.strokeStyle = style; pen.lineWidth = width * window.devicePixelRatio;
      pen.beginPath();
      points.forEach((p, k) => k ? pen.lineTo(...view.toCanvas(p)) : pen.moveTo(...view.toCanvas(p)));
      pen.stroke();
      if (round) for (const p of points) { pen.beginPath(); pen.arc(...view.toCanvas(p), 5 * window.devicePixelRatio, 0, 7); pen.stroke(); }
    }
  };
  const { profile, gauge } = state.picked;
  if (profile.length) line(profile, profile.length < 2);
  if (gauge.length) line(gauge.map(moved), true);
}
/** Where a point of the reference is drawn. */
function moved(p) {
  if (!state.deformed || !field) return p;
  const hit = find(p, nodes), u = hit && [UX, UY].map(i => value(hit, i));
  return u && !u.some(Number.isNaN) ? [p[0] + state.magnify * u[0], p[1] + state.magnify * u[1]] : p;
}

// --- values at points
/** The element at a point of the image and the place in it, on the nodes at `where`; null beside the mesh. */
function find([px, py], where) {
  for (let e = 0; e < nElements; e++) {
    const x = [], y = [];
    for (let c = 0; c < 4; c++) { const n = corners[4 * e + c]; x.push(where[2 * n]); y.push(where[2 * n + 1]); }
    if (px < Math.min(...x) || px > Math.max(...x) || py < Math.min(...y) || py > Math.max(...y)) continue;
    let a = .5, b = .5;
    for (let k = 0; k < 12; k++) {
      const w = [(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b];
      const rx = px - w.reduce((s, w, c) => s + w * x[c], 0), ry = py - w.reduce((s, w, c) => s + w * y[c], 0);
      const xa = (1 - b) * (x[1] - x[0]) + b * (x[2] - x[3]), xb = (1 - a) * (x[3] - x[0]) + a * (x[2] - x[1]);
      const ya = (1 - b) * (y[1] - y[0]) + b * (y[2] - y[3]), yb = (1 - a) * (y[3] - y[0]) + a * (y[2] - y[1]);
      const det = xa * yb - xb * ya;
      if (!det) break;
      const da = (rx * yb - ry * xb) / det, db = (ry * xa - rx * ya) / det;
      a += da; b += db;
      if (Math.abs(da) + Math.abs(db) < 1e-7) break;
    }
    if (a >= -1e-6 && a <= 1 + 1e-6 && b >= -1e-6 && b <= 1 + 1e-6) return { e, w: [(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b] };
  }
  return null;
}
function value(hit, i, of) {
  const values = (of || field)[i];
  if (layers[i].place === 'element') return values[hit.e];
  let sum = 0;
  for (let c = 0; c < 4; c++) sum += hit.w[c] * values[corners[4 * hit.e + c]];
  return sum;
}
const unitOf = layer => layer.unit === '1' ? '' : ' ' + layer.unit;
/** Of the field `of`, which nodes have a window of `size` nodes that an edge cuts: one lies within the rings around it. */
let cutOf = {};
function cuts(size) {
  if (cutOf.field === field && cutOf.size === size) return cutOf.nodes;
  const whole = [], edges = new Map();
  for (let e = 0; e < nElements; e++) {
    const own = [0, 1, 2, 3].map(c => corners[4 * e + c]);
    if (own.some(n => Number.isNaN(field[UX][n]))) continue;
    whole.push(own);
    own.forEach((n, c) => {
      const next = own[(c + 1) % 4], key = Math.min(n, next) * nNodes + Math.max(n, next);
      if (n !== next) edges.set(key, (edges.get(key) || 0) + 1);
    });
  }
  const found = new Uint8Array(nNodes);
  for (const [key, count] of edges) if (count === 1) found[Math.floor(key / nNodes)] = found[key % nNodes] = 1;
  for (let ring = 2; ring <= (size - 1) / 2; ring++) for (const own of whole) if (own.some(n => found[n] && found[n] < ring)) for (const n of own) found[n] = found[n] || ring;
  cutOf = { field, size, nodes: found };
  return found;
}
/** Whether an edge cuts a window that a value in this element comes from. */
const isCut = ({ e }) => layers[state.layer].window > 0 && [0, 1, 2, 3].some(c => cuts(layers[state.layer].window)[corners[4 * e + c]]);
/** What stands in the middle of the image of a point, with mm where a scale is known. */
function whereIs([x, y]) {
  const px = `x ${x.toFixed(1)}, y ${y.toFixed(1)} px`;
  return data.pixel_size_mm ? `${px} (${written(x * data.pixel_size_mm, data.pixel_size_mm)}, ${written(y * data.pixel_size_mm, data.pixel_size_mm)} mm)` : px;
}
function tell(point) {
  if (!field) return;
  const layer = layers[state.layer], hit = find(point, positions);
  if (!hit) { at('readout').textContent = `${whereIs(point)}: beside the mesh`; return; }
  const v = value(hit, state.layer), sigma = layer.sigma >= 0 ? value(hit, layer.sigma) : NaN;
  const step = sigma > 0 ? sigma : frames[state.frame].scale[state.layer][1] * 50;
  let text = `${whereIs(point)}: `;
  if (layer.key === 'mark') text += data.marks[v] || 'nothing is known of the element';
  else if (Number.isNaN(v)) text += `${layer.label}: not measured here`;
  else text += `${layer.label} = ${written(v, step)}${Number.isNaN(sigma) ? '' : ` \u00b1 ${written(sigma, sigma)}`}${unitOf(layer)}`;
  if (/^e(xx|yy|xy)$/.test(layer.key) && !Number.isNaN(v)) text += '; its standard uncertainty is known of strains over a window';
  if (isCut(hit)) text += '; an edge cuts its window';
  const mark = MARK >= 0 && layer.key !== 'mark' ? field[MARK][hit.e] : 0;
  if (mark >= 1 && data.marks[mark]) text += ` (element: ${data.marks[mark]})`;
  at('readout').textContent = text;
}

// --- curves
let shown = null;
function chart(plot) {
  const made = chartOf(plot, Math.max(300, Math.min(900, at('explorer').clientWidth)));
  shown = made && plot;
  at('chart').replaceChildren(made || element('p', 'Nothing is measured there.'));
  at('chart-note').textContent = made ? plot.note : '';
}
function profile() {
  const [a, b] = state.picked.profile, layer = layers[state.layer], n = 240, length = Math.hypot(b[0] - a[0], b[1] - a[1]);
  if (!(length > 0)) return;
  const mm = data.pixel_size_mm, x = [], y = [], band = [], cut = [];
  for (let k = 0; k <= n; k++) {
    const t = k / n, hit = find([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])], positions);
    x.push(t * length * (mm || 1));
    y.push(hit ? value(hit, state.layer) : NaN);
    band.push(hit && layer.sigma >= 0 ? NORMAL_95 * value(hit, layer.sigma) : NaN);
    cut.push(Boolean(hit) && isCut(hit));
  }
  at('chart-box').hidden = false;
  at('against-label').hidden = true;
  chart({ x, xLabel: `distance along the line (${mm ? 'mm' : 'px'})`, yLabel: `${layer.label}${layer.unit === '1' ? '' : ` (${layer.unit})`}`,
    cut, series: [{ name: layer.label, y, band: layer.sigma >= 0 ? band : null }],
    note: `Frame ${frames[state.frame].number}, from ${whereIs(a)} to ${whereIs(b)}${layer.sigma >= 0 ? '; band: 1.96 standard uncertainties by noise at the nodes' : ''}${cut.includes(true) ? '; grey: an edge cuts the window of the strain' : ''}.` });
}
let run = 0;
async function gauge() {
  const own = ++run, [a, b] = state.picked.gauge, hits = [a, b].map(p => find(p, nodes));
  at('chart-box').hidden = false;
  at('against-label').hidden = false;
  if (hits.includes(null)) { at('chart').replaceChildren(element('p', 'A point of the gauge lies beside the mesh.')); at('chart-note').textContent = ''; shown = null; return; }
  const length = Math.hypot(b[0] - a[0], b[1] - a[1]), n = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
  if (!(length > 0)) return;
  const mm = data.pixel_size_mm || 1, along = [], across = [], bandAlong = [], bandAcross = [], S = [UX, UY].map(i => layers[i].sigma);
  for (let k = 0; k < frames.length; k++) {
    const f = await fieldOf(k);
    if (own !== run) return;
    if (k % 20 === 0) at('chart-note').textContent = `reading frame ${k + 1} of ${frames.length}`;
    const [p, q] = hits.map(hit => [value(hit, UX, f), value(hit, UY, f)]), d = [q[0] - p[0], q[1] - p[1]];
    const variance = [0, 1].map(c => S[c] < 0 ? NaN : hits.reduce((s, hit) => s + value(hit, S[c], f) ** 2, 0));
    along.push((d[0] * n[0] + d[1] * n[1]) * mm);
    across.push((d[1] * n[0] - d[0] * n[1]) * mm);
    bandAlong.push(NORMAL_95 * mm * Math.sqrt(n[0] ** 2 * variance[0] + n[1] ** 2 * variance[1]));
    bandAcross.push(NORMAL_95 * mm * Math.sqrt(n[1] ** 2 * variance[0] + n[0] ** 2 * variance[1]));
  }
  const column = data.columns[state.against], unit = data.pixel_size_mm ? 'mm' : 'px';
  const x = frames.map(frame => column.values[frame.at] ?? NaN), last = state.frame;
  const strain = along[last] / (length * mm);
  chart({ x, here: last, xLabel: column.label, yLabel: `second point against the first (${unit})`,
    series: [{ name: 'along the gauge (opening, elongation)', y: along, band: bandAlong }, { name: 'across it (sliding)', y: across, band: bandAcross }],
    note: `From ${whereIs(a)} to ${whereIs(b)}, ${written(length * mm, length * mm / 1000)} ${unit} long. Frame ${frames[last].number}: along ${written(along[last], bandAlong[last] / 2)} ${unit}` +
      ` (engineering strain ${written(strain, bandAlong[last] / 2 / (length * mm))}), across ${written(across[last], bandAcross[last] / 2)} ${unit}; bands: 1.96 standard uncertainties by noise.` });
}
function curves() {
  if ((state.picked[state.mode] || []).length === 2) ({ profile, gauge })[state.mode]();
}

// --- frames
let wanted = 0;
async function show(k) {
  state.frame = Math.max(0, Math.min(frames.length - 1, k));
  const own = ++wanted, frame = frames[state.frame];
  at('frame').value = state.frame;
  const got = await fieldOf(state.frame);
  if (own !== wanted) return;
  field = got;
  place();
  draw();
  const columns = data.columns.slice(1).map(c => `${c.label} ${written(c.values[frame.at] ?? NaN, 0)}`);
  at('frame-name').textContent = [`frame ${frame.number} of ${data.n_frames}: ${frame.file}`, frame.status, ...columns].join(' \u00b7 ');
  for (const row of at('frames').querySelectorAll('tr[data-at]')) {
    const here = +row.dataset.at === state.frame, box = row.closest('.scroll');
    row.classList.toggle('here', here);
    if (here && box) box.scrollTop = row.offsetTop - box.clientHeight / 2;
  }
  if (last) tell(last);
  curves();
  location.replace(`#frame=${frame.number}&quantity=${layers[state.layer].key}`);
}
let timer = null;
function play(on) {
  clearTimeout(timer);
  timer = null;
  at('play').textContent = on ? 'stop' : 'play';
  if (!on) return;
  const step = async () => {
    await show(state.frame + 1 < frames.length ? state.frame + 1 : 0);
    if (timer !== null) timer = setTimeout(step, 120);
  };
  timer = setTimeout(step, 0);
}
function choose(mode) {
  state.mode = mode;
  for (const name of ['value', 'profile', 'gauge', 'move']) at(`mode-${name}`).setAttribute('aria-pressed', String(name === mode));
  canvas.className = mode === 'move' ? 'move' : mode === 'value' ? '' : 'busy';
  at('readout').textContent = { value: 'Point at the field: its value.', profile: 'Drag a line over the field, or click its two ends: values along it.', gauge: 'Drag from one point to another, or click both: how they part, over all frames.', move: 'Drag to move, wheel or two fingers to come closer.' }[mode];
  curves();
}
// --- pointer: mouse, pen, fingers
let last = null;
/** A point of the drawing as one of the reference. */
function reference(p) {
  if (!state.deformed) return p;
  const hit = find(p, positions);
  return hit ? [0, 1].map(c => hit.w.reduce((s, w, i) => s + w * nodes[2 * corners[4 * hit.e + i] + c], 0)) : p;
}
/** Where a drag has begun. */
let begun = null;
/** Whether a point is farther from there than a hand shakes: the radius of what marks a point. */
const isDragged = p => begun && Math.hypot(p[0] - begun[0], p[1] - begun[1]) * view.factor() > 5 * window.devicePixelRatio;
const view = imageView(canvas, [data.image.width, data.image.height], {
  draw, share: .65, moves: () => state.mode === 'move',
  on: {
    down(p) {
      if (state.mode === 'value') { last = p; tell(p); } else begun = p;
    },
    move(p, event, isHeld) {
      if (state.mode !== 'profile') { last = p; tell(p); }
      if (!isHeld || !isDragged(p)) return;
      pick([begun, p]);
      if (state.mode === 'profile') profile();
    },
    up(p) {
      const before = state.picked[state.mode];
      if (!before) return;
      pick(isDragged(p) ? [begun, p] : null, p);
      begun = null;
      curves();
    },
  },
});
/** Takes two points, or one more of two. */
function pick(both, one) {
  const { mode } = state, own = mode === 'gauge' ? reference : p => p;
  if (both) state.picked[mode] = both.map(own);
  else state.picked[mode] = state.picked[mode].length === 1 ? [...state.picked[mode], own(one)] : [own(one)];
  draw();
}

// --- set up
function quantity(k) {
  state.layer = k;
  at('quantity').value = String(k);
  if (field) { draw(); if (last) tell(last); curves(); }
  if (frames.length) location.replace(`#frame=${frames[state.frame].number}&quantity=${layers[k].key}`);
}
at('quantity').addEventListener('change', event => quantity(+event.target.value));
at('scale').addEventListener('change', event => { state.scale = event.target.value; draw(); });
at('deformed').addEventListener('change', event => { state.deformed = event.target.checked; place(); draw(); });
at('magnify').addEventListener('change', event => { const by = parseFloat(event.target.value); state.magnify = by >= 0 ? by : 1; place(); draw(); });
for (const name of ['value', 'profile', 'gauge', 'move']) at(`mode-${name}`).addEventListener('click', () => choose(name));
at('previous').addEventListener('click', () => { play(false); show(state.frame - 1); });
at('next').addEventListener('click', () => { play(false); show(state.frame + 1); });
at('play').addEventListener('click', () => play(timer === null));
at('frame').addEventListener('input', event => { play(false); show(+event.target.value); });
at('against').addEventListener('change', event => { state.against = +event.target.value; curves(); });
at('save').addEventListener('click', () => { if (shown) saveTable(shown, 'quadrille-curve'); });
at('save-picture').addEventListener('click', () => { if (shown) savePicture(at('chart').firstChild, 'quadrille-curve'); });
for (const name of ENDS) at(name).addEventListener('change', () => {
  if (!setEnds(...ENDS.map(end => parseFloat(at(end).value)))) { legend(byHand.has(endsOf())); at('readout').textContent = 'The lower end of the colours has to be below the upper one.'; }
});
at('automatic').addEventListener('click', () => { byHand.delete(endsOf()); draw(); });
const bar = at('bar');
const under = event => { const box = bar.getBoundingClientRect(); return track[0] + (event.clientX - box.left) / box.width * (track[1] - track[0]); };
bar.addEventListener('pointerdown', event => {
  const v = under(event);
  held = Math.abs(v - range[0]) < Math.abs(v - range[1]) ? 0 : 1;
  if (event.isTrusted) bar.setPointerCapture(event.pointerId);
  at(`bar-${ENDS[held]}`).focus({ preventScroll: true });
  event.preventDefault();
});
bar.addEventListener('pointermove', event => { if (held >= 0) pull(held, under(event)); });
for (const type of ['pointerup', 'pointercancel']) bar.addEventListener(type, () => { if (held >= 0) { held = -1; draw(); } });
ENDS.forEach((name, k) => at(`bar-${name}`).addEventListener('keydown', event => {
  const by = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }[event.key];
  if (!by) return;
  event.preventDefault();
  event.stopPropagation();
  pull(k, range[k] + by * (track[1] - track[0]) / 100);
}));
for (const name of ['figure', 'python']) at(`copy-${name}`).addEventListener('click', async () => { at('readout').textContent = await copied(at(`line-${name}`)); });
(alone ? document : at('explorer')).addEventListener('keydown', event => {
  if (event.ctrlKey || event.metaKey || event.altKey || ['SELECT', 'INPUT'].includes(event.target.tagName)) return;
  const keys = { ArrowLeft: () => show(state.frame - 1), ArrowRight: () => show(state.frame + 1), Home: () => show(0), End: () => show(frames.length - 1), '+': () => view.closer(1.5), '-': () => view.closer(1 / 1.5), 0: view.whole,
    v: () => choose('value'), p: () => choose('profile'), g: () => choose('gauge'), m: () => choose('move'), q: () => quantity((state.layer + 1) % layers.filter(l => l.choice).length) };
  if (event.key === ' ' && !['BUTTON', 'SUMMARY'].includes(event.target.tagName)) { event.preventDefault(); play(timer === null); } else if (keys[event.key]) { event.preventDefault(); if (event.key.startsWith('Arrow')) play(false); keys[event.key](); }
});
if (alone) {
  document.title = data.title;
  at('title').textContent = data.title;
  at('subtitle').textContent = data.subtitle;
}
for (const { text, warning } of data.lead) at('verdict').append(element('p', text, { class: warning ? 'lead warn' : 'lead' }));
layers.forEach((layer, k) => { if (layer.choice) at('quantity').append(element('option', layer.unit === '1' ? layer.label : `${layer.label} (${layer.unit})`, { value: k })); });
data.columns.forEach((column, k) => at('against').append(element('option', column.label, { value: k })));
at('frame').max = Math.max(0, frames.length - 1);
const head = element('tr');
for (const name of ['frame', 'file', 'status', ...data.columns.slice(1).map(c => c.label)]) head.append(element('th', name, { scope: 'col' }));
const body = element('tbody');
let count = 0;
for (const frame of data.frames) {
  const row = element('tr');
  for (const text of [frame.number, frame.file, frame.status + (frame.note ? ` (${frame.note})` : ''), ...data.columns.slice(1).map(c => written(c.values[frame.at] ?? NaN, 0))]) row.append(element('td', text));
  if (frame.field) { const k = count++; row.dataset.at = k; row.addEventListener('click', () => show(k)); }
  if (frame.bad) row.className = 'bad';
  body.append(row);
}
const top = element('thead');
top.append(head);
at('frames').append(top, body);
for (const [name, text] of data.about) { const row = element('tr'); row.append(element('th', name, { scope: 'row' }), element('td', text)); at('about').append(row); }
choose('value');
const asked = new URLSearchParams(location.hash.slice(1)), k = layers.findIndex(l => l.choice && l.key === asked.get('quantity'));
quantity(k >= 0 ? k : Math.max(0, UY));
const first = frames.findIndex(frame => String(frame.number) === asked.get('frame'));
if (first >= 0) state.frame = first;
if (data.image.png) { picture.onload = draw; picture.src = `data:image/png;base64,${data.image.png}`; }
window.addEventListener('resize', () => { if (shown) chart(shown); });
view.resize();
if (frames.length) show(state.frame);
else at('frame-name').textContent = 'No frame has a field.';
})();
