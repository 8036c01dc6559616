// The page: files in, words and pictures out.
'use strict';

const at = id => document.getElementById(id);

/** What the page knows: the device, its check, the pair, the last result. */
const known = { device: null, check: null, pair: { reference: null, deformed: null }, result: null, busy: false };

function say(id, text, kind = '') {
  at(id).textContent = text;
  at(id).className = `said ${kind}`;
}

/** What to say of an error: a fault as it is; anything else is a fault of this page. */
function sentence(error) {
  return error instanceof Fault ? error.message : `This page failed, which is a fault of its own: ${error.message}`;
}

function table(id, head, rows) {
  const row = (cells, kind) => {
    const tr = document.createElement('tr');
    tr.append(...cells.map(text => Object.assign(document.createElement(kind), { textContent: text })));
    return tr;
  };
  at(id).replaceChildren(row(head, 'th'), ...rows.map(cells => {
    const tr = row(cells.filter(cell => typeof cell !== 'boolean'), 'td');
    if (cells.includes(false)) tr.className = 'wrong';
    return tr;
  }));
}

const power = v => Number.isFinite(v) ? v.toExponential(1) : 'no number';
const ms = v => `${v.toFixed(v < 10 ? 1 : 0)} ms`;
const runs = counts => Object.entries(counts).map(([name, count]) => [name, count]);

// ---- 1. The device

async function check() {
  known.check = null;
  at('checked').hidden = true;
  ready();
  try {
    known.device ??= await Device.open(text => say('verdict', text));
    const { device } = known;
    device.raw.lost.then(() => forget(device));
    const { maxStorageBufferBindingSize, maxBufferSize } = device.limits;
    at('adapter').textContent = `${device.name}${device.info.isFallbackAdapter ? ' (software: slow, and no graphics card)' : ''}. A kernel ` +
      `sees ${Math.floor(maxStorageBufferBindingSize / 2 ** 20)} MiB at once, a buffer holds ${Math.floor(maxBufferSize / 2 ** 20)} MiB.`;
    say('verdict', 'A small pair of images goes through every kernel of this page …');
    const found = await checkDevice(device);
    known.check = found;
    tellCheck();
  } catch (error) {
    // What has failed once is opened anew.
    known.device = null;
    say('verdict', sentence(error), 'wrong');
  }
  ready();
}

/** A device that is lost computes nothing more; the next check opens another. */
function forget(device) {
  if (known.device !== device) return;
  known.device = known.check = null;
  say('verdict', device.fault.message, 'wrong');
  ready();
}

function tellCheck() {
  const { device, check } = known;
  const field = check.compared.find(row => row.what === 'displacement');
  const wrong = check.compared.filter(row => !row.agrees);
  if (check.agrees) {
    say('verdict', `Agrees: the displacement within ${power(field.difference)} px of that of the program ${ANSWER.version} on the CPU ` +
      `(allowed ${power(field.allowed)} px), all else within round-off.`, 'well');
  } else {
    const [worst] = [...wrong].sort((a, b) => b.difference / b.allowed - a.difference / a.allowed);
    say('verdict', `This device does not compute what the program computes on the CPU: ${wrong.length} of ${check.compared.length} kinds of ` +
      `numbers differ, most of all the ${worst.what} by ${power(worst.difference)} ${worst.unit}, where round-off allows ` +
      `${power(worst.allowed)}. It is not used here. Please send the report in.`, 'wrong');
  }
  const unit = row => row.unit || 'of the largest';
  table('compared', ['compared', 'largest difference', 'allowed', 'in'],
    check.compared.map(row => [row.what, power(row.difference), power(row.allowed), unit(row), row.agrees]));
  at('report').value = reportOf(device, check, known.result?.told);
  at('checked').hidden = false;
}

at('again').onclick = check;

at('copy').onclick = async () => {
  try {
    await navigator.clipboard.writeText(at('report').value);
    at('copied').textContent = 'Copied.';
  } catch {
    at('report').closest('details').open = true;
    at('report').select();
    at('copied').textContent = document.execCommand('copy') ? 'Copied.' : 'Copy the marked text by hand.';
  }
};

// ---- 2. The pair

/** Bits of a sample of a PNG file, 8 of anything else. */
async function depthOf(file) {
  const head = new Uint8Array(await file.slice(0, 26).arrayBuffer());
  return [0x89, 0x50, 0x4e, 0x47].every((byte, k) => head[k] === byte) ? head[24] : 8;
}

