// Runs the frame of a bundle (`fathom dump --bundle`) on Dawn, Chromium's WebGPU, and compares what its stages leave with what they left
// on wgpu. The bundle holds wgpu's trace: each action is one call of WebGPU. Needs the npm package `webgpu`, here
// or at the path in the variable DAWN.
//
//   node scripts/replay.mjs BUNDLE [SHARE]
//
// Prints a line of JSON for each output: how many of its values there are, which share of them differs by more than the tolerance, and the
// relative RMS difference. Exit status: 0 no output differs in more than SHARE of its values (0.01 if not given), 1 one does,
// 2 the frame could not be run.
import { readFileSync } from "node:fs";
import { join } from "node:path";

// Rust's object notation: structs, variants and tuples in parentheses, lists in brackets. A variant becomes an object with its name as
// `is`, and without fields a string.
function parsed(text) {
  let at = 0;
  const spaces = /[\s,]*/y, name = /r#[\w-]+|[A-Za-z_][\w-]*/y, number = /-?(?:inf|NaN|[\d.][\d.eE+-]*)/y;
  const match = (pattern) => {
    pattern.lastIndex = at;
    const found = pattern.exec(text)?.[0];
    if (found !== undefined) at += found.length;
    return found;
  };
  const peek = () => (match(spaces), text[at]);
  const until = (end, item) => {
    for (at++; peek() !== end; ) item();
    at++;
  };
  // Fields by name, or items by number.
  function fields(into) {
    let count = 0;
    until(")", () => {
      const before = at, key = match(name);
      if (key !== undefined && peek() === ":") {
        at++;
        into[key] = value();
      } else {
        at = before;
        into[count++] = value();
      }
    });
    return into;
  }
  function list() {
    const items = [];
    until("]", () => items.push(value()));
    return items;
  }
  function map() {
    const pairs = {};
    until("}", () => {
      const key = value();
      peek();
      at++;
      pairs[key] = value();
    });
    return pairs;
  }
  function string() {
    const start = at;
    for (at++; text[at] !== '"'; at++) if (text[at] === "\\") at++;
    return JSON.parse(text.slice(start, ++at));
  }
  function value() {
    const next = peek();
    if (next === "[") return list();
    if (next === "{") return map();
    if (next === "(") return fields({});
    if (next === '"') return string();
    const word = match(name)?.replace("r#", "");
    if (word === undefined) {
      const digits = match(number);
      if (digits === undefined) throw new Error(`the trace cannot be read at ${JSON.stringify(text.slice(at, at + 20))}`);
      return Number(digits);
    }
    if (word === "true" || word === "false") return word === "true";
    if (word === "None") return undefined;
    if (text[at] !== "(") return word;
    const held = fields({ is: word });
    return word === "Some" || word === "PointerId" ? held[0] : held;
  }
  return value();
}

const flags = (text, of) => text.split(" | ").reduce((bits, flag) => bits | of[flag.trim()], 0);
const extent = ({ width, height, depthOrArrayLayers }) => ({ width, height, depthOrArrayLayers });
const dashed = (name) => name.replace(/([a-z])([A-Z])/g, "$1-$2").toLowerCase();

// What is bound, as a layout says it.
function layoutEntry({ binding, visibility, ty }) {
  const entry = { binding, visibility: flags(visibility, GPUShaderStage) };
  if (ty.is === "Buffer") {
    const type = ty.ty === "Uniform" ? "uniform" : ty.ty.read_only ? "read-only-storage" : "storage";
    return { ...entry, buffer: { type, hasDynamicOffset: ty.has_dynamic_offset } };
  }
  if (ty.is === "Sampler") return { ...entry, sampler: { type: dashed(ty[0]) } };
  const viewDimension = ty.view_dimension;
  if (ty.is === "StorageTexture") {
    return { ...entry, storageTexture: { access: dashed(ty.access), format: ty.format, viewDimension } };
  }
  const { sample_type: type } = ty;
  const sampleType = type.is === "Float" ? (type.filterable ? "float" : "unfilterable-float") : dashed(type);
  return { ...entry, texture: { sampleType, viewDimension, multisampled: ty.multisampled } };
}

