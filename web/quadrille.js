// The correlation of two images: what the program's host does beside the kernels, for one rectangle, cubic splines, and one gain
// and offset. Pixels are touched by kernels alone, but for the search of a start on a small image.
// Twins: src/backend/gpu/plane.rs, level.rs, field.rs, solver.rs; src/correlate/.
'use strict';

const POLE = Math.sqrt(3) - 2;
// Of the prefilter: src/backend/gpu/plane.rs.
const [HALO, MOST_START] = [16, 32];
const { BORDER, SUMS, N } = SHADERS.residual.constants;
const { MOMENTS } = SHADERS.normal_matrix.constants;
const { ROOM } = SHADERS.tally.constants;
/** Elements summed by a workgroup of the tally, and nodes by one of the solver. */
const TOGETHER = 256;
/** Iterations of the conjugate gradients, at least and at most, and what they are to reach. */
const LEAST_CG = 4;
const MOST_CG = 32;
const REDUCTION = 3e-2;
/** The same where elements have lost pixels, which are the last to settle. */
const REDUCTION_CHANGED = 3e-3;

// ---- Images

/** Values with a border, of which rows begin where they do in the program. */
class Plane {
  constructor(device, width, height) {
    [this.width, this.height] = [width, height];
    this.stride = 64 * Math.ceil((width + 2 * BORDER) / 64);
    this.origin = BORDER * this.stride + BORDER;
    this.buffer = device.buffer(4 * this.stride * (height + 2 * BORDER), `an image of ${width} x ${height} px`);
  }
}

/** Weights of the samples in the first causal value of the prefilter: `causal_start` in src/backend/spline.rs. */
function causalStart(pole, n) {
  if (n < 2) return new Array(n).fill(1);
  const horizon = Math.ceil(Math.log(1e-10) / Math.log(Math.abs(pole)));
  const last = n - 1;
  const weights = new Array(last < horizon ? n : horizon + 1).fill(0);
  for (let k = 0; k <= horizon; k++) {
    let [at, sign] = [-k, 1];
    const power = pole ** k;
    while (at < 0 || at > last) {
      const [end, through] = at < 0 ? [0, 0] : [last, 2 * last];
      weights[end] += 2 * sign * power;
      sign = -sign;
      at = through - at;
    }
    weights[at] += sign * power;
  }
  return weights;
}

/** Unit of a gradient as a whole 16-bit number, of an image with this range of grey levels: `gradient_unit` in src/backend/mod.rs. */
function gradientUnit(range) {
  const exponent = Math.ceil(Math.log2(2 * range / 32767));
  return Number.isFinite(exponent) ? 2 ** Math.min(Math.max(exponent, -100), 100) : 1;
}

/** An image on the device, its halvings, and their spline coefficients, each made when first asked for. */
class Frame {
  /** `image`: width, height and grey, a Uint8Array or a Float32Array; `range`: the grey levels of the reference, `KernelOptions::new` in src/backend/mod.rs. */
  constructor(device, image, [low, high]) {
    Object.assign(this, { device, image, offset: Math.fround(0.5 * (low + high)), unit: gradientUnit(high - low), greys: [], splines: [] });
  }

  grey(level) {
    if (!this.greys[level]) this.greys[level] = level === 0 ? this.unpack() : this.halve(this.grey(level - 1));
    return this.greys[level];
  }

  unpack() {
    const { device, offset, image: { width, height, grey } } = this;
    const depth = grey.BYTES_PER_ELEMENT;
    const bytes = new Uint8Array(4 * Math.ceil(grey.byteLength / 4));
    bytes.set(new Uint8Array(grey.buffer, grey.byteOffset, grey.byteLength));
    const raw = device.filled(bytes, 'the pixels of an image');
    const plane = new Plane(device, width, height);
    const constants = { width, rows: height, stride: plane.stride, depth, skip: 0, first: plane.origin, offset };
    const kernel = device.bound('unpack', [device.uniform('Unpack', constants), raw, plane.buffer], Math.ceil(width / 64), height);
    device.record().run(kernel).submit();
    return plane;
  }

  halve(fine) {
    const { device } = this;
    const plane = new Plane(device, fine.width >> 1, fine.height >> 1);
    const constants = {
      width: plane.width, rows: plane.height, fine_stride: fine.stride, coarse_stride: plane.stride,
      fine_first: fine.origin, coarse_first: plane.origin,
    };
    const buffers = [device.uniform('Downsample', constants), fine.buffer, plane.buffer];
    device.record().run(device.bound('downsample', buffers, Math.ceil(plane.width / 64), plane.height)).submit();
    return plane;
  }

  /** The coefficients of the cubic spline: along columns, along rows, and the border. */
  coefficients(level) {
    if (this.splines[level]) return this.splines[level];
    const { device } = this;
    const grey = this.grey(level);
    const { width, height, stride } = grey;
    const [between, plane] = [new Plane(device, height, width), new Plane(device, width, height)];
    const { LINES, LENGTH } = SHADERS.prefilter.constants;
    const amplitude = (1 - POLE) / (1 + POLE);
    const filter = (from, to) => {
      const start = causalStart(POLE, from.height).flatMap(weight => [weight, 0]);
      const constants = {
        n: from.height, left: 0, right: from.width, top: 0, bottom: from.height,
        source_stride: from.stride, target_stride: to.stride, source_first: from.origin, target_first: to.origin,
        n_start: start.length / 2, halo: HALO, own: -amplitude, poles: [POLE, 0], amplitudes: [amplitude, 0],
        start: [...start, ...new Array(2 * MOST_START - start.length).fill(0)],
      };
      const buffers = [device.uniform('Prefilter', constants), from.buffer, to.buffer];
      return device.bound('prefilter', buffers, Math.ceil(from.width / LINES), Math.ceil(from.height / LENGTH));
    };
    const border = begin => device.uniform('Border', { width, height, stride, first: 0, begin, end: height });
    const rows = begin => device.bound('border_rows', [border(begin), plane.buffer], Math.ceil((width + 2 * BORDER) / 64));
    device.record().run(
      filter(grey, between),
      filter(between, plane),
      device.bound('border_columns', [border(0), plane.buffer], Math.ceil(height / 64)),
      rows(0),
      rows(1),
    ).submit();
    return this.splines[level] = plane;
  }