/** The grey levels of a file as src/io/images.rs reads them: equal channels as they are, colours as luminance. */
async function read(file) {
  const notes = [];
  if (await depthOf(file) > 8) notes.push('of 16 bits per pixel the browser keeps 8; the program reads all');
  let bitmap;
  try {
    bitmap = await createImageBitmap(file, { colorSpaceConversion: 'none', premultiplyAlpha: 'none' });
  } catch {
    throw new Fault(`${file.name} is no image that this browser reads.`);
  }
  const { width, height } = bitmap;
  const context = pixelContext(width, height);
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  const { data } = context.getImageData(0, 0, width, height);
  const n = width * height;
  let [coloured, clear] = [false, false];
  for (let k = 0; k < 4 * n; k += 4) {
    coloured ||= data[k] !== data[k + 1] || data[k + 1] !== data[k + 2];
    clear ||= data[k + 3] !== 255;
  }
  if (clear) throw new Fault(`${file.name} is transparent in places, where it has no grey level.`);
  const grey = coloured ? new Float32Array(n) : new Uint8Array(n);
  for (let k = 0; k < n; k++) {
    grey[k] = coloured ? 0.2126 * data[4 * k] + 0.7152 * data[4 * k + 1] + 0.0722 * data[4 * k + 2] : data[4 * k];
  }
  if (coloured) notes.push('colours become luminance');
  return { width, height, grey, name: file.name, notes };
}

/** A canvas to read pixels from. Some browsers give others than were put there, so that pages cannot know a machine again. */
function pixelContext(width, height) {
  const canvas = Object.assign(document.createElement('canvas'), { width, height });
  const context = canvas.getContext('2d', { willReadFrequently: true });
  if (!context) throw new Fault(`This browser has no canvas for ${width} x ${height} px.`);
  const [w, h] = [Math.min(width, 16), Math.min(height, 16)];
  const pattern = new ImageData(w, h);
  pattern.data.forEach((_, k) => { pattern.data[k] = k % 4 === 3 ? 255 : 37 * (k >> 2) % 256; });
  context.putImageData(pattern, 0, 0);
  const back = context.getImageData(0, 0, w, h).data;
  if (back.some((v, k) => v !== pattern.data[k])) {
    throw new Fault('This browser alters the pixels that a page reads (a protection against recognition): grey levels would be wrong. ' +
      'Allow this page to read the canvas, or use another browser.');
  }
  return context;
}

async function take(which, file) {
  try {
    const image = await read(file);
    known.pair[which] = image;
    const notes = image.notes.length ? ` (${image.notes.join('; ')})` : '';
    at(`drop-${which}`).querySelector('span').textContent = `${image.name}: ${image.width} x ${image.height} px${notes}`;
    say('status', '');
  } catch (error) {
    known.pair[which] = null;
    at(`drop-${which}`).querySelector('span').textContent = '';
    say('status', sentence(error), 'wrong');
  }
  // What is shown belongs to another pair.
  at('result').hidden = true;
  ready();
}

function ready() {
  const { pair: { reference, deformed }, check, busy } = known;
  at('again').disabled = busy;
  at('example').disabled = busy || !check?.agrees;
  at('go').disabled = at('example').disabled || !reference || !deformed;
}

for (const which of ['reference', 'deformed']) {
  const drop = at(`drop-${which}`);
  at(which).onchange = () => at(which).files.length && take(which, at(which).files[0]);
  drop.ondragover = event => { event.preventDefault(); drop.classList.add('over'); };
  drop.ondragleave = () => drop.classList.remove('over');
  drop.ondrop = async event => {
    event.preventDefault();
    drop.classList.remove('over');
    const files = [...event.dataTransfer.files].sort((a, b) => a.name.localeCompare(b.name, 'en', { numeric: true }));
    if (files.length > 1) {
      await take('reference', files[0]);
      await take('deformed', files[1]);
    } else if (files.length === 1) {
      await take(which, files[0]);
    }
  };
}

/** The example: waves across each other, moved by some 20 px, turned, stretched and bent. */
const EXAMPLE = { width: 641, height: 403 };

function exampleMotion(x, y) {
  const [dx, dy] = [x - 320, y - 200];
  return [17.3 + 0.012 * dx - 0.02 * dy + 0.8 * Math.sin(0.015 * y), -9.6 + 0.02 * dx - 0.004 * dy + 0.6 * Math.cos(0.02 * x)];
}

