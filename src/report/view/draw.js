// Zones, cracks, gauges and a scale drawn on the reference image; what is written is a case file that the command repeats.
/** What a page around the drawing is told, and may ask of it. */
const drawing = { changed() {}, under() {} };
(() => {
const data = JSON.parse(document.getElementById('data').textContent);
const at = id => document.getElementById(id);
const [W, H] = [data.width, data.height];
/** Kinds: how they are drawn, what they are in the case file, their colour. */
const KINDS = {
  roi: { how: 'box', zone: true, name: 'zone', colour: '#56b4e9', key: 'r', say: 'Drag a rectangle: a zone of the specimen.' },
  polygon: { how: 'path', zone: true, least: 3, closed: true, name: 'zone', colour: '#56b4e9', key: 'p', say: 'Corners of a zone one by one; Enter, or the first corner again, ends it.' },
  exclude: { how: 'path', least: 3, closed: true, name: '', colour: '#d55e00', key: 'x', say: 'Corners of what is cut out of the zone chosen last; Enter ends it.' },
  brush: { how: 'paint', name: '', colour: '#d55e00', key: 'b', say: 'Paint over what is not to be measured: it is cut out of the zone chosen last.' },
  crack: { how: 'path', least: 2, name: 'crack', colour: '#f0e442', key: 'c', say: 'Points along the crack, some elements beyond the place its tip will reach; Enter ends it. An end inside a zone stays joined: a tip.' },
  extensometer: { how: 'drag', name: 'extensometer', colour: '#009e73', key: 'e', say: 'Drag from one end to the other.' },
  line: { how: 'drag', name: 'line', colour: '#cc79a7', key: 'l', say: 'Drag a line along which values are wanted.' },
  point: { how: 'click', name: 'point', colour: '#cc79a7', key: 'o', say: 'Click a point.' },
  scale: { how: 'drag', name: '', colour: '#e69f00', key: 'k', say: 'Drag a length that you know, then give it in mm; several are weighed.' },
  mark: { how: 'click', name: '', colour: '#e69f00', key: 'n', say: 'Click a point whose place on the specimen you know, then give its mm, along any axes; four or more tell how the plane stands.' },
};
/** Sections of the case file. */
const SECTIONS = { roi: 'zone', polygon: 'zone', crack: 'crack', extensometer: 'extensometer', line: 'line', point: 'probe' };
const KEYS = { select: 's', move: 'm' };
for (const kind in KINDS) KEYS[kind] = KINDS[kind].key;
let shapes = [], chosen = -1, tool = 'roi', path = null, drag = null, pointer = null, settings = { size: 16, brush: Math.max(4, Math.round(Math.max(W, H) / 40)), opening: false, joint: false, given: {}, e: null, nu: null, phi: null, dn: null, dt: null, r: null };
const past = [], future = [];
const frozen = () => JSON.stringify([shapes, settings]);
/** What is done after this can be undone. */
function remember() { past.push(frozen()); future.length = 0; }
function go(from, to) {
  if (!from.length) return;
  to.push(frozen());
  [shapes, settings] = JSON.parse(from.pop());
  chosen = Math.min(chosen, shapes.length - 1);
  path = drag = null;
  changed();
}

// --- geometry
const snapPx = () => 9 * (window.devicePixelRatio || 1) / view.factor();
const tenth = v => Math.round(10 * v) / 10;
/** Onto corners and borders that are near; with shift level or upright from `from`. */
function snapped(p, event, from) {
  let best = null, nearest = snapPx();
  const corners = shapes.flatMap((shape, k) => drag && drag.shape === k ? [] : cornersOf(shape));
  for (const q of [...corners, ...(path ? path.points.slice(0, 1) : [])]) {
    const gap = Math.hypot(p[0] - q[0], p[1] - q[1]);
    if (gap < nearest) { nearest = gap; best = q; }
  }
  if (best) return [...best];
  let [x, y] = p;
  if (event.shiftKey && from) { if (Math.abs(x - from[0]) > Math.abs(y - from[1])) y = from[1]; else x = from[0]; }
  const border = (v, n) => v < -.5 + snapPx() ? -.5 : v > n - .5 - snapPx() ? n - .5 : v;
  return [tenth(border(x, W)), tenth(border(y, H))];
}
/** The corners of a shape; of a rectangle all four. */
function cornersOf({ kind, points }) {
  if (kind !== 'roi') return points;
  const [[a, b], [c, d]] = points;
  return [[a, b], [c, b], [c, d], [a, d]];
}
const inside = (p, corners) => {
  let is = false;
  corners.forEach(([x, y], k) => {
    const [u, v] = corners[(k + 1) % corners.length];
    if ((y > p[1]) !== (v > p[1]) && p[0] < (u - x) * (p[1] - y) / (v - y) + x) is = !is;
  });
  return is;
};
function toSegment(p, a, b) {
  const [dx, dy] = [b[0] - a[0], b[1] - a[1]], l = dx * dx + dy * dy, t = l ? Math.max(0, Math.min(1, ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / l)) : 0;
  return Math.hypot(p[0] - a[0] - t * dx, p[1] - a[1] - t * dy);
}
const isCut = kind => kind === 'exclude' || kind === 'brush';
/** What a stroke of the brush covers, as polygons without a corner inwards: one along each of its pieces. */
function painted({ points, width }) {
  const pairs = points.length > 1 ? points.slice(1).map((p, k) => [points[k], p]) : [[points[0], points[0]]], around = 6;
  return pairs.map(([a, b]) => {
    const turn = Math.atan2(b[1] - a[1], b[0] - a[0]) + Math.PI / 2, r = width / 2;
    const arc = ([x, y], from) => Array.from({ length: around + 1 }, (_, k) => { const t = from + k * Math.PI / around; return [x + r * Math.cos(t), y + r * Math.sin(t)]; });
    return [...arc(a, turn), ...arc(b, turn + Math.PI)].map(([x, y]) => [tenth(Math.max(-.5, Math.min(W - .5, x))), tenth(Math.max(-.5, Math.min(H - .5, y)))]);
  });
}
/** A stroke without the points that lie within `off` of the line through those left. */
function thinned(points, off) {
  if (points.length < 3) return points;
  const [a, b] = [points[0], points[points.length - 1]];
  let far = 0, most = off;
  for (let k = 1; k + 1 < points.length; k++) { const gap = toSegment(points[k], a, b); if (gap > most) { far = k; most = gap; } }
  return far ? [...thinned(points.slice(0, far + 1), off).slice(0, -1), ...thinned(points.slice(far), off)] : [a, b];
}
const isClosed = kind => kind === 'roi' || KINDS[kind].closed;
/** What lies under a point: a corner of a shape, or the shape (the last drawn first). */
function under(p) {
  for (const near of [true, false]) {
    for (let k = shapes.length - 1; k >= 0; k--) {
      const corners = cornersOf(shapes[k]), corner = corners.findIndex(q => Math.hypot(p[0] - q[0], p[1] - q[1]) < snapPx());
      if (near && corner >= 0) return { shape: k, corner };
      const reach = Math.max(snapPx(), (shapes[k].width || 0) / 2), side = corners.some((q, i) => (i + 1 < corners.length || isClosed(shapes[k].kind) || corners.length === 1) && toSegment(p, q, corners[(i + 1) % corners.length]) < reach);
      if (!near && (side || (isClosed(shapes[k].kind) && inside(p, corners)))) return { shape: k, corner: -1 };
    }
  }
  return null;
}
const crosses = (a, b, c, d) => {
  const turn = (p, q, r) => Math.sign((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]));
  return turn(a, b, c) * turn(a, b, d) < 0 && turn(c, d, a) * turn(c, d, b) < 0;
};

// --- shapes
function nameFor(kind) {
  const base = KINDS[kind].name;
  if (!base) return '';
  for (let k = 1; ; k++) if (shapes.every(shape => shape.name !== `${base}${k}`)) return `${base}${k}`;
}
function add(kind, points) {
  remember();
  const zone = isCut(kind) ? zoneFor() : undefined;
  if (isCut(kind) && zone === undefined) { past.pop(); say('There is no zone yet to cut anything out of.'); return; }
  shapes.push({ kind, name: nameFor(kind), points, zone, mm: kind === 'scale' ? 0 : undefined, place: kind === 'mark' ? [null, null] : undefined, width: kind === 'brush' ? settings.brush : undefined });
  chosen = shapes.length - 1;
  changed();
  if (kind === 'scale') at('length').focus();
  if (kind === 'mark') at('mm-x').focus();
}
/** Name of the zone chosen, else of the last. */
function zoneFor() {
  const own = shapes[chosen];
  if (own && KINDS[own.kind].zone) return own.name;
  if (own && isCut(own.kind)) return own.zone;
  return shapes.filter(shape => KINDS[shape.kind].zone).map(shape => shape.name).pop();
}
function end() {
  if (!path) return;
  const { kind, points } = path, least = KINDS[kind].least;
  path = null;
  if (points.length >= least) add(kind, points);
  else { say(`${least} points are needed.`); draw(); }
}
function remove() {
  if (path) { path.points.pop(); if (!path.points.length) path = null; draw(); return; }
  if (chosen < 0) return;
  remember();
  const [gone] = shapes.splice(chosen, 1);
  if (KINDS[gone.kind].zone) shapes = shapes.filter(shape => !isCut(shape.kind) || shape.zone !== gone.name);
  chosen = -1;
  changed();
}

// --- the case file
// What a case file said that was read (`settings.given`; of a shape, `from`) stands in what is written, too: it is replaced only where something
// was drawn or typed anew.
const text = v => JSON.stringify(v).replace(/\u007f/g, '\\u007f');
const number = v => String(+v.toFixed(3));
/** A value as TOML, tables inline. */
function toml(v) {
  if (typeof v === 'string') return text(v);
  if (Array.isArray(v)) return `[${v.map(toml).join(', ')}]`;
  return v && typeof v === 'object' ? `{ ${lines(v).join(', ')} }` : String(v);
}
const lines = table => Object.entries(table).filter(([, v]) => v !== undefined).map(([key, v]) => `${/^[\w-]+$/.test(key) ? key : text(key)} = ${toml(v)}`);
const isTable = v => Boolean(v) && typeof v === 'object' && !Array.isArray(v);
/** A section, or one for each of a list. */
const section = (name, v) => isTable(v) ? ['', `[${name}]${name === 'cohesive' ? ' # to start from' : ''}`, ...lines(v)] : v.flatMap(table => ['', `[[${name}]]`, ...lines(table)]);
const isSections = v => isTable(v) || (Array.isArray(v) && v.length > 0 && v.every(isTable));
/** What a shape was in the case file, as long as nobody has moved it. */
const still = shape => shape.from && shape.from.points === JSON.stringify(shape.points) ? shape.from.table : {};
/** First pixel inside and first beyond, of the edges of a rectangle. */
const edges = ([[a, b], [c, d]]) => [Math.min(a, c), Math.min(b, d), Math.max(a, c), Math.max(b, d)].map(v => Math.round(v + .5));
const roiOf = shape => still(shape).roi || edges(shape.points);
const scales = () => shapes.filter(shape => shape.kind === 'scale' && shape.mm > 0);
const isPlaced = shape => shape.place.every(Number.isFinite);
const marks = () => shapes.filter(shape => shape.kind === 'mark');
const lengthOf = ({ points: [[a, b], [c, d]] }) => Math.hypot(c - a, d - b);
/** Size of a pixel: of the points that are known, else of the lengths; null without. */
function scaleOf() {
  const known = marks().filter(isPlaced), lengths = scales().filter(scale => lengthOf(scale) > 0);
  const spread = all => [0, 1].reduce((sum, c) => { const mean = all.reduce((s, p) => s + p[c], 0) / all.length; return sum + all.reduce((s, p) => s + (p[c] - mean) ** 2, 0); }, 0);
  if (known.length > 1) { const perPx = Math.sqrt(spread(known.map(({ place }) => place)) / spread(known.map(({ points }) => points[0]))); return perPx > 0 ? { perPx } : null; }
  if (!lengths.length) return null;
  const perPx = lengths.reduce((s, l) => s + l.mm * lengthOf(l), 0) / lengths.reduce((s, l) => s + lengthOf(l) ** 2, 0);
  const [one] = lengths, { mm, pixel } = still(one);
  return { perPx, given: lengths.length === 1 && mm === one.mm ? pixel : undefined };
}
/** What `[camera]` says of points, or of more lengths than one. */
function marked() {
  const size = { image_size_px: [W, H] }, known = marks();
  if (known.length) return { ...size, points: known.filter(isPlaced).map(({ points, place }) => [...points[0], ...place]) };
  const lengths = scales();
  return lengths.length > 1 || lengths.some(({ from }) => from && from.table.marked) ? { ...size, lengths: lengths.map(({ points, mm }) => [...points[0], ...points[1], mm]) } : null;
}
const zones = () => shapes.filter(shape => KINDS[shape.kind].zone);
/** The two zones of a joint, the lower one first, and the pieces of their facing edges that lie opposite each other; null without. */
function joint() {
  if (!settings.joint || zones().length !== 2) return null;
  const of = zone => { const all = cornersOf(zone), xs = all.map(p => p[0]), ys = all.map(p => p[1]); return { zone, box: [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)] }; };
  const [a, b] = zones().map(of), beside = Math.max(a.box[0], b.box[0]) >= Math.min(a.box[2], b.box[2]);
  // Down is the first of two zones one below the other, the left one of two side by side.
  const k = beside ? 0 : 1, [first, second] = (k ? a.box[1] > b.box[1] : a.box[0] < b.box[0]) ? [a, b] : [b, a];
  const gap = k ? first.box[1] - second.box[3] : second.box[0] - first.box[2];
  const along = [Math.max(first.box[1 - k], second.box[1 - k]), Math.min(first.box[3 - k], second.box[3 - k])];
  const at = k ? [first.box[1], second.box[3]] : [first.box[2], second.box[0]];
  const point = (u, v) => k ? [u, v] : [v, u];
  return { names: [first.zone.name, second.zone.name], gap, faces: at.map(v => along.map(u => point(u, v))) };
}
/** The fields of the joint: their section, their key there. */
const FIELDS = { e: ['substrate', 'E_MPa'], nu: ['substrate', 'nu'], phi: ['cohesive', 'phi_n_N_per_mm'], dn: ['cohesive', 'delta_n_mm'], dt: ['cohesive', 'delta_t_mm'], r: ['cohesive', 'r'] };
/** Whether a field of the joint is one of its case file: another law has other parameters. */
const isOwn = key => { const [name, field] = FIELDS[key], table = settings.given[name]; return !table || typeof table[field] === 'number'; };
const OF_JOINT = ['interface', 'substrate', 'cohesive', 'boundary', 'measurement', 'fit'];
/** The sections of the joint that is drawn. */
function jointTables() {
  const found = joint(), { given } = settings, made = {};
  for (const name of OF_JOINT) if (given[name] && (settings.joint || !given.interface)) made[name] = given[name];
  if (!found) return made;
  const zones = (given.interface || {}).zones;
  made.interface = { ...given.interface, zones: Array.isArray(zones) && found.names.every(name => zones.includes(name)) ? zones : found.names };
  const of = name => Object.fromEntries(Object.entries(FIELDS).filter(([key, [table]]) => table === name && isOwn(key) && settings[key] !== null).map(([key, [, field]]) => [field, settings[key]]));
  made.substrate = isTable(given.substrate) ? { ...given.substrate, ...of('substrate') } : given.substrate || { model: 'linear-elastic', ...of('substrate') };
  made.cohesive = isTable(given.cohesive) ? { ...given.cohesive, ...of('cohesive') } : { model: 'extended-xu-needleman', ...of('cohesive') };
  made.boundary = given.boundary || {};
  made.measurement = given.measurement || { nodes: 'free', weights: 'covariance' };
  made.fit = given.fit || { parameters: ['phi_n', 'delta_n', 'delta_t'] };
  return made;
}
/** A shape as a table of the case file. */
function tableOf(shape) {
  const { kind, name, points } = shape, from = shape.from ? shape.from.table : {}, own = still(shape);
  const table = { name: shape.from && !from.name && shape.from.name === name ? undefined : name };
  // The order of a table that is drawn anew, and after it what else the case file says.
  const made = drawn => ({ ...table, ...drawn, ...from, ...table, ...drawn });
  if (kind === 'crack') return made({ path: own.path || points });
  if (kind === 'extensometer' || kind === 'line') return made({ from: own.from || points[0], to: own.to || points[1] });
  if (kind === 'point') return made({ point: own.point || points[0] });
  const cuts = shapes.filter(other => isCut(other.kind) && other.zone === name);
  const cut = cuts.flatMap(other => still(other).corners ? [still(other).corners] : (other.kind === 'brush' ? painted(other) : [other.points]));
  // A zone of a case file that has no corners is the whole image, or what is found in it.
  const outline = kind === 'polygon' ? { polygon: own.polygon || points } : { roi: own === from ? from.roi : roiOf(shape) };
  const guard = typeof shape.guard === 'object' ? shape.guard : shape.guard > 0 ? +number(shape.guard) : undefined;
  return made({ ...outline, exclude: cut.length ? cut : undefined, mask: shape.mask || undefined, guard_px: guard });
}
function caseText() {
  const { given } = settings, written = [`# Drawn with quadrille ${data.quadrille} on an image of ${W} x ${H} px; px of this image, y down.`, ...(joint() ? ['# From the images to the law of the adhesive: quadrille run case.toml --output out'] : [])];
  const top = Object.entries(given).filter(([, v]) => !isSections(v));
  if (top.length) written.push(...lines(Object.fromEntries(top)), '');
  const { pixel_size_mm: given_mm, ...images } = given.images || {}, scale = scaleOf();
  const named = { reference: data.reference || undefined, deformed: (data.deformed.length > 1 ? data.deformed : data.deformed[0]) || images.deformed, page: data.page || images.page };
  written.push('[images]', ...lines({ ...named, ...images, ...named }));
  const [length] = scales(), camera = marked();
  if (scale && !camera) written.push(scale.given ? `pixel_size_mm = ${scale.given}` : `pixel_size_mm = ${scale.perPx.toPrecision(6)} # ${number(length.mm)} mm are ${number(lengthOf(length))} px`);
  written.push(...section('correlation', { ...given.correlation, element_size_px: settings.size }));
  for (const shape of shapes) if (SECTIONS[shape.kind]) written.push(...section(SECTIONS[shape.kind], [tableOf(shape)]));
  if (settings.opening && given.opening) written.push(...section('opening', [given.opening].flat()));
  else if (settings.opening && zones().length === 2) written.push(...section('opening', [{ zones: zones().map(zone => zone.name) }]));
  if (camera || given.camera) written.push(...section('camera', { ...given.camera, ...camera }));
  const rest = Object.entries(given).filter(([name, v]) => isSections(v) && !['images', 'camera', 'correlation', 'opening', ...OF_JOINT].includes(name));
  for (const [name, v] of [...rest, ...Object.entries(jointTables())]) written.push(...section(name, v));
  return written.join('\n') + '\n';
}
/** What the command would refuse, or measure badly. */
function faults() {
  const found = [], names = new Map();
  for (const shape of shapes) {
    const { kind, name, points } = shape;
    if (KINDS[kind].name) {
      if (!name.trim()) found.push('Something has no name.');
      if (names.has(`${KINDS[kind].name} ${name}`)) found.push(`Two are called '${name}': names must differ.`);
      names.set(`${KINDS[kind].name} ${name}`, true);
    }
    if (kind === 'roi') {
      const [x0, y0, x1, y1] = roiOf(shape), least = Math.min(x1 - x0, y1 - y0);
      if (least < settings.size) found.push(`${name} is ${least} px wide: less than one element of ${settings.size} px.`);
      else if (least < 2 * settings.size) found.push(`${name} is ${least} px wide: one element; no strain varies across it.`);
    }
    if (KINDS[kind].closed && points.some((a, i) => points.some((c, j) => j > i && crosses(a, points[(i + 1) % points.length], c, points[(j + 1) % points.length])))) found.push(`${name || 'What is cut out'} crosses itself.`);
    if (kind === 'crack' && !zones().some(zone => points.some(p => inside(p, cornersOf(zone))) || !zones().length)) found.push(`${name} lies beside every zone.`);
  }
  if (shapes.some(shape => shape.kind === 'scale' && !(shape.mm > 0))) found.push('The scale needs its length in mm.');
  if (marks().some(shape => !isPlaced(shape))) found.push('A known point needs its place in mm.');
  if (marks().length && marks().length < 4) found.push('Four known points tell how the plane stands, or one length the scale.');
  if (marks().length && scales().length) found.push('The known points hold the scale: the length is not written.');
  const between = joint();
  if (between && !scaleOf()) found.push('The joint needs the scale: drag a length that you know.');
  if (between && !(between.gap > 0)) found.push('The two zones overlap: between them there is no room for an adhesive.');
  const asked = Object.keys(FIELDS).filter(isOwn);
  if (between && asked.some(key => settings[key] === null)) found.push('The joint needs all its values: stiffness of the strips, and a law to start from.');
  else if (between && asked.some(key => !(settings[key] > 0 || (key === 'nu' && settings.nu === 0)))) found.push('The values of the joint have to be positive.');
  if (!data.deformed.length && !(settings.given.images || {}).deformed) found.push('No deformed images were named: add `deformed` to the case file.');
  if (lost.length) found.push(`What is written from here does not have these of the case file that was read: ${lost.join(', ')}.`);
  if (data.case_folder) found.push(`The case file that was read is in ${data.case_folder}: file names in it are relative to that folder.`);
  if (!zones().length) found.push('Without a zone the specimen is found in the image automatically.');
  return found;
}