  /** Grey levels of a level on the host, less the offset. */
  async onHost(level) {
    const { width, height, stride, origin, buffer } = this.grey(level);
    const [bytes] = await this.device.record().fetch([buffer, 4 * stride * (height + 2 * BORDER)]);
    const all = new Float32Array(bytes);
    const values = new Float32Array(width * height);
    for (let y = 0; y < height; y++) values.set(all.subarray(origin + y * stride, origin + y * stride + width), y * width);
    return { width, height, values };
  }
}

// ---- Meshes

/** A grid of elements on a rectangle, nodes and elements numbered row by row. */
class Grid {
  constructor(x0, y0, hx, hy, nx, ny) {
    Object.assign(this, { x0, y0, hx, hy, nx, ny });
    this.n_nodes = (nx + 1) * (ny + 1);
    this.n_elements = nx * ny;
  }

  /** As many whole elements of `size` px as fit. */
  static on([x0, y0, x1, y1], size) {
    const [nx, ny] = [Math.floor((x1 - x0) / size), Math.floor((y1 - y0) / size)];
    if (nx < 1 || ny < 1) throw new Fault(`The image is smaller than one element of ${size} px.`);
    return new Grid(x0, y0, size, size, nx, ny);
  }

  /** The same rectangle on the image of half the size: `halved` in src/mesh/lay.rs. */
  halved(size) {
    const [width, height] = [0.5 * this.nx * this.hx, 0.5 * this.ny * this.hy];
    const count = length => Math.max(1, Math.floor(length / size));
    const [nx, ny] = [count(width), count(height)];
    return new Grid(0.5 * (this.x0 - 0.5), 0.5 * (this.y0 - 0.5), width / nx, height / ny, nx, ny);
  }

  node(at) {
    return [this.x0 + at % (this.nx + 1) * this.hx, this.y0 + Math.floor(at / (this.nx + 1)) * this.hy];
  }

  nodes() {
    return Array.from({ length: this.n_nodes }, (_, at) => this.node(at));
  }

  corners(element) {
    const at = Math.floor(element / this.nx) * (this.nx + 1) + element % this.nx;
    return [at, at + 1, at + this.nx + 2, at + this.nx + 1];
  }

  /** The element at a place, or nearest to it, and the shape functions of its corners there. */
  locate([x, y]) {
    const along = (v, from, h, n) => {
      const t = Math.min(Math.max((v - from) / h, 0), n);
      const cell = Math.min(Math.floor(t), n - 1);
      return [cell, t - cell];
    };
    const [[i, xi], [j, eta]] = [along(x, this.x0, this.hx, this.nx), along(y, this.y0, this.hy, this.ny)];
    const weights = [(1 - xi) * (1 - eta), xi * (1 - eta), xi * eta, (1 - xi) * eta];
    return { element: j * this.nx + i, weights };
  }

  /** An element as kernels see it: the pixels whose centre lies in it. */
  element(at, width, height) {
    const [i, j] = [at % this.nx, Math.floor(at / this.nx)];
    const first = (from, h, k, n) => Math.min(Math.max(Math.ceil(from + k * h), 0), n);
    const [x, x1] = [first(this.x0, this.hx, i, width), first(this.x0, this.hx, i + 1, width)];
    const [y, y1] = [first(this.y0, this.hy, j, height), first(this.y0, this.hy, j + 1, height)];
    const local = [(x - this.x0 - i * this.hx) / this.hx, 1 / this.hx, (y - this.y0 - j * this.hy) / this.hy, 1 / this.hy];
    return { nodes: this.corners(at), corner: [x, y], size: [x1 - x, y1 - y], local, first_run: 0, n_runs: 0, zone: 0 };
  }
}

// ---- The normal matrix, in double precision

/** Rows of 2 x 2 blocks, on the pattern of a mesh. */
class BlockMatrix {
  constructor(grid, moments, keep) {
    const n = grid.n_nodes;
    this.n = n;
    const rows = Array.from({ length: n }, () => new Map());
    // Whether corner a is at the far end along xi and along eta.
    const FAR = [[0, 0], [1, 0], [1, 1], [0, 1]];
    for (let e = 0; e < grid.n_elements; e++) {
      const nodes = grid.corners(e);
      for (let a = 0; a < 4; a++) {
        for (let b = 0; b < 4; b++) {
          const row = rows[nodes[a]];
          if (!row.has(nodes[b])) row.set(nodes[b], [0, 0, 0, 0]);
          if (!keep[nodes[a]] || !keep[nodes[b]]) continue;
          const block = row.get(nodes[b]);
          // Product of the gradient's components, weight in eta, weight in xi.
          const at = MOMENTS * e + 3 * (FAR[a][1] + FAR[b][1]) + FAR[a][0] + FAR[b][0];
          for (let c = 0; c < 4; c++) block[c] += moments[at + 9 * ((c >> 1) + (c & 1))];
        }
      }
    }
    this.starts = [0];
    this.columns = [];
    const blocks = [];
    for (const row of rows) {
      for (const column of [...row.keys()].sort((a, b) => a - b)) {
        this.columns.push(column);
        blocks.push(...row.get(column));
      }
      this.starts.push(this.columns.length);
    }
    this.blocks = Float64Array.from(blocks);
    this.diagonals = rows.map((row, node) => row.get(node));
    this.jacobi = this.diagonals.map(([xx, xy, , yy], node) => {
      const determinant = xx * yy - xy * xy;
      return keep[node] && determinant > 0 ? [yy / determinant, -xy / determinant, xx / determinant] : [0, 0, 0];
    });
  }