function exampleImage(moved) {
  const { width, height } = EXAMPLE;
  const waves = Array.from({ length: 24 }, (_, k) => {
    const [angle, length] = [2.399963 * k, 6 + 0.5 * k];
    return [2 * Math.PI / length * Math.cos(angle), 2 * Math.PI / length * Math.sin(angle), 1.7 * k * k];
  });
  const grey = new Uint8Array(width * height);
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      // Where the point was that is here now.
      let [px, py] = [x, y];
      for (let k = 0; moved && k < 12; k++) {
        const u = exampleMotion(px, py);
        [px, py] = [x - u[0], y - u[1]];
      }
      let sum = 0;
      for (const [kx, ky, phase] of waves) sum += Math.sin(kx * px + ky * py + phase);
      const level = 128 + 9 * sum;
      grey[y * width + x] = Math.round(Math.min(Math.max(moved ? 0.93 * level + 6 : level, 0), 255));
    }
  }
  return { width, height, grey, name: 'example', notes: [] };
}

at('example').onclick = async () => {
  say('status', 'The example is drawn …');
  await new Promise(done => setTimeout(done));
  known.pair = { reference: exampleImage(false), deformed: exampleImage(true) };
  for (const which of ['reference', 'deformed']) {
    at(which).value = '';
    at(`drop-${which}`).querySelector('span').textContent = `example: ${EXAMPLE.width} x ${EXAMPLE.height} px`;
  }
  await go();
};

at('go').onclick = () => go();

async function go() {
  const { device, pair } = known;
  const { reference, deformed } = pair;
  at('result').hidden = true;
  known.result = null;
  known.busy = true;
  ready();
  say('status', 'Correlating …');
  await new Promise(done => setTimeout(done)); // the words first
  try {
    const result = await correlate(device, reference, deformed, { size: Number(at('size').value) });
    if (known.pair.reference === reference && known.pair.deformed === deformed) {
      known.result = { ...result, reference };
      say('status', 'Converged.', 'well');
      show();
    } else {
      say('status', 'The pair was changed meanwhile: correlate it.');
    }
  } catch (error) {
    say('status', sentence(error), 'wrong');
  }
  known.busy = false;
  ready();
}

// ---- 3. The field

function show() {
  const { result } = known;
  const last = result.steps.at(-1);
  const rms = zone => Math.sqrt(Math.max(zone.rr / Math.max(zone.n, 1), 0));
  const per_cent = zone => `${(100 * rms(zone) / result.range).toFixed(2)} %`;
  const blank = result.elements.filter((_, e) => !isShown(e)).length;
  at('summary').textContent = `${result.grid.n_nodes} nodes, ${result.grid.n_elements} elements, ${result.n_levels} ` +
    `level${result.n_levels > 1 ? 's' : ''}. The correlation coefficient is ${result.matched.toFixed(4)}, the gain ` +
    `${last.zone.gain.toFixed(4)}, the residual ${rms(last.zone).toFixed(2)} grey levels, ${per_cent(last.zone)} of the range of the ` +
    `reference.${blank ? ` ${blank} elements are left blank: they do not match, see no texture, or have left the image.` : ''}` +
    exampleError();
  table('steps', ['level', 'iteration', 'correction, px', 'residual, grey levels', 'of the range'], result.steps.map(({ level, iteration,
    correction_px, zone }) => [level, iteration, power(correction_px), rms(zone).toFixed(3), per_cent(zone)]));
  const times = [...result.times, ['together', result.times.reduce((sum, [, time]) => sum + time, 0)]];
  table('times', ['stage', 'time'], times.map(([what, time]) => [what, ms(time)]));
  table('kernels', ['kernel', 'runs'], runs(result.runs));
  result.told = {
    width: result.reference.width, height: result.reference.height, nodes: result.grid.n_nodes, iterations: result.iterations,
    correction_px: last.correction_px, residual_grey: rms(last.zone), correlation: result.matched,
    ms: Object.fromEntries(result.times.map(([what, time]) => [what, Math.round(time)])),
  };
  at('report').value = reportOf(known.device, known.check, result.told);
  at('result').hidden = false;
  draw();
}

/** Of the example, whose motion is known: how far the nodes are off, but for those that have left the image. */
function exampleError() {
  const { reference, grid, displacement } = known.result;
  if (reference.name !== 'example') return '';
  let [sum, n] = [0, 0];
  grid.nodes().forEach(([x, y], node) => {
    const true_u = exampleMotion(x, y);
    const [px, py] = [x + true_u[0], y + true_u[1]];
    if (px < 16 || py < 16 || px > reference.width - 17 || py > reference.height - 17) return;
    sum += true_u.reduce((all, u, c) => all + (displacement[node][c] - u) ** 2, 0);
    n += 2;
  });
  return ` The motion of the example is known: the nodes are ${Math.sqrt(sum / n).toFixed(4)} px off it (root mean square).`;
}

