// The graphics device: opens it, compiles the kernels of shaders.js, keeps buffers, records work and fetches results.
// Twin: src/backend/gpu/device.rs.
'use strict';

/** What went wrong, in a sentence for the reader of the page. */
class Fault extends Error {}

/** Where there is no WebGPU. */
const NO_WEBGPU = 'This browser offers no WebGPU to this page, so that nothing can be computed. Chrome and Edge have it from 113 on ' +
  '(Windows, macOS, ChromeOS; Android from 121; Linux: chrome://flags, "Unsafe WebGPU Support"), Safari from 26 on, Firefox from 141 on ' +
  '(Windows; macOS from 145). A page that is not opened as a file has to come over https.';

/** Workgroups along one dimension at most, as in the Rust program. */
const MOST_GROUPS = 32768;

/** Threads per element of the residual kernel, and no light that changes over the specimen. */
const OVERRIDES = { residual: { LANES: 16, LIGHT: 0 } };

/** The whole source of a shader file: a line `#import NAME` stands for the file of that name, taken once, as in src/backend/gpu/shader.rs. */
function sourceOf(file) {
  const taken = new Set();
  const lines = text => text.split('\n').flatMap(line => {
    const name = /^#import (\w+)/.exec(line)?.[1];
    if (!name) return [line];
    const shared = `shared/${name === 'spline' ? 'cubic' : name}`;
    if (taken.has(shared)) return [];
    taken.add(shared);
    return lines(FILES[shared]);
  });
  return lines(FILES[file]).join('\n');
}

class Device {
  /** Opens the device that the browser offers, with the largest buffers it allows, and compiles every kernel. */
  static async open(tell = () => {}) {
    if (!navigator.gpu) throw new Fault(NO_WEBGPU);
    const adapter = await navigator.gpu.requestAdapter({ powerPreference: 'high-performance' });
    if (!adapter) {
      throw new Fault('This browser knows WebGPU, but offers no graphics device: its driver may be missing, too old or on the list of ' +
        'those that the browser does not use (chrome://gpu tells).');
    }
    const { maxBufferSize, maxStorageBufferBindingSize } = adapter.limits;
    let raw;
    try {
      raw = await adapter.requestDevice({ requiredLimits: { maxBufferSize, maxStorageBufferBindingSize } });
    } catch (error) {
      throw new Fault(`The graphics device cannot be opened: ${error.message}`);
    }
    // Browsers before 2025 tell in other places.
    const info = adapter.info ?? await adapter.requestAdapterInfo?.() ?? {};
    const { vendor, architecture, device: model, description, subgroupMinSize, subgroupMaxSize } = info;
    const isFallbackAdapter = info.isFallbackAdapter ?? adapter.isFallbackAdapter ?? false;
    const device = new Device(adapter, raw, {
      vendor, architecture, device: model, description, isFallbackAdapter, subgroupMinSize, subgroupMaxSize,
    });
    tell('The kernels are compiled …');
    await device.compile();
    return device;
  }

  constructor(adapter, raw, info) {
    this.raw = raw;
    this.info = info;
    this.limits = {};
    for (const name in raw.limits) this.limits[name] = raw.limits[name];
    this.features = [...adapter.features].sort();
    this.pipelines = {};
    /** Times that each kernel was run. */
    this.runs = {};
    /** Buffers since the last release. */
    this.held = [];
    this.fault = null;
    raw.lost.then(({ reason, message }) => {
      this.fault ??= new Fault(`The graphics device was lost (${reason}): ${message || 'no reason is given'}. Load the page again.`);
    });
    raw.addEventListener('uncapturederror', event => {
      event.preventDefault?.();
      const kind = event.error instanceof GPUOutOfMemoryError ? 'has no memory left' : 'refused its work';
      this.fault ??= new Fault(`The graphics device ${kind}: ${event.error.message || 'no reason is given'}`);
    });
  }

  /** Its name, as far as the browser tells. */
  get name() {
    const { vendor, architecture, device, description } = this.info;
    const words = [description || device, vendor, architecture].filter(Boolean);
    return [...new Set(words)].join(', ') || 'a device that the browser does not name';
  }

  /** Compiles all kernels at the same time, and says which one fails and where. */
  async compile() {
    const began = performance.now();
    const kinds = { uniform: 'uniform', read: 'read-only-storage', write: 'storage' };
    await Promise.all(Object.entries(SHADERS).map(async ([name, shader]) => {
      const module = this.raw.createShaderModule({ label: name, code: sourceOf(shader.file) });
      const entries = shader.bindings.map((kind, binding) =>
        ({ binding, visibility: GPUShaderStage.COMPUTE, buffer: { type: kinds[kind] } }));
      const layout = this.raw.createBindGroupLayout({ label: name, entries });
      try {
        const pipeline = await this.raw.createComputePipelineAsync({
          label: name,
          layout: this.raw.createPipelineLayout({ label: name, bindGroupLayouts: [layout] }),
          compute: { module, entryPoint: shader.entry, constants: OVERRIDES[name] ?? {} },
        });
        this.pipelines[name] = { pipeline, layout };
      } catch (error) {
        const { messages } = await module.getCompilationInfo();
        const worst = messages.find(message => message.type === 'error');
        const where = worst ? `line ${worst.lineNum}: ${worst.message}` : error.message;
        throw new Fault(`The kernel ${name} cannot be compiled: ${where}`);
      }
    }));
    this.check();
    this.compileMs = performance.now() - began;
  }

  /** Throws what the device has reported. */
  check() {
    if (this.fault) throw this.fault;
  }