// --- on the screen
const canvas = at('map'), pen = canvas.getContext('2d'), picture = new Image();
function draw() {
  view.paint(pen, picture);
  drawing.under(pen, view);
  const ratio = window.devicePixelRatio || 1;
  const stroke = (points, closed, colour, width, fill) => {
    pen.beginPath();
    points.forEach((p, k) => k ? pen.lineTo(...view.toCanvas(p)) : pen.moveTo(...view.toCanvas(p)));
    if (closed) pen.closePath();
    if (fill) { pen.fillStyle = `${colour}38`; pen.fill(); }
    pen.lineWidth = (width + 2) * ratio; pen.strokeStyle = 'rgba(0,0,0,.75)'; pen.stroke();
    pen.lineWidth = width * ratio; pen.strokeStyle = colour; pen.stroke();
  };
  const handles = (points, colour) => {
    for (const p of points) {
      const [x, y] = view.toCanvas(p), r = 4 * ratio;
      pen.fillStyle = colour; pen.strokeStyle = '#000'; pen.lineWidth = ratio;
      pen.beginPath(); pen.rect(x - r, y - r, 2 * r, 2 * r); pen.fill(); pen.stroke();
    }
  };
  const plates = [];
  const letters = (words, p, colour) => {
    pen.font = `bold ${14 * ratio}px system-ui, sans-serif`;
    const place = view.toCanvas(p), wide = pen.measureText(words).width + 8 * ratio, high = 20 * ratio;
    let [x, y] = [place[0] + 2 * ratio, place[1] + 3 * ratio];
    // All of the name of what is in sight, and below names that stand there already.
    if (place[0] >= 0 && place[0] <= canvas.width && place[1] >= 0 && place[1] <= canvas.height) [x, y] = [Math.min(x, canvas.width - wide), Math.min(y, canvas.height - high)];
    while (plates.some(other => x < other.x + other.wide && other.x < x + wide && y < other.y + high && other.y < y + high)) y += high;
    plates.push({ x, y, wide });
    // A plate as well as an outline: speckles as fine as the strokes of a letter are hidden behind it.
    pen.fillStyle = 'rgba(0,0,0,.6)';
    pen.fillRect(x, y, wide, high);
    pen.lineWidth = 4 * ratio; pen.lineJoin = 'round'; pen.strokeStyle = '#000'; pen.fillStyle = colour;
    pen.strokeText(words, x + 4 * ratio, y + 15 * ratio); pen.fillText(words, x + 4 * ratio, y + 15 * ratio);
    pen.lineJoin = 'miter';
  };
  const between = joint();
  if (between && between.gap > 0) {
    const [[a, b], [c, d]] = between.faces, middle = f => [(f[0][0] + f[1][0]) / 2, (f[0][1] + f[1][1]) / 2], mm = scaleOf();
    stroke([a, b, d, c], true, '#e69f00', 2, true);
    // The normal: from the first zone to the second.
    stroke([middle([a, b]), middle([c, d])], false, '#e69f00', 3);
    letters(mm ? `adhesive, ${(between.gap * mm.perPx).toPrecision(3)} mm` : `adhesive, ${number(between.gap)} px`, middle([c, d]), '#e69f00');
  }
  const brushed = ({ points, width }, colour) => {
    pen.beginPath();
    [...points, points[points.length - 1]].forEach((p, k) => k ? pen.lineTo(...view.toCanvas(p)) : pen.moveTo(...view.toCanvas(p)));
    pen.lineCap = pen.lineJoin = 'round'; pen.lineWidth = width * view.factor(); pen.strokeStyle = `${colour}70`; pen.stroke();
    pen.lineCap = 'butt'; pen.lineJoin = 'miter';
  };
  shapes.forEach((shape, k) => {
    const corners = cornersOf(shape), colour = KINDS[shape.kind].colour;
    if (shape.kind === 'brush') { brushed(shape, colour); if (k === chosen) handles(corners, colour); return; }
    stroke(corners, isClosed(shape.kind), colour, k === chosen ? 3 : 2, isClosed(shape.kind));
    if (shape.kind === 'roi') grid(shape, ratio);
    if (k === chosen || !isClosed(shape.kind)) handles(corners, colour);
    const words = shape.kind === 'scale' ? (shape.mm > 0 ? `${number(shape.mm)} mm` : 'scale') : shape.kind === 'mark' ? (isPlaced(shape) ? `${shape.place.map(number).join(', ')} mm` : 'mm?') : shape.kind === 'exclude' ? 'cut out' : shape.name;
    letters(words, corners[0], colour);
  });
  if (path) {
    const points = pointer ? [...path.points, pointer] : path.points, colour = KINDS[path.kind].colour;
    stroke(points, false, colour, 2, false);
    handles(path.points, colour);
  }
  if (drag && drag.kind === 'brush') brushed(drag, KINDS.brush.colour);
  else if (drag && drag.kind) stroke(cornersOf(drag), isClosed(drag.kind), KINDS[drag.kind].colour, 2, isClosed(drag.kind));
}
/** The elements of a rectangle. */
function grid(shape, ratio) {
  const [x0, y0, x1, y1] = roiOf(shape).map(v => v - .5), size = settings.size;
  if (size * view.factor() < 5 * ratio) return;
  pen.beginPath();
  for (let x = x0; x <= x1 + 1e-9; x += size) { pen.moveTo(...view.toCanvas([x, y0])); pen.lineTo(...view.toCanvas([x, y0 + Math.floor((y1 - y0) / size) * size])); }
  for (let y = y0; y <= y1 + 1e-9; y += size) { pen.moveTo(...view.toCanvas([x0, y])); pen.lineTo(...view.toCanvas([x0 + Math.floor((x1 - x0) / size) * size, y])); }
  pen.lineWidth = ratio; pen.strokeStyle = 'rgba(86,180,233,.6)'; pen.stroke();
}
const say = words => { at('readout').textContent = words; };
function tell(p) {
  const mm = scaleOf(), where = `x ${p[0].toFixed(1)}, y ${p[1].toFixed(1)} px`;
  const size = drag && drag.kind === 'brush' ? '' : drag && drag.kind === 'roi' ? (([a, b, c, d]) => `: ${c - a} x ${d - b} px`)(edges(drag.points)) : drag && drag.kind ? `: ${Math.hypot(drag.points[1][0] - drag.points[0][0], drag.points[1][1] - drag.points[0][1]).toFixed(1)} px` : '';
  say(`${KINDS[tool] ? KINDS[tool].say : tool === 'select' ? 'Click to choose, drag a corner or the whole; Delete removes.' : 'Drag the view.'} (${where}${mm ? `, ${(p[0] * mm.perPx).toFixed(3)}, ${(p[1] * mm.perPx).toFixed(3)} mm` : ''}${size})`);
}
/** After every change: drawing, case file, faults, fields. */
function changed() {
  const own = shapes[chosen];
  at('name').value = own ? own.name : '';
  at('name').disabled = !own || !KINDS[own.kind].name;
  at('length-label').hidden = !own || own.kind !== 'scale';
  if (own && own.kind === 'scale' && document.activeElement !== at('length')) at('length').value = own.mm || '';
  at('mm-label').hidden = !own || own.kind !== 'mark';
  if (own && own.kind === 'mark') ['mm-x', 'mm-y'].forEach((name, c) => { if (document.activeElement !== at(name)) at(name).value = own.place[c] ?? ''; });
  at('size').value = settings.size;
  at('brush-label').hidden = tool !== 'brush' && !(own && own.kind === 'brush');
  if (document.activeElement !== at('brush')) at('brush').value = own && own.kind === 'brush' ? own.width : settings.brush;
  at('mask-label').hidden = !own || !KINDS[own.kind].zone;
  if (document.activeElement !== at('mask')) at('mask').value = (own && own.mask) || '';
  at('guard-label').hidden = !own || !KINDS[own.kind].zone;
  if (document.activeElement !== at('guard')) at('guard').value = !own || !own.guard ? 0 : typeof own.guard === 'object' ? '' : own.guard;
  at('opening-label').hidden = zones().length !== 2 && !settings.given.opening;
  at('opening').checked = settings.opening;
  at('joint-label').hidden = zones().length !== 2;
  at('joint').checked = settings.joint;
  at('joint-values').hidden = !joint();
  for (const key in FIELDS) {
    at(`joint-${key}`).disabled = !isOwn(key);
    if (document.activeElement !== at(`joint-${key}`)) at(`joint-${key}`).value = isOwn(key) ? settings[key] ?? '' : '';
  }
  for (const { field, path: [name, key] } of keyed) if (document.activeElement !== field) field.value = (settings.given[name] || {})[key] ?? '';
  at('case').textContent = caseText();
  at('notes').replaceChildren(...faults().map(words => { const made = document.createElement('p'); made.className = 'lead'; made.textContent = words; return made; }));
  at('undo').disabled = !past.length;
  at('redo').disabled = !future.length;
  draw();
  drawing.changed();
}
function take(name) {
  if (path) end();
  tool = name;
  at('brush-label').hidden = name !== 'brush';
  for (const other in KEYS) at(`tool-${other}`).setAttribute('aria-pressed', String(other === name));
  canvas.className = name === 'move' ? 'move' : 'busy';
  say(KINDS[name] ? KINDS[name].say : name === 'select' ? 'Click to choose, drag a corner or the whole; Delete removes.' : 'Drag the view.');
}
const view = imageView(canvas, [W, H], {
  draw, share: .7, moves: () => tool === 'move',
  on: {
    down(p, event) {
      if (tool === 'select') {
        const hit = under(p);
        chosen = hit ? hit.shape : -1;
        if (hit) drag = { ...hit, from: p, before: JSON.stringify(shapes[hit.shape].points), frozen: frozen() };
        changed();
        return;
      }
      const how = KINDS[tool].how;
      if (how === 'paint') { drag = { kind: tool, points: [p], width: settings.brush }; draw(); }
      if (how === 'box' || how === 'drag') { const q = snapped(p, event); drag = { kind: tool, points: [q, q] }; }
    },
    move(p, event, held) {
      pointer = path ? snapped(p, event, path.points[path.points.length - 1]) : null;
      if (held && drag && drag.kind === 'brush') { const last = drag.points[drag.points.length - 1]; if (Math.hypot(p[0] - last[0], p[1] - last[1]) > drag.width / 8) drag.points.push(p); }
      else if (held && drag && drag.kind) drag.points = [drag.points[0], snapped(p, event, drag.kind === 'roi' ? null : drag.points[0])];
      else if (held && drag) {
        const points = JSON.parse(drag.before), shape = shapes[drag.shape];
        if (drag.corner < 0) shape.points = points.map(([x, y]) => [tenth(x + p[0] - drag.from[0]), tenth(y + p[1] - drag.from[1])]);
        else if (shape.kind === 'roi') {
          const q = snapped(p, event), [[a, b], [c, d]] = points, k = drag.corner;
          shape.points = [[k === 0 || k === 3 ? q[0] : a, k < 2 ? q[1] : b], [k === 1 || k === 2 ? q[0] : c, k > 1 ? q[1] : d]];
        } else { points[drag.corner] = snapped(p, event, points[drag.corner - 1]); shape.points = points; }
        at('case').textContent = caseText();
      }
      tell(p);
      draw();
    },
    up(p, event) {
      const done = drag;
      drag = null;
      if (tool === 'select') {
        if (done && JSON.stringify(shapes[done.shape].points) !== done.before) { past.push(done.frozen); future.length = 0; }
        changed();
        return;
      }
      const { how } = KINDS[tool];
      if (how === 'click') add(tool, [snapped(p, event)]);
      else if (how === 'path') {
        const q = snapped(p, event, path && path.points[path.points.length - 1]), last = path && path.points[path.points.length - 1];
        if (path && KINDS[tool].closed && path.points.length >= 3 && q[0] === path.points[0][0] && q[1] === path.points[0][1]) { end(); return; }
        if (last && last[0] === q[0] && last[1] === q[1]) { if (path.points.length >= KINDS[tool].least) end(); return; }
        path = { kind: tool, points: [...(path ? path.points : []), q] };
        draw();
      } else if (how === 'paint') { if (done) add(tool, thinned(done.points, done.width / 10).map(q => q.map(tenth)));
      } else if (done) {
        const points = [done.points[0], snapped(p, event, how === 'drag' ? done.points[0] : null)];
        if (Math.hypot(points[1][0] - points[0][0], points[1][1] - points[0][1]) >= 2) add(tool, points);
        else draw();
      }
    },
  },
});
for (const name in KEYS) at(`tool-${name}`).addEventListener('click', () => take(name));
at('end').addEventListener('click', end);
at('undo').addEventListener('click', () => go(past, future));
at('redo').addEventListener('click', () => go(future, past));
at('remove').addEventListener('click', remove);
at('name').addEventListener('change', event => {
  const own = shapes[chosen], name = event.target.value.trim();
  if (!own || !name) { changed(); return; }
  remember();
  if (KINDS[own.kind].zone) {
    for (const shape of shapes) if (isCut(shape.kind) && shape.zone === own.name) shape.zone = name;
    for (const table of [settings.given.interface, settings.given.opening].flat()) if (table && Array.isArray(table.zones)) table.zones = table.zones.map(zone => zone === own.name ? name : zone);
  }
  own.name = name;
  changed();
});
at('length').addEventListener('input', event => { const own = shapes[chosen]; if (own && own.kind === 'scale') { own.mm = Math.max(0, parseFloat(event.target.value) || 0); changed(); } });
['mm-x', 'mm-y'].forEach((name, c) => at(name).addEventListener('input', event => { const own = shapes[chosen], mm = parseFloat(event.target.value); if (own && own.kind === 'mark') { own.place[c] = Number.isFinite(mm) ? mm : null; changed(); } }));
/** Keys of the case file that have a field of their own: `[section] key`. */
const keyed = [...document.querySelectorAll('[data-key]')].map(field => ({ field, path: field.dataset.key.split('.') }));
for (const { field, path: [name, key] } of keyed) field.addEventListener('change', () => {
  const value = field.type === 'number' ? parseFloat(field.value) : field.value.trim(), { given } = settings;
  remember();
  const { [key]: before, ...table } = given[name] || {};
  if (value || value === 0) table[key] = value;
  if (Object.keys(table).length) given[name] = table; else delete given[name];
  changed();
});
at('size').addEventListener('change', event => { remember(); settings.size = Math.max(4, Math.min(128, Math.round(event.target.value) || 16)); changed(); });
at('brush').addEventListener('change', event => {
  const own = shapes[chosen], width = Math.max(1, Math.min(Math.max(W, H), parseFloat(event.target.value) || settings.brush));
  remember();
  settings.brush = width;
  if (own && own.kind === 'brush') own.width = width;
  changed();
});
at('mask').addEventListener('change', event => {
  const own = shapes[chosen];
  if (!own || !KINDS[own.kind].zone) return;
  remember();
  own.mask = event.target.value.trim();
  changed();
});
at('guard').addEventListener('change', event => {
  const own = shapes[chosen];
  if (!own || !KINDS[own.kind].zone) return;
  remember();
  // Sides of their own in the case file (a table) give way to one number for all.
  own.guard = Math.max(0, Math.min(64, parseFloat(event.target.value) || 0));
  changed();
});
at('opening').addEventListener('change', event => { remember(); settings.opening = event.target.checked; changed(); });
at('joint').addEventListener('change', event => { remember(); settings.joint = event.target.checked; changed(); });
for (const key in FIELDS) at(`joint-${key}`).addEventListener('change', event => { remember(); const value = parseFloat(event.target.value); settings[key] = Number.isFinite(value) ? Math.max(0, value) : null; changed(); });
at('copy').addEventListener('click', async () => say(await copied(at('case'))));
at('save').addEventListener('click', () => download('case.toml', `data:application/toml;charset=utf-8,${encodeURIComponent(caseText())}`));
document.addEventListener('keydown', event => {
  if (['SELECT', 'INPUT'].includes(event.target.tagName)) return;
  const key = event.key.toLowerCase();
  if ((event.ctrlKey || event.metaKey) && key === 'z') { event.preventDefault(); if (event.shiftKey) go(future, past); else go(past, future); return; }
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const keys = { delete: remove, backspace: remove, enter: end, escape: () => { path = drag = null; draw(); }, '+': () => view.closer(1.5), '-': () => view.closer(1 / 1.5), 0: view.whole };
  for (const name in KEYS) keys[KEYS[name]] = () => take(name);
  if (keys[key] && !(key === 'enter' && event.target.tagName === 'BUTTON')) { event.preventDefault(); keys[key](); }
});
at('subtitle').textContent = `${data.shown}, ${W} x ${H} px`;
at('where').textContent = `Save it in ${data.folder}: image names are relative to the folder of the case file. Then: quadrille correlate --case case.toml --output out`;
if (data.png) { picture.onload = draw; picture.src = `data:image/png;base64,${data.png}`; }
/** What of a case file this page cannot write again. */
let lost = [];
/** The shapes of a case file, and all else it says. */
function load(given) {
  const rest = JSON.parse(JSON.stringify(given)), edge = v => v - .5;
  shapes = []; lost = [];
  // Numbers that a page does not keep: infinite ones, and whole ones beyond 2^53.
  const check = (v, where) => {
    if (v === null || (Number.isInteger(v) && !Number.isSafeInteger(v))) lost.push(where);
    else if (typeof v === 'object') Object.keys(v).forEach(key => check(v[key], where ? `${where} ${key}` : `[${key}]`));
  };
  check(given, '');
  const add = (kind, table, name, points, more) => shapes.push({ kind, name, points, from: { table, name, points: JSON.stringify(points) }, ...more });
  /** Takes the tables that can be drawn; the others are written as they are. */
  const each = (kind, can, make) => {
    const tables = [rest[kind] || []].flat();
    tables.filter(can).forEach((table, k) => make(table, table.name || `${kind}${k + 1}`));
    rest[kind] = tables.filter(table => !can(table));
    if (!rest[kind].length) delete rest[kind];
  };
  each('zone', zone => !(zone.roi && zone.polygon) && !zone.in_mm, (zone, name) => {
    const { roi, polygon, exclude = [], guard_px: guard = 0, mask = '' } = zone;
    const points = polygon || (roi ? [[edge(roi[0]), edge(roi[1])], [edge(roi[2]), edge(roi[3])]] : [[-.5, -.5], [W - .5, H - .5]]);
    add(polygon ? 'polygon' : 'roi', zone, name, points, { guard, mask });
    exclude.forEach(corners => add('exclude', { corners }, '', corners, { zone: name }));
  });
  each('crack', crack => Array.isArray(crack.path), (crack, name) => add('crack', crack, name, crack.path));
  for (const kind of ['extensometer', 'line']) each(kind, one => one.from && one.to, (one, name) => add(kind, one, name, [one.from, one.to]));
  each('probe', probe => Boolean(probe.point), (probe, name) => add('point', probe, name, [probe.point]));
  const { images = {}, correlation = {} } = rest, pixel = images.pixel_size_mm;
  const { points = [], lengths = [], ...camera } = rest.camera || {};
  points.forEach(([x, y, ...place]) => add('mark', {}, '', [[x, y]], { place }));
  lengths.forEach(([x0, y0, x1, y1, mm]) => add('scale', { marked: true }, '', [[x0, y0], [x1, y1]], { mm }));
  if (Object.keys(camera).length) rest.camera = camera; else delete rest.camera;
  settings.opening = Boolean(rest.opening);
  settings.joint = Boolean(rest.interface);
  if (correlation.element_size_px !== undefined) settings.size = correlation.element_size_px;
  if (pixel > 0) { const length = Math.min(100, Math.round(W / 2)), y = tenth(.95 * H), mm = length * pixel; add('scale', { mm, pixel }, '', [[0, y], [length, y]], { mm }); }
  for (const key in FIELDS) { const [name, field] = FIELDS[key], value = (rest[name] || {})[field]; if (typeof value === 'number') settings[key] = value; }
  settings.given = rest;
}
if (data.case) load(data.case);
Object.assign(drawing, {
  data, caseText, redraw: draw, frozen,
  /** Takes shapes and settings of before. */
  thaw(text) { const [old, set] = JSON.parse(text); shapes = old; Object.assign(settings, set); chosen = -1; changed(); },
  /** Which images the case file names. */
  images(reference, deformed) { data.reference = reference; data.deformed = deformed; changed(); },
});
take('roi');
view.resize();
changed();
})();