/** Whether an element says anything: it is read, and matches. */
function isShown(e) {
  const { active, elements } = known.result;
  return active[e] && elements[e].n > 0 && elements[e].correlation > MATCHED;
}

/** Viridis, at nine places. */
const COLOURS = [[68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141], [39, 173, 129], [92, 200, 99], [170, 220, 50],
  [253, 231, 37]];

function colour(t) {
  const k = Math.min(Math.max(t, 0), 1) * (COLOURS.length - 1);
  const low = Math.min(Math.floor(k), COLOURS.length - 2);
  return COLOURS[low].map((v, c) => v + (k - low) * (COLOURS[low + 1][c] - v));
}

/** Displacement at a place of the reference; none where no element is shown. */
function valueAt(x, y) {
  const { grid, displacement } = known.result;
  if (x < grid.x0 || y < grid.y0 || x > grid.x0 + grid.nx * grid.hx || y > grid.y0 + grid.ny * grid.hy) return null;
  const { element, weights } = grid.locate([x, y]);
  if (!isShown(element)) return null;
  const corners = grid.corners(element);
  return { element, u: [0, 1].map(c => corners.reduce((sum, node, k) => sum + weights[k] * displacement[node][c], 0)) };
}

function draw() {
  const { grid, elements, displacement, reference: { width, height, grey } } = known.result;
  const component = Number(at('component').value);
  const opacity = Number(at('opacity').value) / 100;
  const shown = elements.map((_, e) => e).filter(isShown);
  let [least, most] = [Infinity, -Infinity];
  for (const node of shown.flatMap(e => grid.corners(e))) {
    least = Math.min(least, displacement[node][component]);
    most = Math.max(most, displacement[node][component]);
  }
  const share = u => most > least ? (u - least) / (most - least) : 0.5;
  const table = Array.from({ length: 256 }, (_, k) => colour(k / 255));
  const picture = new ImageData(width, height);
  for (let k = 0; k < width * height; k++) picture.data.fill(grey[k], 4 * k, 4 * k + 3).fill(255, 4 * k + 3, 4 * k + 4);
  for (const e of shown) {
    const { corner: [x0, y0], size: [nx, ny], local: [xi0, dxi, eta0, deta] } = grid.element(e, width, height);
    const [a, b, c, d] = grid.corners(e).map(node => share(displacement[node][component]));
    for (let row = 0; row < ny; row++) {
      const eta = eta0 + row * deta;
      for (let column = 0; column < nx; column++) {
        const xi = xi0 + column * dxi;
        const t = (1 - eta) * ((1 - xi) * a + xi * b) + eta * ((1 - xi) * d + xi * c);
        const k = (y0 + row) * width + x0 + column;
        const [red, green, blue] = table[Math.round(255 * Math.min(Math.max(t, 0), 1))];
        const below = (1 - opacity) * grey[k];
        picture.data[4 * k] = below + opacity * red;
        picture.data[4 * k + 1] = below + opacity * green;
        picture.data[4 * k + 2] = below + opacity * blue;
      }
    }
  }
  const map = at('map');
  Object.assign(map, { width, height });
  map.getContext('2d').putImageData(picture, 0, 0);
  const bar = new ImageData(1, 256);
  for (let k = 0; k < 256; k++) bar.data.set([...colour(1 - k / 255), 255], 4 * k);
  at('bar').getContext('2d').putImageData(bar, 0, 0);
  at('most').textContent = `${most.toFixed(3)} px`;
  at('least').textContent = `${least.toFixed(3)} px`;
}

at('component').onchange = draw;
at('opacity').oninput = draw;

at('map').onpointermove = event => {
  const box = at('map').getBoundingClientRect();
  const { width, height } = at('map');
  const [x, y] = [(event.clientX - box.left) * width / box.width - 0.5, (event.clientY - box.top) * height / box.height - 0.5];
  const value = valueAt(x, y);
  const place = `x ${x.toFixed(0)}, y ${y.toFixed(0)} px`;
  if (!value) {
    at('readout').textContent = `${place}: not measured here`;
    return;
  }
  const { residual_rms } = known.result.elements[value.element];
  at('readout').textContent = `${place}: u_x ${value.u[0].toFixed(4)} px, u_y ${value.u[1].toFixed(4)} px, residual of the element ` +
    `${residual_rms.toFixed(2)} grey levels`;
};

if (typeof SHADERS === 'undefined' || typeof ANSWER === 'undefined' || typeof Device === 'undefined') {
  say('verdict', 'The files beside this page are missing: all of the folder web/ is needed.', 'wrong');
} else {
  at('version').textContent = ANSWER.version;
  check();
}