  times(v) {
    const { starts, columns, blocks } = this;
    const out = new Float64Array(2 * this.n);
    for (let i = 0; i < this.n; i++) {
      for (let k = starts[i]; k < starts[i + 1]; k++) {
        const j = 2 * columns[k];
        out[2 * i] += blocks[4 * k] * v[j] + blocks[4 * k + 1] * v[j + 1];
        out[2 * i + 1] += blocks[4 * k + 2] * v[j] + blocks[4 * k + 3] * v[j + 1];
      }
    }
    return out;
  }

  preconditioned(r) {
    const z = new Float64Array(r.length);
    this.jacobi.forEach(([xx, xy, yy], i) => {
      z[2 * i] = xx * r[2 * i] + xy * r[2 * i + 1];
      z[2 * i + 1] = xy * r[2 * i] + yy * r[2 * i + 1];
    });
    return z;
  }

  /** Iterations that a right-hand side without any order needs: `trial_iterations` in src/linalg/solver.rs. */
  trialIterations(reduction) {
    const noise = k => (Math.imul(k, 2654435769) >>> 16) / 32768 - 1;
    const dot = (a, b) => a.reduce((sum, v, k) => sum + v * b[k], 0);
    let r = Float64Array.from({ length: 2 * this.n }, (_, k) => noise(k + 1));
    this.jacobi.forEach(([xx], i) => { if (xx === 0) r[2 * i] = r[2 * i + 1] = 0; });
    let p = this.preconditioned(r);
    let rz = dot(r, p);
    const goal = reduction * reduction * rz;
    let done = 0;
    for (; done < MOST_CG && rz > goal && rz > 0; done++) {
      const q = this.times(p);
      const pq = dot(p, q);
      if (pq <= 0) break;
      r = r.map((v, k) => v - rz / pq * q[k]);
      const z = this.preconditioned(r);
      const next = dot(r, z);
      p = z.map((v, k) => v + next / rz * p[k]);
      rz = next;
    }
    return Math.max(done, LEAST_CG);
  }
}

// ---- The reference at one scale

class Level {
  /** Grey levels and gradient of the reference, and the moments of the elements. */
  static async of(device, frame, level, grid) {
    const self = new Level();
    const { width, height, stride, origin, buffer: grey } = frame.grey(level);
    const coefficients = frame.coefficients(level);
    const reference = device.buffer(8 * stride * height, `a reference of ${width} x ${height} px`);
    const constants = {
      width, rows: height, stride, grey_first: origin, coefficients_first: origin, reference_first: 0, per_unit: 1 / frame.unit,
      value: [0, 1 / 6, 4 / 6, 1 / 6, 0, 0, 0, 0], derivative: [0, -0.5, 0, 0.5, 0, 0, 0, 0],
    };
    const groups = [Math.ceil(width / 64), Math.ceil(height / SHADERS.gradient.constants.ROWS)];
    device.record().run(
      device.bound('gradient', [device.uniform('Gradient', constants), grey, coefficients.buffer, reference], ...groups)).submit();
    const elements = Array.from({ length: grid.n_elements }, (_, at) => grid.element(at, width, height));
    Object.assign(self, { device, level, grid, width, height, stride, reference, elements, unit: frame.unit });
    self.active = new Array(grid.n_elements).fill(true);
    self.element_buffer = device.filled(packed('Element', elements), 'the elements');
    self.moments = await self.sumMoments();
    self.prepare();
    return self;
  }

  pass(n_listed, weighted = 0) {
    const [LEAST, MOST] = [-(2 ** 31), 2 ** 31 - 1];
    return this.device.uniform('Pass', {
      image: [this.width, this.height], stride: this.stride, n_elements: this.grid.n_elements,
      reference_first: 0, elements_from: LEAST, elements_to: MOST, deformed_first: 0, floors_from: LEAST, floors_to: MOST,
      own_transfer: 0, accumulate: 0, n_listed, runs_at: 0, points_at: 0, weighted, unit: this.unit,
    });
  }

  /** Moments of all elements; with a field, of their pixels inside the deformed image. */
  async sumMoments(displacement) {
    const { device, grid } = this;
    const n = grid.n_elements;
    const list = device.filled(Uint32Array.from({ length: n }, (_, at) => at), 'numbers of elements');
    const results = device.buffer(4 * MOMENTS * n, 'moments of the elements');
    const none = () => device.buffer(16, 'nothing');
    const pass = this.pass(n, Number(Boolean(displacement)));
    const buffers = [pass, this.reference, this.element_buffer, displacement ?? none(), none(), list, results];
    const kernel = device.bound('normal_matrix', buffers, Math.ceil(n / 4));
    const [bytes] = await device.record().run(kernel).fetch([results, 4 * MOMENTS * n]);
    // Products of gradients were summed in their unit.
    return new Float32Array(bytes).map((sum, k) => k % MOMENTS < 27 ? sum * this.unit ** 2 : sum);
  }

  /** Pixels of an element. */
  pixels(element) {
    return this.moments[MOMENTS * element + 27];
  }

  /** What depends on the elements that are used. */
  prepare() {
    const { device, grid } = this;
    const n = grid.n_elements;
    const whole = new Float32Array(4 * n);
    for (let e = 0; e < n; e++) whole.set(this.moments.subarray(MOMENTS * e + 27, MOMENTS * e + 30), 4 * e);
    this.whole = device.filled(whole, 'sums of the elements');
    const n_groups = Math.ceil(n / TOGETHER);
    const groups = Array.from({ length: n_groups }, (_, k) => ({ first: k * TOGETHER, count: Math.min(TOGETHER, n - k * TOGETHER) }));
    this.n_groups = n_groups;
    this.groups = device.filled(packed('Group', groups), 'groups of elements');
    this.zone_groups = device.filled(packed('ZoneGroups', { first: 0, count: n_groups, n_elements: n }), 'zones');
    const { KEPT_PX, KEPT_SHARE, KEPT_MOST, BACK_MORE, STAYS_OUT } = CONSTANTS;
    const kept_share = Math.min(Math.max(KEPT_PX / Math.sqrt(grid.hx * grid.hy), KEPT_SHARE), KEPT_MOST);
    this.tally = device.uniform('Tally', {
      n_elements: n, n_groups, kept_share, back_share: Math.min(kept_share + BACK_MORE, 1),
      lossy_share: 1 - CONSTANTS.LOST_SHARE, own_transfer: 0, stays_out: STAYS_OUT,
    });
    // Where each node's elements begin, then 4 element + corner.
    const of_node = Array.from({ length: grid.n_nodes }, () => []);
    for (let e = 0; e < n; e++) grid.corners(e).forEach((node, corner) => of_node[node].push(4 * e + corner));
    const starts = [grid.n_nodes + 1];
    of_node.forEach(list => starts.push(starts[starts.length - 1] + list.length));
    this.incidence = device.filled(Uint32Array.from([...starts, ...of_node.flat()]), 'the elements of the nodes');
    this.gather = device.uniform('Gather', { n_nodes: grid.n_nodes });
    this.report = device.uniform('Report', { n_elements: n, n_nodes: grid.n_nodes });
  }