  /** A buffer of zeros. */
  buffer(bytes, what) {
    const size = Math.max(16, 16 * Math.ceil(bytes / 16));
    const most = Math.min(this.limits.maxBufferSize, this.limits.maxStorageBufferBindingSize);
    if (size > most) {
      throw new Fault(`${what} would take ${Math.ceil(size / 1e6)} MB on the graphics device, which gives a kernel ` +
        `${Math.floor(most / 1e6)} MB at once. Use smaller images, or the program, which works on such images in parts.`);
    }
    const usage = GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_SRC | GPUBufferUsage.COPY_DST;
    return this.hold(this.raw.createBuffer({ label: what, size, usage }));
  }

  hold(buffer) {
    this.held.push(buffer);
    return buffer;
  }

  /** Gives all buffers back: the browser would, but not soon. */
  release() {
    this.held.splice(0).forEach(buffer => buffer.destroy());
  }

  /** A buffer with the values of a typed array, of whole words. */
  filled(values, what) {
    const buffer = this.buffer(values.byteLength, what);
    this.write(buffer, values);
    return buffer;
  }

  write(buffer, values) {
    this.raw.queue.writeBuffer(buffer, 0, values);
  }

  /** A block of constants of the struct `name`. */
  uniform(name, values) {
    const bytes = packed(name, values);
    const usage = GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST;
    const buffer = this.hold(this.raw.createBuffer({ label: name, size: bytes.byteLength, usage }));
    this.raw.queue.writeBuffer(buffer, 0, bytes);
    return buffer;
  }

  /** A kernel with its buffers, and its number of workgroups along x, and y where they are not one long row. */
  bound(name, buffers, x, y) {
    const { pipeline, layout } = this.pipelines[name];
    const entries = buffers.map((buffer, binding) => ({ binding, resource: { buffer } }));
    const group = this.raw.createBindGroup({ label: name, layout, entries });
    return { name, pipeline, group, x: y === undefined ? Math.min(x, MOST_GROUPS) : x, y: y ?? Math.ceil(x / MOST_GROUPS) };
  }

  record() {
    return new Recorder(this);
  }

  /** Waits for all work. */
  async settled() {
    await this.raw.queue.onSubmittedWorkDone().catch(() => {});
    this.check();
  }
}

/** Records a batch of work. */
class Recorder {
  constructor(device) {
    this.device = device;
    this.encoder = device.raw.createCommandEncoder();
    this.pass = null;
  }

  run(...kernels) {
    for (const { name, pipeline, group, x, y } of kernels.flat()) {
      this.pass ??= this.encoder.beginComputePass();
      this.pass.setPipeline(pipeline);
      this.pass.setBindGroup(0, group);
      this.pass.dispatchWorkgroups(x, y);
      this.device.runs[name] = (this.device.runs[name] ?? 0) + 1;
    }
    return this;
  }

  end() {
    this.pass?.end();
    this.pass = null;
  }

  copy(from, to, bytes, at = 0) {
    this.end();
    this.encoder.copyBufferToBuffer(from, 0, to, at, bytes);
    return this;
  }

  clear(buffer) {
    this.end();
    this.encoder.clearBuffer(buffer);
    return this;
  }

  submit() {
    this.end();
    this.device.raw.queue.submit([this.encoder.finish()]);
    this.device.check();
  }

  /** Hands the work over and fetches the beginnings of buffers, `[buffer, bytes]`, each as an ArrayBuffer. */
  async fetch(...parts) {
    const { device } = this;
    const size = parts.reduce((sum, [, bytes]) => sum + bytes, 0);
    const landing = device.raw.createBuffer({ label: 'results', size, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
    let at = 0;
    for (const [buffer, bytes] of parts) {
      this.copy(buffer, landing, bytes, at);
      at += bytes;
    }
    this.submit();
    try {
      await landing.mapAsync(GPUMapMode.READ);
    } catch (error) {
      // The reason comes by another way, and may come a moment later.
      await new Promise(done => setTimeout(done, 50));
      device.check();
      throw new Fault(`The results of the graphics device cannot be read: ${error.message}`);
    }
    const all = landing.getMappedRange().slice(0);
    landing.destroy();
    device.check();
    at = 0;
    return parts.map(([, bytes]) => all.slice(at, at += bytes));
  }
}

const SETTERS = {
  i32: (view, at, value) => view.setInt32(at, value, true),
  u32: (view, at, value) => view.setUint32(at, value, true),
  f32: (view, at, value) => view.setFloat32(at, value, true),
};
const GETTERS = {
  i32: (view, at) => view.getInt32(at, true),
  u32: (view, at) => view.getUint32(at, true),
  f32: (view, at) => view.getFloat32(at, true),
};

/** Structs of the shaders as bytes: one of `values`, or each of a list. Where they lie is what naga says (LAYOUTS). */
function packed(name, values) {
  const list = Array.isArray(values) ? values : [values];
  const { size, fields } = LAYOUTS[name];
  const view = new DataView(new ArrayBuffer(size * list.length));
  list.forEach((value, number) => {
    for (const field in value) if (!(field in fields)) throw new Error(`the struct ${name} has no field ${field}`);
    for (const field in fields) {
      const [offset, kind] = fields[field];
      if (value[field] === undefined) {
        if (field.startsWith('unused')) continue;
        throw new Error(`the field ${field} of the struct ${name} is not given`);
      }
      [value[field]].flat(2).forEach((number_, k) => SETTERS[kind](view, number * size + offset + 4 * k, number_));
    }
  });
  return view.buffer;
}

/** The fields of one struct, of those that are single numbers. */
function unpacked(name, buffer, number = 0) {
  const { size, fields } = LAYOUTS[name];
  const view = new DataView(buffer);
  return Object.fromEntries(Object.entries(fields).filter(([, [, kind]]) => kind in GETTERS)
    .map(([field, [offset, kind]]) => [field, GETTERS[kind](view, number * size + offset)]));
}