// The trace's calls on a device. Identifiers are addresses, which wgpu uses again once an object is dropped: the latest counts.
function player(device, folder) {
  const objects = new Map(), readBacks = [];
  const get = (id) => objects.get(id);
  const file = (data) => readFileSync(join(folder, data[0]));
  const stage = ({ module, entry_point: entryPoint, constants }) => ({ module: get(module), entryPoint, constants });
  const copied = ({ texture, mip_level: mipLevel, origin, aspect }) => ({ texture: get(texture), mipLevel, origin, aspect });
  const placed = ({ buffer, layout }) => ({
    buffer: get(buffer), offset: layout.offset, bytesPerRow: layout.bytes_per_row, rowsPerImage: layout.rows_per_image,
  });
  const resource = (held) => {
    if (held.is !== "Buffer") return get(held[0]);
    const { buffer, offset, size } = held[0];
    return { buffer: get(buffer), offset, size };
  };

  const passes = {
    SetPipeline: (pass, { 0: id }) => pass.setPipeline(get(id)),
    SetBindGroup: (pass, { index, bind_group: id }) => pass.setBindGroup(index, get(id)),
    SetVertexBuffer: (pass, { slot, buffer, offset, size }) => pass.setVertexBuffer(slot, get(buffer), offset, size),
    SetIndexBuffer: (pass, { buffer, index_format: format, offset, size }) => pass.setIndexBuffer(get(buffer), format, offset, size),
    SetViewport: (pass, { rect, depth_min: near, depth_max: far }) => pass.setViewport(rect.x, rect.y, rect.w, rect.h, near, far),
    SetScissor: (pass, { 0: rect }) => pass.setScissorRect(rect.x, rect.y, rect.w, rect.h),
    Draw: (pass, c) => pass.draw(c.vertex_count, c.instance_count, c.first_vertex, c.first_instance),
    DrawIndexed: (pass, c) => pass.drawIndexed(c.index_count, c.instance_count, c.first_index, c.base_vertex, c.first_instance),
    DispatchWorkgroups: (pass, { 0: groups }) => pass.dispatchWorkgroups(groups[0], groups[1], groups[2]),
  };
  const play = (pass, { commands }) => {
    for (const command of commands) call(passes, command, pass);
    pass.end();
  };
  const load = (operation, op, clear) => (operation === "load" ? { [op]: "load" } : { [op]: "clear", [clear]: operation[0] });
  const color = (held) => held && {
    view: get(held.view), depthSlice: held.depth_slice, ...load(held.load_op, "loadOp", "clearValue"), storeOp: held.store_op,
  };
  const depth = (held) => {
    const { view, depth } = held;
    if (depth === "ReadOnly") return { view: get(view), depthReadOnly: true };
    return { view: get(view), ...load(depth[0].load, "depthLoadOp", "depthClearValue"), depthStoreOp: depth[0].store };
  };
  const commands = {
    CopyBufferToBuffer: (encoder, c) => {
      encoder.copyBufferToBuffer(get(c.src), c.src_offset, get(c.dst), c.dst_offset, c.size);
    },
    CopyBufferToTexture: (encoder, c) => encoder.copyBufferToTexture(placed(c.src), copied(c.dst), extent(c.size)),
    CopyTextureToBuffer: (encoder, c) => encoder.copyTextureToBuffer(copied(c.src), placed(c.dst), extent(c.size)),
    CopyTextureToTexture: (encoder, c) => encoder.copyTextureToTexture(copied(c.src), copied(c.dst), extent(c.size)),
    ClearBuffer: (encoder, { dst, offset, size }) => encoder.clearBuffer(get(dst), offset, size),
    RunComputePass: (encoder, { pass }) => play(encoder.beginComputePass({ label: pass.label }), pass),
    RunRenderPass: (encoder, c) => play(encoder.beginRenderPass({
      label: c.pass.label,
      colorAttachments: c.color_attachments.map((held) => color(held) ?? null),
      depthStencilAttachment: c.depth_stencil_attachment && depth(c.depth_stencil_attachment),
    }), c.pass),
  };
  const actions = {
    CreateBuffer: ({ 0: id, 1: { label, size, usage } }) => {
      const readBack = usage.includes("MAP_READ");
      const buffer = device.createBuffer({ label, size, usage: flags(usage, GPUBufferUsage) | GPUBufferUsage.COPY_DST });
      if (readBack) readBacks.push(buffer);
      objects.set(id, buffer);
    },
    CreateTexture: ({ 0: id, 1: d }) => objects.set(id, device.createTexture({
      label: d.label, size: extent(d.size), mipLevelCount: d.mip_level_count, sampleCount: d.sample_count, dimension: d.dimension,
      format: d.format, usage: flags(d.usage, GPUTextureUsage), viewFormats: d.view_formats,
    })),
    CreateTextureView: ({ id, parent, desc: { format, dimension, range } }) =>
      objects.set(id, get(parent).createView({ format, dimension, ...range })),
    CreateSampler: ({ 0: id, 1: d }) => objects.set(id, device.createSampler({
      addressModeU: d.address_modes[0], addressModeV: d.address_modes[1], addressModeW: d.address_modes[2],
      magFilter: d.mag_filter, minFilter: d.min_filter, mipmapFilter: d.mipmap_filter,
      lodMinClamp: d.lod_min_clamp, lodMaxClamp: d.lod_max_clamp, compare: d.compare, maxAnisotropy: d.anisotropy_clamp,
    })),
    CreateBindGroupLayout: ({ 0: id, 1: { label, entries } }) =>
      objects.set(id, device.createBindGroupLayout({ label, entries: entries.map(layoutEntry) })),
    CreatePipelineLayout: ({ 0: id, 1: { label, bind_group_layouts: layouts } }) =>
      objects.set(id, device.createPipelineLayout({ label, bindGroupLayouts: layouts.map(get) })),
    CreateBindGroup: ({ 0: id, 1: { label, layout, entries } }) => objects.set(id, device.createBindGroup({
      label, layout: get(layout), entries: entries.map(({ binding, resource: held }) => ({ binding, resource: resource(held) })),
    })),
    CreateShaderModule: ({ id, desc, data }) =>
      objects.set(id, device.createShaderModule({ label: desc.label, code: file(data).toString() })),
    CreateComputePipeline: ({ id, desc }) => objects.set(id, device.createComputePipeline({
      label: desc.label, layout: get(desc.layout), compute: stage(desc.stage),
    })),
    CreateGeneralRenderPipeline: ({ id, desc }) => objects.set(id, device.createRenderPipeline(renderPipeline(desc))),
    WriteBuffer: ({ id, data, offset, size }) => device.queue.writeBuffer(get(id), offset, file(data), 0, size),
    WriteTexture: ({ to, data, layout, size }) => device.queue.writeTexture(copied(to), file(data), {
      offset: layout.offset, bytesPerRow: layout.bytes_per_row, rowsPerImage: layout.rows_per_image,
    }, extent(size)),
    Submit: ({ 1: list }) => {
      const encoder = device.createCommandEncoder();
      for (const command of list) call(commands, command, encoder);
      device.queue.submit([encoder.finish()]);
    },
  };
  function renderPipeline({ label, layout, vertex: { 0: vertex }, primitive: p, depth_stencil: d, multisample, fragment }) {
    const { topology, stripIndexFormat, frontFace, cullMode, unclippedDepth } = p;
    return {
      label, layout: get(layout),
      vertex: { ...stage(vertex.stage), buffers: vertex.buffers },
      primitive: { topology, stripIndexFormat, frontFace, cullMode: cullMode ?? "none", unclippedDepth },
      depthStencil: d && {
        format: d.format, depthWriteEnabled: d.depth_write_enabled, depthCompare: d.depth_compare,
        depthBias: d.bias.constant, depthBiasSlopeScale: d.bias.slope_scale, depthBiasClamp: d.bias.clamp,
      },
      multisample: { count: multisample.count },
      fragment: fragment && { ...stage(fragment.stage), targets: fragment.targets },
    };
  }
  return { run: (list) => list.forEach((action) => call(actions, action)), readBacks };
}