  /** Leaves elements out of all sums. */
  restrict() {
    this.active.forEach((active, e) => {
      if (active) return;
      Object.assign(this.elements[e], { corner: [0, 0], size: [0, 0], local: [0, 0, 0, 0] });
      this.moments.fill(0, MOMENTS * e, MOMENTS * (e + 1));
    });
    this.device.write(this.element_buffer, packed('Element', this.elements));
    this.prepare();
  }

  /** Where the nodes lie in the next coarser level. */
  link(coarse) {
    const places = this.grid.nodes().map(at => {
      const { element, weights } = coarse.grid.locate(at.map(v => 0.5 * (v - 0.5)));
      return { nodes: coarse.grid.corners(element), weights };
    });
    this.places = this.device.filled(packed('Place', places), 'places of the nodes');
  }

  /** What all frames are solved with: the matrix of the nodes that are kept. */
  solve(keep) {
    this.keep = keep;
    this.solver = this.solverOf(this.moments, REDUCTION);
    return this;
  }

  /** Makes the matrix of these moments, and brings it to the device. */
  solverOf(moments, reduction) {
    const { device, grid: { n_nodes } } = this;
    const matrix = new BlockMatrix(this.grid, moments, this.keep);
    const places = [...matrix.starts.map(start => n_nodes + 1 + start), ...matrix.columns];
    const n_partial = Math.ceil(n_nodes / TOGETHER);
    const constants = iteration => device.uniform('Cg', { n_nodes, iteration, n_partial, first_node: 0, last_node: n_nodes, first_block: 0 });
    return {
      n_partial,
      pattern: device.filled(Uint32Array.from(places), 'the pattern of the normal matrix'),
      blocks: device.filled(Float32Array.from(matrix.blocks), 'the normal matrix'),
      jacobi: device.filled(Float32Array.from(matrix.jacobi.flatMap(block => [...block, 0])), 'the nodal blocks'),
      iterations: Array.from({ length: matrix.trialIterations(reduction) }, (_, k) => constants(k)),
    };
  }
}

// ---- A field under iteration

/** Displacements as whole pixels and the rest, so that no digit is lost to a large motion. */
function displacements(list) {
  return packed('Displacement', list.map(u => {
    const whole = u.map(v => Math.min(Math.max(Math.floor(v), -1e6), 1e6));
    return { whole, rest: [u[0] - whole[0], u[1] - whole[1]] };
  }));
}

/** That there were no corrections before: shaders/correct.wgsl. */
const NOTHING = 0xffffffff;
/** Whether nodes are relaxed in a step from a start, the first of which is 1: src/backend/relaxation.rs. */
const isRelaxed = step => step >= 2 && step <= 8;

class Field {
  /** At `start`, one displacement per node, and `transfer`, gain and offset; or where a field of the coarser level is. */
  constructor(device, level, frame, { start, transfer = [1, 0], coarse, moved }) {
    Object.assign(this, { device, level, evaluated: false, corrected: false, steps: 0 });
    const { n_nodes, n_elements } = level.grid;
    const nodal = (bytes, what) => device.buffer(bytes * n_nodes, what);
    this.displacement = nodal(16, 'a field');
    this.before = nodal(16, 'a field');
    this.began = nodal(16, 'a field');
    this.transfer = device.buffer(8, 'gain and offset');
    this.began_transfer = device.buffer(8, 'gain and offset');
    this.sums = device.buffer(4 * SUMS * n_elements, 'sums of the elements');
    this.group_sums = device.buffer(4 * ROOM * level.n_groups, 'sums of groups of elements');
    this.zones = device.buffer(LAYOUTS.Zone.size, 'sums of the zone');
    this.step_report = device.buffer(LAYOUTS.Step.size, 'a report');
    this.node_groups = Math.ceil(n_nodes / TOGETHER);
    this.worst = device.buffer(8 * this.node_groups, 'corrections');
    this.change = device.buffer(8, 'change of light');
    this.groups = device.buffer(16, 'workgroups of the next step');
    // Corrections before the last evaluation and after it, in turns in two halves.
    this.relaxation = nodal(32, 'corrections');
    this.node_zone = device.buffer(4 * n_nodes, 'the zone of the nodes'); // the first one
    const record = device.record();
    if (coarse) {
      const [from, light] = moved ? [coarse.displacement, coarse.transfer] : [coarse.began, coarse.began_transfer];
      record.copy(light, this.transfer, 8);
      record.run(device.bound('prolong', [level.places, from, this.displacement], this.node_groups));
    } else {
      device.write(this.displacement, displacements(start));
      device.write(this.transfer, Float32Array.from(transfer));
    }
    record.copy(this.displacement, this.began, 16 * n_nodes).copy(this.transfer, this.began_transfer, 8).submit();
    const pixels = [
      level.pass(0), level.reference, frame.coefficients(level.level).buffer, level.element_buffer,
      this.displacement, this.transfer, this.sums,
    ];
    const tally = [level.tally, level.groups, level.whole, this.sums, this.transfer, this.group_sums];
    this.evaluation = [
      device.bound('residual', pixels, Math.ceil(n_elements / (64 / OVERRIDES.residual.LANES))),
      device.bound('tally', tally, level.n_groups),
    ];
    this.use(level.solver);
  }

