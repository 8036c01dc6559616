// Whether this device computes what the program computes on the CPU: a small pair of images through the kernels, and their numbers
// beside those of answer.js. Twins: src/backend/check.rs; tests/correlation/web.rs writes answer.js.
'use strict';

/** The images of answer.js. */
function answerImages() {
  const { width, height } = ANSWER;
  const bytes = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  return [ANSWER.reference, ANSWER.deformed].map(text => ({ width, height, grey: bytes(text) }));
}

/** The numbers that this device finds, by their names in answer.js. */
async function numbersOf(device) {
  const found = {};
  const [reference, deformed] = answerImages();
  const [before, after] = [reference, deformed].map(image => new Frame(device, image, rangeOf(reference)));
  const grid = Grid.on(ANSWER.zone, ANSWER.element);
  const moments = ({ moments }, elements) => elements.flatMap(e => [...moments.subarray(MOMENTS * e, MOMENTS * e + 27)]);
  const all = ({ n_elements }) => Array.from({ length: n_elements }, (_, e) => e);
  const everywhere = (grid, u) => new Array(grid.n_nodes).fill(u);
  const ready = async (level, grid) => {
    const prepared = await Level.of(device, before, level, grid);
    return prepared.solve(new Array(grid.n_nodes).fill(true));
  };

  const coarse = await ready(1, grid.halved(ANSWER.element));
  found['moments of elements, level 1'] = moments(coarse, all(coarse.grid));
  const { starts: [start, coarse_start], transfer } = ANSWER;
  let field = new Field(device, coarse, after, { start: everywhere(coarse.grid, coarse_start), transfer });
  await field.observe();
  found['right-hand side, level 1'] = await field.rightHandSide();
  for (let step = 0; step < ANSWER.steps; step++) await field.step([1, 0]);
  found['displacement, level 1'] = (await field.found()).displacement.flat();

  const fine = await ready(0, grid);
  found['moments of elements'] = moments(fine, all(grid));
  fine.link(coarse);
  field = new Field(device, fine, after, { coarse: field, moved: true });
  found['displacement of a start'] = (await field.found()).displacement.flat();
  field.place(everywhere(grid, start));
  const zone = await field.observe();
  found['sums of the zone'] = ['n', 'f', 'ff', 'g', 'gg', 'fg'].map(name => zone[name]);
  found['residual of the zone'] = [zone.rr];
  found['right-hand side'] = await field.rightHandSide();
  const left = await field.remaining();
  found['moments of elements that have lost pixels'] = moments(left, left.lost);
  for (let step = 0; step < ANSWER.steps; step++) await field.step([1, 0]);
  const { displacement, elements } = await field.found();
  found['match of elements'] = elements.flatMap(e => [e.correlation, e.n / ANSWER.element ** 2]);
  found.displacement = displacement.flat();
  return found;
}

/** Compares the device with the stored answer. */
async function checkDevice(device) {
  const began = performance.now();
  device.runs = {};
  try {
    const found = await numbersOf(device);
    const compared = ANSWER.numbers.map(({ what, unit, allowed, values }) => {
      const scale = unit === 'px' ? 1 : values.reduce((most, v) => Math.max(most, Math.abs(v)), Number.MIN_VALUE);
      const apart = (v, k) => Number.isFinite(found[what][k]) ? Math.abs(found[what][k] - v) / scale : Infinity;
      const difference = found[what].length === values.length ? values.reduce((most, v, k) => Math.max(most, apart(v, k)), 0) : Infinity;
      return { what, unit, difference, allowed, agrees: difference <= allowed };
    });
    return { agrees: compared.every(row => row.agrees), compared, ms: performance.now() - began, runs: { ...device.runs } };
  } finally {
    device.release();
  }
}

/** What a volunteer can send in. */
function reportOf(device, check, measured) {
  const infinite = v => Number.isFinite(v) ? v : String(v); // JSON has no infinity
  return JSON.stringify({
    report: 'quadrille web check', version: ANSWER.version, at: new Date().toISOString(), browser: navigator.userAgent,
    adapter: device.info,
    agrees: check.agrees,
    compared: check.compared.map(row => ({ ...row, difference: infinite(row.difference) })),
    ms: { compile: Math.round(device.compileMs), check: Math.round(check.ms) },
    kernels: check.runs, measured, features: device.features, limits: device.limits,
  }, null, 1);
}