// Calls what an action names. Drops need none, and debug groups change nothing.
function call(table, action, ...before) {
  const name = action.is ?? action;
  if (name in table) table[name](...before, action);
  else if (!/^(Init|Drop|Destroy|PushDebug|PopDebug|InsertDebug)/.test(name)) throw new Error(`the trace asks for ${name}`);
}

async function bytesOf(buffer) {
  await buffer.mapAsync(GPUMapMode.READ);
  return new Uint8Array(buffer.getMappedRange().slice(0));
}

const half = (bits) => {
  const exponent = (bits >> 10) & 31, fraction = bits & 1023, sign = bits >> 15 ? -1 : 1;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : 2 ** -14 * (fraction / 1024));
};

// How many bytes a value has and a texel, and how a value is read. A word of a buffer is a float, or an integer where it would be too
// small or not a number as a float.
function kind(format) {
  if (format === null || format === "depth32float") return { bytes: 4, texel: 4, of: word };
  const [, channels, bits, type] = /^(r|rg|rgba)(8|16|32)(float|unorm|uint)$/.exec(format) ?? [];
  const readers = {
    float16: (b, i) => half(b.getUint16(i, true)), float32: word,
    unorm8: (b, i) => b.getUint8(i) / 255, uint16: (b, i) => b.getUint16(i, true), uint32: (b, i) => b.getUint32(i, true),
  };
  const of = readers[type + bits];
  if (of === undefined) throw new Error(`outputs of format ${format} are not compared`);
  return { bytes: bits / 8, texel: (bits / 8) * channels.length, of };
}
function word(bytes, at) {
  const float = bytes.getFloat32(at, true);
  return Math.abs(float) < 1e-37 || Number.isNaN(float) ? bytes.getUint32(at, true) : float;
}