  /** From now on corrects by this solver: the right-hand side, then every iteration, with no word from the host in between. */
  use(solver) {
    const { device, level: { gather, incidence, grid: { n_nodes } } } = this;
    const vector = () => device.buffer(8 * n_nodes, 'a vector of the nodes');
    const [residual, preconditioned, solution, image, ...directions] = Array.from({ length: 6 }, vector);
    const products = device.buffer(4 * (2 * MOST_CG + 1) * solver.n_partial, 'sums of the solver');
    Object.assign(this, { right_hand_side: residual, solution });
    const kernels = [device.bound('gather',
      [gather, incidence, this.sums, solver.jacobi, residual, preconditioned, solution, products], this.node_groups)];
    solver.iterations.forEach((constants, k) => {
      const [before, now] = [directions[k % 2], directions[(k + 1) % 2]];
      kernels.push(
        device.bound('cg_product',
          [constants, solver.pattern, solver.blocks, preconditioned, before, now, image, products], this.node_groups),
        device.bound('cg_update',
          [constants, solver.jacobi, now, image, solution, residual, preconditioned, products], this.node_groups));
    });
    this.solving = kernels;
  }

  /** The sums of the zone, its gain and offset, and what a step reports. */
  summary() {
    const constants = { n_zones: 1, brightness: 1, first: Number(!this.evaluated), at: 0 };
    this.evaluated = true;
    const { device, level } = this;
    return device.bound('summary', [device.uniform('Summary', constants), level.zone_groups, this.group_sums,
      this.transfer, this.zones, this.step_report, this.change], 1);
  }

  /** The largest correction. No step follows before this one has been looked at. */
  largest() {
    const none = { at: 0, lost: 0, n_sizes: 0, correction: [0, 0], counted: [0, 0], sizes: [] };
    const constants = this.device.uniform('Largest', { n_worst: this.node_groups, ...none });
    return this.device.bound('largest', [constants, this.worst, this.step_report, this.groups], 1);
  }

  /** The sums at the field as it is. */
  async observe() {
    this.corrected = false;
    const record = this.device.record().run(this.evaluation, this.summary());
    const [zone] = await record.fetch([this.zones, LAYOUTS.Zone.size]);
    return unpacked('Zone', zone);
  }

  /** The right-hand side of the last evaluation, as one list. */
  async rightHandSide() {
    const bytes = 8 * this.level.grid.n_nodes;
    const [rhs] = await this.device.record().run(this.solving[0]).fetch([this.right_hand_side, bytes]);
    return Array.from(new Float32Array(rhs));
  }

  /** Puts the field somewhere else. */
  place(start) {
    this.device.write(this.displacement, displacements(start));
    Object.assign(this, { corrected: false, steps: 0 });
  }

  /** One Gauss-Newton step; `scale` is the damping times cosine and sine of the angle that the correction is turned by. */
  step(scale) {
    this.steps += 1;
    return this.correct(this.device.record().run(this.evaluation, this.summary()), scale);
  }

  /** The correction of the last step taken back, and another one made from the same sums. */
  solveAgain(scale) {
    return this.correct(this.device.record().copy(this.before, this.displacement, 16 * this.level.grid.n_nodes), scale);
  }

  async correct(record, [cos, sin]) {
    const { device, level: { grid: { n_nodes } } } = this;
    const [before, first] = [this.steps - 1, this.steps].map(step => step % 2 * n_nodes);
    const before_first = isRelaxed(this.steps) ? before : NOTHING;
    // Light that flickers is no matter for a single pair: its change is not solved with the displacement.
    const correct = device.uniform('Correct', { n_nodes, cos, sin, coupled: 0, before_first, first });
    const [report, zone] = await record
      .run(this.solving)
      .run(device.bound('correct', [
        correct, this.solution, this.displacement, this.worst, this.change, this.node_zone, this.change, this.relaxation,
        this.before,
      ], this.node_groups), this.largest())
      .fetch([this.step_report, LAYOUTS.Step.size], [this.zones, LAYOUTS.Zone.size]);
    const [worst] = new Float32Array(report, LAYOUTS.Step.fields.worst[0], 1);
    this.corrected = true;
    return { ...unpacked('Step', report), correction_px: worst, zone: unpacked('Zone', zone) };
  }

  /** Moments of all elements, of those that have lost pixels at the last evaluation only what is left, and which these are. */
  async remaining() {
    const { level } = this;
    const { n_elements } = level.grid;
    const left = await level.sumMoments(this.corrected ? this.before : this.displacement);
    const [bytes] = await this.device.record().fetch([this.sums, 4 * SUMS * n_elements]);
    const sums = new Float32Array(bytes);
    const moments = level.moments.slice();
    const lost = [];
    for (let e = 0; e < n_elements; e++) {
      const n = sums[SUMS * e + N];
      if (n >= level.pixels(e)) continue;
      lost.push(e);
      // What is left of an element that counts no more is nothing.
      if (n > 0) moments.set(left.subarray(MOMENTS * e, MOMENTS * (e + 1)), MOMENTS * e);
      else moments.fill(0, MOMENTS * e, MOMENTS * (e + 1));
    }
    return { moments, lost };
  }

