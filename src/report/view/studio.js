// From a folder of images to results: what is drawn is checked, run and looked at by the program that serves this page.
(() => {
const { data } = drawing, own = data.studio, at = id => document.getElementById(id);
const element = (name, text) => { const made = document.createElement(name); if (text !== undefined) made.textContent = text; return made; };
const row = cells => { const made = element('tr'); made.append(...cells.map(cell => cell instanceof Node ? cell : element('td', cell))); return made; };
/** Shows remarks, each with the colour of its severity. */
const lines = (place, remarks) => at(place).replaceChildren(...remarks.map(({ severity, text }) => { const made = element('p', spoken({ severity, text })); made.className = severity === 'warning' ? 'lead warn' : 'lead'; return made; }));
const spoken = ({ severity, text }) => severity === 'warning' ? `warning: ${text}` : text;
const fault = text => ({ severity: 'warning', text });
/** Asks the program; an answer that is none is told in its words. */
async function ask(path, wish) {
  const answer = await fetch(path, wish ? { method: 'POST', body: JSON.stringify(wish) } : {});
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}
const pause = ms => new Promise(done => setTimeout(done, ms));

// --- images
const kept = (() => { try { return JSON.parse(sessionStorage.getItem('studio')) || {}; } catch { return {}; } })();
const keep = () => { try { sessionStorage.setItem('studio', JSON.stringify({ frozen: drawing.frozen(), left: [...left] })); } catch { /* it is only kept for another reference */ } };
const shown = own.images[own.image];
/** Images that are not in the series; at first those that are unlike the reference. */
const left = new Set(kept.left || own.images.filter(image => shown && image.pattern !== shown.pattern).map(image => image.name));
/** As few names and patterns as say which images are in the series. */
function series() {
  const named = [], done = new Set();
  for (const { name, pattern } of own.images) {
    if (done.has(name) || left.has(name)) continue;
    const alike = pattern ? own.images.filter(other => other.pattern === pattern) : [];
    if (alike.length > 2 && alike.every(other => other.name === shown.name || !left.has(other.name))) { named.push(pattern); alike.forEach(other => done.add(other.name)); }
    else if (name !== shown.name) named.push(name);
  }
  return named;
}
function listed() {
  const names = series(), n = own.images.filter(({ name }) => !left.has(name) && name !== shown.name).length;
  at('images-note').textContent = own.fault || `${n} deformed image${n === 1 ? '' : 's'}, in this order`;
  drawing.images(shown ? shown.name : null, names);
}
at('folder').textContent = `${data.folder}: the reference is the image at rest, on which is drawn.`;
own.images.forEach(({ name }, k) => {
  const reference = element('input'), taken = element('input'), cells = [element('td', k + 1), element('td'), element('td'), element('td', name)];
  Object.assign(reference, { type: 'radio', name: 'reference', checked: k === own.image });
  reference.setAttribute('aria-label', `${name} is the reference`);
  reference.addEventListener('change', () => { left.delete(name); keep(); location.search = `?image=${k}`; });
  Object.assign(taken, { type: 'checkbox', checked: !left.has(name) });
  taken.setAttribute('aria-label', `${name} is in the series`);
  taken.addEventListener('change', () => { if (taken.checked) left.delete(name); else left.add(name); listed(); });
  cells[1].append(reference);
  if (k !== own.image) cells[2].append(taken);
  const made = row(cells);
  if (k === own.image) made.className = 'shown';
  at('images').tBodies[0].append(made);
});
for (const kind in own.files) at(kind).append(...own.files[kind].map(name => { const made = element('option'); made.value = name; return made; }));
at('masks').append(...own.images.map(({ name }) => { const made = element('option'); made.value = name; return made; }));
const every = on => { own.images.forEach(({ name }) => { if (on) left.delete(name); else left.add(name); }); at('images').querySelectorAll('input[type=checkbox]').forEach(box => { box.checked = on; }); listed(); };
at('all-images').addEventListener('click', () => every(true));
at('no-images').addEventListener('click', () => every(false));
at('reread').addEventListener('click', () => { keep(); location.reload(); });

// --- what lies on the image: the mesh that was checked, or the field of the last frame
let mesh = null, grid = null, bare = [], field = null, fieldMesh = null;
const colours = Uint8Array.from(atob(own.colours), c => c.charCodeAt(0));
const path = (pen, view, { nodes, elements }, k) => elements[k].forEach((n, c) => { const p = view.toCanvas([nodes[2 * n], nodes[2 * n + 1]]); if (c) pen.lineTo(...p); else pen.moveTo(...p); });
drawing.under = (pen, view) => {
  const ratio = window.devicePixelRatio || 1;
  if (field && fieldMesh) {
    const { values, on } = field, [low, high] = range(values);
    pen.globalAlpha = .7;
    fieldMesh.elements.forEach((corners, k) => {
      const v = on === 'nodes' ? corners.reduce((s, n) => s + values[n] / 4, 0) : values[k];
      if (on === 'nodes' ? corners.some(n => values[n] === null) : v === null) return;
      const t = 3 * Math.max(0, Math.min(255, Math.round(255 * (v - low) / (high - low))));
      pen.fillStyle = `rgb(${colours[t]},${colours[t + 1]},${colours[t + 2]})`;
      pen.beginPath(); path(pen, view, fieldMesh, k); pen.closePath(); pen.fill();
    });
    pen.globalAlpha = 1;
    return;
  }
  if (grid && at('show-grid').checked) gridded(pen, view, ratio);
  if (!mesh || !at('show-mesh').checked) return;
  pen.beginPath();
  mesh.elements.forEach((corners, k) => { path(pen, view, mesh, k); pen.closePath(); });
  pen.lineWidth = ratio; pen.strokeStyle = 'rgba(86,180,233,.7)'; pen.stroke();
  pen.beginPath();
  for (const n of bare) {
    const [x, y] = view.toCanvas([mesh.nodes[2 * n], mesh.nodes[2 * n + 1]]), r = 4 * ratio;
    pen.moveTo(x - r, y - r); pen.lineTo(x + r, y + r); pen.moveTo(x - r, y + r); pen.lineTo(x + r, y - r);
  }
  pen.lineWidth = 2 * ratio; pen.strokeStyle = '#d55e00'; pen.stroke();
};
/** How many times the camera's bending of its grid is drawn: a round number that makes it a thirtieth of the image. */
const enlarged = () => { const most = Math.max(data.width, data.height) / 30 / grid.most_px, ten = 10 ** Math.floor(Math.log10(Math.max(1, most))); return ten * [5, 2, 1].find(n => n * ten <= Math.max(1, most)); };
/** Lines that are straight and square on the specimen, as the camera bends them. */
function gridded(pen, view, ratio) {
  const times = enlarged();
  pen.beginPath();
  grid.plain.forEach((line, k) => {
    for (let i = 0; i < line.length; i += 2) {
      const p = view.toCanvas([0, 1].map(c => line[i + c] + times * (grid.seen[k][i + c] - line[i + c])));
      if (i) pen.lineTo(...p); else pen.moveTo(...p);
    }
  });
  pen.lineWidth = 1.5 * ratio; pen.strokeStyle = '#e69f00'; pen.stroke();
}
function range(values) {
  const sorted = values.filter(v => v !== null).sort((a, b) => a - b), cut = Math.floor(.005 * sorted.length);
  let low = sorted.length ? sorted[cut] : 0, high = sorted.length ? sorted[sorted.length - 1 - cut] : 1;
  if (!(high > low)) { low -= .5; high += .5; }
  return [low, high];
}
for (const name of ['show-mesh', 'show-grid']) at(name).addEventListener('change', drawing.redraw);

// --- checks
let asked = '', checking = false, running = false;
async function check() {
  const text = drawing.caseText();
  if (checking || running || text === asked || !shown) return;
  checking = true;
  asked = text;
  at('check-state').textContent = 'checking ...';
  try {
    const found = await ask('check', { case: text });
    if (text === drawing.caseText()) checked(found);
  } catch (error) {
    if (text === drawing.caseText()) { mesh = grid = null; at('grid-label').hidden = true; at('zones').hidden = true; at('check-state').textContent = 'A run would be refused:'; lines('check-notes', [fault(error.message)]); drawing.redraw(); }
  }
  checking = false;
  if (text !== drawing.caseText()) check();
}
function checked(found) {
  mesh = found.mesh; grid = found.grid; bare = found.without_texture;
  at('grid-label').hidden = !grid;
  at('check-state').textContent = found.remarks.some(({ severity }) => severity === 'warning') ? 'A run would warn:' : 'Nothing stands in the way of a run.';
  const scale = found.pixel_size_mm ? `1 px = ${found.pixel_size_mm.toPrecision(6)} mm${found.pixel_size_relative_std ? ` +- ${(100 * found.pixel_size_relative_std).toPrecision(2)} %` : ''}` : 'a scale is missing';
  const bent = grid ? [{ text: `Camera: ${scale}; it moves points by up to ${grid.most_px.toPrecision(2)} px, drawn ${enlarged()} times.` }] : [];
  lines('check-notes', [...bent, ...found.remarks]);
  at('zones').hidden = false;
  const both = ([x, y], digits) => `${x.toFixed(digits)}, ${y.toFixed(digits)}`;
  at('zones').tBodies[0].replaceChildren(...found.zones.map(({ name, elements, nodes, without_texture, sigma_px, look }) => row([name, elements, nodes, without_texture,
    sigma_px ? `${both(sigma_px, 4)} px (x, y)` : '-', look.noise_grey === undefined ? look.why : `${look.noise_grey.toFixed(2)} grey levels`,
    look.speckle_px && look.speckle_px.every(Number.isFinite) ? `${both(look.speckle_px, 1)} px` : '-'])));
  drawing.redraw();
}
let timer = null;
drawing.changed = () => {
  field = null;
  keep();
  clearTimeout(timer);
  timer = setTimeout(check, 300);
};

// --- run
const wish = () => ({ case: drawing.caseText(), replace: at('replace').checked });
async function order(path, more) {
  try { await ask(path, more); return true; } catch (error) { lines('run-notes', [fault(error.message)]); return false; }
}
at('write').addEventListener('click', async () => { if (await order('case', wish())) at('run-state').textContent = `${own.case} is written.`; });
at('run').addEventListener('click', async () => { lines('run-notes', []); at('run').disabled = true; if (!await order('run', wish())) at('run').disabled = false; });
at('stop-run').addEventListener('click', () => order('stop', {}));
let fields = [], wanted = 'u_y', looking = false, seen = 0;
at('live').addEventListener('change', () => { wanted = at('live').value; choose(); });
function choose() {
  field = fields.find(one => one.name === wanted) || fields[0] || null;
  if (field) { const [low, high] = range(field.values); at('readout').textContent = `frame ${seen}: ${field.name} from ${+low.toPrecision(3)} (dark) to ${+high.toPrecision(3)} (bright)${field.unit === '1' ? '' : ` ${field.unit}`}`; }
  drawing.redraw();
}
async function live() {
  if (looking) return;
  looking = true;
  try {
    if (!fieldMesh) fieldMesh = await ask('mesh');
    const got = await ask('live');
    seen = got.number; fields = got.fields;
    if (!at('live').options.length) { at('live').append(...fields.map(({ name, unit }) => { const made = element('option', unit === '1' ? name : `${name} (${unit})`); made.value = name; return made; })); at('live').value = wanted; }
    choose();
  } catch { /* the next frame shows it */ }
  looking = false;
}
// --- gauges: what was drawn becomes curves while the run goes on
const WHAT = { elongation: 0, strain: 2 }, NORMAL_95 = 1.959963984540054;
let gauges = null, reading = false, stale = false, plotted = null;
/** Reads what the gauges say of the frames that are done since. */
async function read() {
  stale = true;
  if (reading) return;
  reading = true;
  try {
    while (stale) {
      stale = false;
      const before = gauges, got = await ask(`gauges?from=${before ? before.last : 0}`);
      // Another run has begun meanwhile.
      if (gauges !== before) { stale = true; continue; }
      gauges = { ...got, rows: [...(before ? before.rows : []), ...got.rows] };
      if (!before) choices();
      plot();
      stale = stale || got.more;
    }
  } catch { /* the next frame shows them */ }
  reading = false;
}
function choices() {
  const fill = (id, names, chosen) => { at(id).replaceChildren(...names.map((name, k) => { const made = element('option', name); made.value = k; return made; })); at(id).value = Math.max(0, names.indexOf(chosen)); };
  // A force, else a time, else the frame.
  const begins = words => gauges.loads.find(name => words.some(word => name.toLowerCase().startsWith(word)));
  fill('gauge-over', ['frame', ...gauges.loads], begins(['load', 'force']) || begins(['stress']) || begins(['time']));
  fill('gauge-what', [`elongation (${gauges.unit})`, 'engineering strain']);
}
function plot() {
  const { names, loads, unit, rows } = gauges, over = +at('gauge-over').value, what = WHAT[+at('gauge-what').value ? 'strain' : 'elongation'];
  const number = v => typeof v === 'number' ? v : NaN, of = (k, c) => rows.map(({ values }) => number(values[k] && values[k][what + c]));
  const isShown = names.length > 0 && rows.length > 0;
  at('gauges').hidden = !isShown;
  at('work').classList.toggle('wide', isShown);
  if (!isShown) return;
  plotted = { x: rows.map(row => over ? number(row.loads[over - 1]) : row.number), xLabel: over ? loads[over - 1].replace(/^(.*)_(.*)$/, '$1 ($2)') : 'frame', yLabel: what ? 'engineering strain' : `elongation, opening (${unit})`,
    series: names.map((name, k) => ({ name, y: of(k, 0), band: of(k, 1).map(v => NORMAL_95 * v) })),
    note: `${names.join(', ')}: ${rows.length} frame${rows.length === 1 ? '' : 's'}; bands: 1.96 standard uncertainties by noise.` };
  const made = chartOf(plotted, Math.max(300, Math.min(900, at('gauge-chart').clientWidth)));
  at('gauge-chart').replaceChildren(made || element('p', 'Nothing is measured there.'));
  at('gauge-note').textContent = plotted.note;
}
for (const id of ['gauge-over', 'gauge-what']) at(id).addEventListener('change', plot);
at('gauge-picture').addEventListener('click', () => { const svg = at('gauge-chart').querySelector('svg'); if (svg) savePicture(svg, 'quadrille-gauges'); });
at('gauge-numbers').addEventListener('click', () => saveTable(plotted, 'quadrille-gauges'));
window.addEventListener('resize', () => { if (gauges) plot(); });

let from = 0;
function told(state) {
  if (state.done < from || (state.running && !running)) { from = 0; at('done').tBodies[0].replaceChildren(); fieldMesh = gauges = null; fields = []; state.frames = []; }
  from += state.frames.length;
  for (const frame of state.frames) {
    const made = row([frame.number, frame.file, [frame.status, ...(frame.remarks || []).map(spoken)].join('; '), frame.iterations, frame.residual_grey === null ? '-' : `${frame.residual_grey.toFixed(2)} grey levels`]);
    if (frame.status !== 'converged') made.className = 'bad';
    at('done').tBodies[0].prepend(made);
  }
  const ended = running && !state.running;
  running = state.running;
  at('run').disabled = running;
  at('stop-run').disabled = !running || state.stopping;
  const all = state.total || 0, done = Math.min(all, state.before + state.done);
  at('bar').value = all ? done / all : 0;
  const count = all ? `${done} of ${all} frames` : `${state.done} frames`;
  const words = { fine: 'done', incomplete: 'done, but not everything converged: see the frames and notes', stopped: 'stopped; run goes on from there', failed: 'could not run' };
  if (running || state.outcome) at('run-state').textContent = running ? `${state.stopping ? 'stopping' : 'running'}: ${count}` : `${words[state.outcome]}: ${count}`;
  at('run').textContent = state.outcome === 'stopped' ? 'resume' : 'run';
  if (running || state.outcome) lines('run-notes', [...state.notes, ...(state.fitting ? [{ text: state.fitting }] : []), ...(state.error ? [fault(state.error)] : [])]);
  at('trust').hidden = !state.trust;
  at('trust').textContent = state.trust || '';
  at('report').hidden = !state.report;
  if (running && state.frames.length) { live(); read(); }
  if (ended) { live(); read(); if (state.outcome !== 'failed') results(); asked = ''; }
}
async function follow() {
  let version = -1;
  for (;;) {
    try {
      const state = await ask(`state?since=${Math.max(0, version)}&from=${from}`);
      told(state);
      // More frames than come at once: at once again.
      version = state.done > from ? 0 : state.version;
    } catch { at('run-state').textContent = 'The program does not answer: is it still running in its terminal?'; await pause(3000); }
  }
}

// --- results
let views = 0;
function results() {
  at('results').hidden = false;
  at('results').src = `view?${++views}`;
  own.has_results = true;
}
at('look').addEventListener('click', results);
if (kept.frozen) drawing.thaw(kept.frozen);
at('where').textContent = `Written as ${own.case} into the folder when it is run. The same without this page: quadrille correlate --case ${own.case} --output ${own.output}`;
document.title = 'quadrille studio';
at('title').textContent = 'quadrille studio';
listed();
at('report').hidden = !own.has_report;
if (own.has_results) { results(); read(); }
follow();
})();