// Two compilers round differently. Both sides are single or half floats or 8 bits.
const RELATIVE = 1e-3, ABSOLUTE = 1e-4, STEP = 1.01 / 255;
function compared(format, one, other) {
  const { bytes, of } = kind(format);
  const views = [one, other].map((b) => new DataView(b.buffer, b.byteOffset, b.byteLength));
  const values = Math.floor(one.byteLength / bytes);
  let apart = 0, sum = 0, squares = 0, largest = 0;
  for (let i = 0; i < values; i++) {
    const [a, b] = views.map((view) => of(view, i * bytes));
    const off = Math.abs(a - b);
    const allowed = bytes === 1 ? STEP : RELATIVE * Math.max(Math.abs(a), Math.abs(b)) + ABSOLUTE;
    if (!(off <= allowed || Object.is(a, b))) apart++;
    if (Number.isFinite(off) && Math.abs(b) < 1e30) {
      sum += off * off;
      squares += b * b;
      largest = Math.max(largest, off);
    }
  }
  return { values, apart: apart / Math.max(values, 1), rms: Math.sqrt(sum / Math.max(squares, 1e-30)), largest };
}

async function device() {
  const { create, globals } = await import(process.env.DAWN ?? "webgpu");
  Object.assign(globalThis, globals);
  // Dawn ends with its instance, so that must outlive the device.
  globalThis.instance = create([]);
  const adapter = await instance.requestAdapter();
  if (!adapter) throw new Error("Dawn finds no adapter");
  const limits = {};
  for (const name in adapter.limits) limits[name] = adapter.limits[name];
  const device = await adapter.requestDevice({ requiredFeatures: [...adapter.features], requiredLimits: limits });
  const errors = [];
  device.addEventListener("uncapturederror", ({ error }) => errors.push(error.message));
  return { device, errors };
}

// Rows of a texture are padded where they were copied to; in a bundle's files they are not.
const ALIGNED = 256;
function unpadded(bytes, row) {
  const pitch = Math.ceil(row / ALIGNED) * ALIGNED, rows = bytes.byteLength / pitch;
  const joined = new Uint8Array(rows * row);
  for (let i = 0; i < rows; i++) joined.set(bytes.subarray(i * pitch, i * pitch + row), i * row);
  return joined;
}

async function main([folder, share = "0.01"]) {
  if (folder === undefined || !(Number(share) >= 0)) throw new Error("usage: node scripts/replay.mjs BUNDLE [SHARE]");
  const bundle = JSON.parse(readFileSync(join(folder, "bundle.json")));
  const trace = join(folder, bundle.trace);
  const opened = await device();
  const { run, readBacks } = player(opened.device, join(trace, ".."));
  run(parsed(readFileSync(trace, "utf8")));
  await opened.device.queue.onSubmittedWorkDone();
  if (opened.errors.length > 0) throw new Error(opened.errors[0]);
  let most = 0;
  const last = readBacks.slice(-bundle.outputs.length);
  for (const [i, { stage, output, format, texels_per_row: texels, file }] of bundle.outputs.entries()) {
    const expected = readFileSync(join(folder, file));
    const bytes = await bytesOf(last[i]), found = format ? unpadded(bytes, texels * kind(format).texel) : bytes;
    if (found.byteLength !== expected.byteLength) throw new Error(`${file} holds ${expected.byteLength} bytes, not ${found.byteLength}`);
    const difference = compared(format, found, expected);
    most = Math.max(most, difference.apart);
    console.log(JSON.stringify({ stage, output, ...difference }));
  }
  process.exit(most <= Number(share) ? 0 : 1);
}

main(process.argv.slice(2)).catch((error) => {
  console.error(`error: ${error.message}`);
  process.exit(2);
});