  /** What the iteration has found. */
  async found() {
    const { device, level } = this;
    const { n_elements, n_nodes } = level.grid;
    const bytes = 8 * n_elements + 12 * n_nodes;
    const results = device.buffer(bytes, 'results');
    const kernel = device.bound('residual_map', [level.report, level.whole, this.sums, this.displacement, results],
      Math.ceil(Math.max(n_elements, n_nodes) / TOGETHER));
    const [buffer, zone] = await device.record().run(kernel).fetch([results, bytes], [this.zones, LAYOUTS.Zone.size]);
    const view = new DataView(buffer);
    const short = at => view.getInt16(at, true);
    const elements = Array.from({ length: n_elements }, (_, e) => ({
      n: short(8 * e + 4) / 32767 * level.pixels(e),
      residual_rms: view.getFloat32(8 * e, true),
      correlation: short(8 * e + 6) / 32767,
    }));
    const displacement = Array.from({ length: n_nodes }, (_, node) => {
      const at = 8 * n_elements + 12 * node;
      return [0, 1].map(c => short(at + 2 * c) + view.getFloat32(at + 4 + 4 * c, true));
    });
    return { displacement, elements, zone: unpacked('Zone', zone) };
  }
}

// ---- The iteration: src/correlate/iterate.rs

const ROUND_OFF_PX = 5e-6;
const STALLED = 0.8;
const WILD_ELEMENTS = 8;
/** A first correction larger than this, px, comes from a start too rough for what has been lost to be known. */
const ROUGH_PX = 0.25;
/** The matrix of what is left is renewed when other elements have lost pixels, or so much has changed while corrections fall slowly. */
const SLOW_RATE = 0.25;
const RENEW_SHARE = 0.02;

/** What the corrections still to come add up to. */
function errorLeft(correction, [last, one_before]) {
  const earlier = Number.isFinite(one_before) ? one_before : last;
  if (!Number.isFinite(earlier)) return correction;
  const rate = earlier > 0 ? Math.min(correction / earlier, 0.99) : 0;
  return (last + correction) * rate / (1 - rate);
}

/** Iterates until the correction, and the error it leaves, are below the tolerance; `tell` hears of every step. */
async function iterate(field, { tolerance_px, max_iterations, turn }, tell) {
  const { level, level: { grid: { hx, hy } } } = field;
  const outcome = { status: 'iteration limit', iterations: 0 };
  let [before, stalls, made] = [[Infinity, Infinity], 0, null];
  for (let iteration = 1; iteration <= max_iterations; iteration++) {
    // A correction that comes back with the other sign each time is an overshoot: one half step settles it.
    const damping = stalls === 3 ? 0.5 : 1;
    const scale = turn.map(v => damping * v);
    let step = await field.step(scale);
    const moved = made && Math.abs(step.counted - made.counted) > RENEW_SHARE * hx * hy;
    const renew = made
      ? step.lossy !== made.lossy || (moved && step.correction_px > SLOW_RATE * before[0])
      : step.lossy > 0 && (iteration > 1 || step.correction_px < ROUGH_PX);
    if (renew) {
      const { moments } = await field.remaining();
      field.use(level.solverOf(moments, REDUCTION_CHANGED));
      step = await field.solveAgain(scale);
      made = step;
    }
    const correction = step.correction_px;
    Object.assign(outcome, { iterations: iteration, step });
    tell({ level: level.level, iteration, correction_px: correction, zone: step.zone, lossy: step.lossy });
    if (!Number.isFinite(correction) || correction > WILD_ELEMENTS * Math.sqrt(hx * hy)) {
      outcome.status = 'diverged';
      break;
    }
    if (correction < tolerance_px && (correction < ROUND_OFF_PX || errorLeft(correction, before) < tolerance_px)) {
      outcome.status = 'converged';
      break;
    }
    stalls = correction > STALLED * before[0] && damping === 1 ? stalls + 1 : 0;
    before = [correction, before[0]];
  }
  return outcome;
}

// ---- Texture: src/correlate/texture.rs and reference_noise.rs

/** The noise that the quietest tenth of the image may hold, grey levels. */
function assumedNoise({ width, height, grey }, range) {
  const TILE = 16;
  const step = TILE * (1 + Math.floor(Math.max(width, height) / 1024));
  const at = (x, y) => grey[y * width + x];
  const row = (x, y) => at(x - 1, y) - 2 * at(x, y) + at(x + 1, y);
  const tiles = [];
  for (let y0 = 1; y0 < height - TILE; y0 += step) {
    for (let x0 = 1; x0 < width - TILE; x0 += step) {
      let [sum, greys, squares] = [0, 0, 0];
      for (let y = y0; y < y0 + TILE; y++) {
        for (let x = x0; x < x0 + TILE; x++) {
          sum += (row(x, y - 1) - 2 * row(x, y) + row(x, y + 1)) ** 2;
          greys += at(x, y);
          squares += at(x, y) ** 2;
        }
      }
      const n = TILE * TILE;
      tiles.push([Math.sqrt(sum / 36 / n), Math.sqrt(Math.max(squares / n - (greys / n) ** 2, 0))]);
    }
  }
  const quiet = tiles.sort((a, b) => a[0] - b[0]).slice(0, Math.ceil(tiles.length / 10));
  const n_white = quiet.filter(([noise, deviation]) => noise > 0.75 * deviation).length;
  const share = 2 * n_white > quiet.length ? 0.125 : 0.01;
  const rounding = grey instanceof Uint8Array ? 1 / Math.sqrt(12) : 0;
  return Math.max(Math.min(quiet.at(-1)?.[0] ?? 0, share * range), rounding);
}

/** For each node whether its weakest gradient direction stands out of the noise. */
function textured(level, noise) {
  const { grid, moments } = level;
  const support = new Float64Array(grid.n_nodes);
  for (let e = 0; e < grid.n_elements; e++) grid.corners(e).forEach(node => { support[node] += moments[MOMENTS * e + 27] / 9; });
  const { diagonals } = new BlockMatrix(grid, moments, new Array(grid.n_nodes).fill(true));
  const from_noise = noise * noise * CONSTANTS.GRADIENT_NOISE_GAIN;
  return diagonals.map(([xx, xy, , yy], node) => {
    const [mean, half] = [0.5 * (xx + yy), Math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)];
    if (support[node] <= 0) return false;
    const needed = (1.5 + 4.8 / Math.sqrt(Math.max(support[node], 1))) * from_noise;
    const [weakest, strongest] = [Math.max(mean - half, 0) / support[node], (mean + half) / support[node]];
    return weakest > needed && weakest > 1e-5 * strongest;
  });
}

// ---- The start: tiles of a small image, and the motion that most agree on (src/correlate/search.rs)

const TILE = 32;
const REACH = 32;

/** Correlation coefficient of the values of a tile and what is at a place of the deformed image; 0 where much of it is outside. */
function coefficient(value, { width, height, values }, [x0, y0, nx, ny]) {
  let n = 0, f = 0, ff = 0, g = 0, gg = 0, fg = 0, k = 0;
  for (let y = y0; y < y0 + ny; y += 2) {
    for (let x = x0; x < x0 + nx; x += 2) {
      const a = value[k++];
      if (x < 0 || y < 0 || x >= width || y >= height) continue;
      const b = values[y * width + x];
      n += 1;
      f += a;
      ff += a * a;
      g += b;
      gg += b * b;
      fg += a * b;
    }
  }
  const power = (ff - f * f / n) * (gg - g * g / n);
  return n >= 0.6 * value.length && power > 0 ? (fg - f * g / n) / Math.sqrt(power) : 0;
}

/** Where each tile of the reference lies in the deformed image, by the correlation coefficient of every other pixel. */
function matchTiles(reference, deformed, grid) {
  const matches = [];
  const ends = (from, length, n) => [Math.max(Math.ceil(from), 0), Math.min(Math.ceil(from + length), n)];
  const [x0, x1] = ends(grid.x0, grid.nx * grid.hx, reference.width);
  const [y0, y1] = ends(grid.y0, grid.ny * grid.hy, reference.height);
  const starts = (a, b) => {
    const [count, size] = [Math.max(Math.floor((b - a) / TILE), 1), Math.min(b - a, TILE)];
    return Array.from({ length: count }, (_, k) => [a + Math.floor((b - a - size * count) * (2 * k + 1) / (2 * count)) + k * size, size]);
  };
  for (const [ty, ny] of starts(y0, y1)) {
    for (const [tx, nx] of starts(x0, x1)) {
      const value = new Float64Array((nx + 1 >> 1) * (ny + 1 >> 1));
      let k = 0;
      for (let y = 0; y < ny; y += 2) {
        for (let x = 0; x < nx; x += 2) value[k++] = reference.values[(ty + y) * reference.width + tx + x];
      }
      let best = { score: 0 };
      for (let dy = -REACH; dy <= REACH; dy++) {
        for (let dx = -REACH; dx <= REACH; dx++) {
          const score = coefficient(value, deformed, [tx + dx, ty + dy, nx, ny]);
          if (score > best.score) best = { score, displacement: [dx, dy], centre: [tx + 0.5 * (nx - 1), ty + 0.5 * (ny - 1)] };
        }
      }
      if (best.score > 0) matches.push(best);
    }
  }
  return matches;
}

/** `u(x) = shift + gradient (x - centre)`. */
class Affine {
  constructor(shift, gradient = [[0, 0], [0, 0]], centre = [0, 0]) {
    Object.assign(this, { shift, gradient, centre });
  }

  at(x) {
    const d = [x[0] - this.centre[0], x[1] - this.centre[1]];
    return [0, 1].map(c => this.shift[c] + this.gradient[c][0] * d[0] + this.gradient[c][1] * d[1]);
  }

  /** By least squares; the mean where there are too few, or all on a line. */
  static through(matches) {
    const mean = value => matches.reduce((sum, m) => sum + value(m), 0) / matches.length;
    const [centre, shift] = [[0, 1].map(c => mean(m => m.centre[c])), [0, 1].map(c => mean(m => m.displacement[c]))];
    const d = m => [m.centre[0] - centre[0], m.centre[1] - centre[1]];
    const [xx, xy, yy] = [[0, 0], [0, 1], [1, 1]].map(([a, b]) => mean(m => d(m)[a] * d(m)[b]));
    const determinant = xx * yy - xy * xy;
    if (matches.length < 3 || determinant <= 1e-3 * (xx + yy) ** 2) return new Affine(shift);
    const gradient = [0, 1].map(c => {
      const [a, b] = [0, 1].map(k => mean(m => (m.displacement[c] - shift[c]) * d(m)[k]));
      return [(a * yy - b * xy) / determinant, (b * xx - a * xy) / determinant];
    });
    return new Affine(shift, gradient, centre);
  }

  /** Cosine and sine of its rotation; of one below 8 degrees, none. */
  turn() {
    const [[xx, xy], [yx, yy]] = this.gradient;
    const angle = Math.atan2(yx - xy, 2 + xx + yy);
    return Math.abs(angle) < 8 / 180 * Math.PI ? [1, 0] : [Math.cos(angle), Math.sin(angle)];
  }
}

/** Motions worth trying, the most probable first; the last is rest. */
function motions(matches) {
  const agreeing = motion => matches.filter(m => {
    const u = motion.at(m.centre);
    return Math.hypot(u[0] - m.displacement[0], u[1] - m.displacement[1]) < 1.5;
  });
  let best = [];
  const consider = motion => {
    const agree = agreeing(motion);
    if (agree.length > best.length && motion.gradient.flat().every(g => Math.abs(g) < 0.5)) best = agree;
  };
  matches.forEach(m => consider(new Affine(m.displacement)));
  let state = 1; // the same draws every time
  const draw = () => matches[(state = (Math.imul(state, 1664525) + 1013904223) >>> 0) % matches.length];
  for (let trial = 0; trial < 400 && matches.length >= 4; trial++) consider(Affine.through([draw(), draw(), draw()]));
  const found = best.length >= Math.max(matches.length >> 2, 2) ? [Affine.through(best)] : [];
  const single = [...matches].sort((a, b) => b.score - a.score).slice(0, 1).map(m => new Affine(m.displacement));
  return [...found, ...single, new Affine([0, 0])];
}

// ---- All of it

/** Below this correlation coefficient the images do not match, whatever the corrections say. */
const MATCHED = 0.5;
/** A level that takes more than this from the correlation coefficient has harmed it. */
const WORSE = 0.02;
/** Share of the nodes that may be left out for want of texture. */
const TEXTURELESS_SHARE = 0.2;
/** The start is searched for on images of about this many pixels a side. */
const SEARCH_SIDE = 320;
const SEARCH_ZONE = 20;

/** What is told of an image before anything is done with it. */
function rangeOf({ grey }) {
  let [low, high] = [Infinity, -Infinity];
  for (const g of grey) {
    if (g < low) low = g;
    if (g > high) high = g;
  }
  return [low, high];
}

/** Correlates two images `{ width, height, grey }` on elements of `size` px. Throws a Fault where there is no result. */
async function correlate(device, reference, deformed, { size = 16, tolerance_px = 1e-4, max_iterations = 50 } = {}) {
  if (reference.width !== deformed.width || reference.height !== deformed.height) {
    throw new Fault(`The images differ in size: the reference has ${reference.width} x ${reference.height} px, the deformed image ` +
      `${deformed.width} x ${deformed.height} px.`);
  }
  const [low, high] = rangeOf(reference);
  for (const [image, what] of [[reference, 'reference'], [deformed, 'deformed image']]) {
    const [least, most] = rangeOf(image);
    if (least === most) throw new Fault(`The ${what} has no texture: every pixel has the grey level ${least}.`);
  }
  const times = [];
  const timed = async (what, work) => {
    const began = performance.now();
    const result = await work();
    await device.settled();
    times.push([what, performance.now() - began]);
    return result;
  };
  device.runs = {};
  const frames = [reference, deformed].map(image => new Frame(device, image, [low, high]));
  try {
    // The grid first: an image may be too small for it.
    const grids = [Grid.on([0, 0, reference.width, reference.height], size)];
    let [longest, shortest] = [Math.max(grids[0].nx, grids[0].ny) * size, Math.min(grids[0].nx, grids[0].ny) * size];
    for (; longest > SEARCH_SIDE && shortest / 2 >= SEARCH_ZONE; longest /= 2, shortest /= 2) grids.push(grids.at(-1).halved(size));
    await timed('images to spline coefficients', () => frames.forEach(frame => grids.forEach((_, level) => frame.coefficients(level))));
    const noise = assumedNoise(reference, high - low);
    const levels = await timed('gradient, normal matrix, texture', async () => {
      const levels = [];
      for (const [at, grid] of grids.entries()) levels.push(await Level.of(device, frames[0], at, grid));
      levels.forEach((level, at) => level.solve(at === 0 ? withTexture(level, noise) : textured(level, noise / 2 ** at)));
      levels.slice(1).forEach((coarse, at) => levels[at].link(coarse));
      return levels;
    });
    const top = levels.at(-1);
    const tries = await timed('search of a start (by this page, not by the device)', async () => {
      const [f, g] = [await frames[0].onHost(top.level), await frames[1].onHost(top.level)];
      return motions(matchTiles(f, g, top.grid));
    });
    let best = null;
    await timed('iteration', async () => {
      for (const motion of tries) {
        const result = await downThePyramid(device, levels, frames[1], motion, { tolerance_px, max_iterations });
        const is_better = !best || result.matched > best.matched;
        if (result.status === 'converged' && result.matched > MATCHED) {
          best = result;
          return;
        }
        if (is_better) best = result;
      }
    });
    if (best.matched <= MATCHED) {
      throw new Fault(`The images do not match: their correlation coefficient is ${best.matched.toFixed(2)} at best, and ${MATCHED} is ` +
        'the least that counts. Are they of the same surface, in the same place?');
    }
    if (best.status !== 'converged') {
      throw new Fault(`The iteration did not converge (${best.status} after ${best.iterations} iterations, last correction ` +
        `${best.steps.at(-1).correction_px.toExponential(1)} px), so that there is no field to show.`);
    }
    const [finest] = levels;
    return {
      ...best, grid: finest.grid, active: finest.active, times, runs: { ...device.runs }, range: high - low, offset: frames[0].offset,
      n_levels: levels.length, n_left_out: finest.keep.filter(kept => !kept).length,
    };
  } finally {
    device.release();
  }
}

/** The nodes of the finest level that see texture; elements of the others are left out. */
function withTexture(level, noise) {
  const { grid } = level;
  let keep = new Array(grid.n_nodes).fill(true);
  for (;;) {
    const seen = textured(level, noise);
    const lost = keep.map((kept, node) => kept && !seen[node]);
    if (!lost.includes(true)) break;
    keep = keep.map((kept, node) => kept && !lost[node]);
    for (let e = 0; e < grid.n_elements; e++) level.active[e] &&= grid.corners(e).every(node => keep[node]);
    level.restrict();
    const share = keep.filter(kept => !kept).length / grid.n_nodes;
    if (share > TEXTURELESS_SHARE) {
      throw new Fault(`The reference has too little texture: ${Math.round(100 * share)} % of the nodes see nothing that stands out of a ` +
        `noise of ${noise.toFixed(2)} grey levels. Use larger elements, or images of a speckled surface.`);
    }
  }
  return keep;
}

/** Iterates from the coarsest level to the finest. */
async function downThePyramid(device, levels, deformed, motion, limits) {
  const steps = [];
  const tell = step => steps.push(step);
  const turn = motion.turn();
  const top = levels.at(-1);
  let field = new Field(device, top, deformed, { start: top.grid.nodes().map(at => motion.at(at)) });
  await field.observe();
  for (const level of levels.slice(0, -1).reverse()) {
    const { step } = await iterate(field, { tolerance_px: 0.03, max_iterations: 12, turn }, tell);
    const moved = Number.isFinite(step.correction_px) && step.gained >= -WORSE;
    field = new Field(device, level, deformed, { coarse: field, moved });
  }
  const { status, iterations, step } = await iterate(field, { ...limits, turn }, tell);
  const found = await field.found();
  return { status, iterations, steps, matched: step.correlation, start: motion, ...found };
}
