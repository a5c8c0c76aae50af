// A client of depthtween.v1 in another language, made from the .proto files alone: nothing of it comes from this project's
// C++. Usage: node client.js STEP SERVER PROTO_FOLDER ARGUMENT...; prints what it found as JSON. grpc_js_test.py runs it.

import assert from 'node:assert/strict';
import fs from 'node:fs';
import path from 'node:path';
import zlib from 'node:zlib';
import crypto from 'node:crypto';
import grpc from '@grpc/grpc-js';
import protoLoader from '@grpc/proto-loader';

const CHUNK_BYTES = 64 * 1024;
const DEADLINE_MS = 120_000; // for everything: a busy machine may be slow, a hang must end

// CRC-32C (Castagnoli), RFC 3720 appendix B.4.
const CRC_TABLE = Uint32Array.from({ length: 256 }, (_, i) => {
  let remainder = i;
  for (let bit = 0; bit < 8; ++bit) remainder = remainder & 1 ? (remainder >>> 1) ^ 0x82f63b78 : remainder >>> 1;
  return remainder >>> 0;
});
function crc32c(bytes) {
  let state = 0xffffffff;
  for (const byte of bytes) state = (state >>> 8) ^ CRC_TABLE[(state ^ byte) & 0xff];
  return ~state >>> 0;
}

const [step, server, protoFolder, ...args] = process.argv.slice(2);
const definition = protoLoader.loadSync(
  ['sequence', 'job', 'output', 'admin'].map((name) => `depthtween/v1/${name}.proto`).concat('grpc/health/v1/health.proto'),
  { includeDirs: [protoFolder], keepCase: true, longs: Number, enums: String, defaults: true, oneofs: true },
);
const loaded = grpc.loadPackageDefinition(definition);
const { SequenceService, JobService, OutputService, AdminService } = loaded.depthtween.v1;
const connect = (Service) => new Service(server, grpc.credentials.createInsecure());
const sequences = connect(SequenceService);
const jobs = connect(JobService);
const outputs = connect(OutputService);
const admin = connect(AdminService);
const health = connect(loaded.grpc.health.v1.Health);

const deadline = () => ({ deadline: Date.now() + DEADLINE_MS });
const call = (client, method, request) =>
  new Promise((resolve, reject) =>
    client[method](request, new grpc.Metadata(), deadline(), (error, answer) => (error ? reject(error) : resolve(answer))),
  );
// The error a call must end with.
async function failure(promise) {
  try {
    await promise;
  } catch (error) {
    return error;
  }
  return assert.fail('the call succeeded, but must not');
}

// The files of a sequence folder, in an order of our own.
function readSequence(folder) {
  const names = ['camera.json', 'depth.txt', 'rgb.txt'];
  for (const list of ['depth.txt', 'rgb.txt']) {
    for (const line of fs.readFileSync(path.join(folder, list), 'utf8').split('\n')) {
      if (line && !line.startsWith('#')) names.push(line.slice(line.indexOf(' ') + 1).trim());
    }
  }
  const files = names.map((name) => ({ name, bytes: fs.readFileSync(path.join(folder, name)) }));
  return { files, bytes: Buffer.concat(files.map((file) => file.bytes)) };
}

const announce = (parent, files) =>
  call(sequences, 'StartUpload', {
    parent,
    upload: {
      files: files.map(({ name, bytes }) => ({
        path: name,
        size_bytes: bytes.length,
        sha256: crypto.createHash('sha256').update(bytes).digest(),
      })),
    },
    request_id: 'the-one-upload',
  });

// Writes [from, to) as one stream. `finish` says so on the last message; `spoil` may change a message.
function write(name, bytes, from, to, { finish = false, spoil = (message) => message, hangUp = false } = {}) {
  return new Promise((resolve, reject) => {
    const stream = sequences.WriteUpload(new grpc.Metadata(), deadline(), (error, answer) =>
      error ? reject(error) : resolve(answer),
    );
    stream.on('error', () => {}); // told to the callback too
    for (let offset = from; offset < to; offset += CHUNK_BYTES) {
      const data = bytes.subarray(offset, Math.min(offset + CHUNK_BYTES, to));
      const last = offset + CHUNK_BYTES >= to;
      stream.write(spoil({ name, write_offset: offset, data, crc32c: crc32c(data), finish: finish && last }));
    }
    if (hangUp) {
      setTimeout(() => stream.cancel(), 200);
    } else {
      stream.end();
    }
  });
}

const getUpload = (name) => call(sequences, 'GetUpload', { name });

async function awaitValidation(name) {
  for (;;) {
    const sequence = await call(sequences, 'GetSequence', { name });
    if (sequence.state !== 'STATE_VALIDATING') return sequence;
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
}

// Uploads the first part of a recording in several streams, each interrupted in another way, and leaves it unfinished.
async function startUpload(folder) {
  const { files, bytes } = readSequence(folder);
  const { name: parent } = await call(sequences, 'CreateSequence', { sequence: { display_name: 'from node' } });
  const upload = await announce(parent, files);
  assert.equal(upload.size_bytes, bytes.length);
  assert.equal(upload.committed_size, 0);
  assert.equal((await announce(parent, files)).name, upload.name); // the same request_id: the same upload

  // Ended early by the client: what arrived is acknowledged.
  const third = Math.floor(bytes.length / 3);
  const first = await write(upload.name, bytes, 0, third);
  assert.equal(first.committed_size, third);
  assert.equal(first.state, 'STATE_RECEIVING');

  // A wrong crc: nothing of that message is kept, what came before it is.
  const wrongCrc = await failure(
    write(upload.name, bytes, third, third + 3 * CHUNK_BYTES, {
      spoil: (message) => (message.write_offset === third + CHUNK_BYTES ? { ...message, crc32c: message.crc32c ^ 1 } : message),
    }),
  );
  assert.equal(wrongCrc.code, grpc.status.DATA_LOSS);
  assert.match(wrongCrc.details, /crc32c/);
  assert.equal((await getUpload(upload.name)).committed_size, third + CHUNK_BYTES);

  // A gap.
  const gap = await failure(write(upload.name, bytes, 0, CHUNK_BYTES));
  assert.equal(gap.code, grpc.status.OUT_OF_RANGE);

  // Not finished: no commit.
  const early = await failure(call(sequences, 'CommitSequence', { name: parent }));
  assert.equal(early.code, grpc.status.FAILED_PRECONDITION);

  // Hung up in the middle of a stream: whole messages may count, parts of one never do.
  await failure(write(upload.name, bytes, third + CHUNK_BYTES, 2 * third, { hangUp: true }));
  let committed = -1;
  for (;;) {
    const { committed_size: now } = await getUpload(upload.name);
    if (now === committed) break;
    committed = now;
    await new Promise((resolve) => setTimeout(resolve, 500));
  }
  assert.ok(committed >= third + CHUNK_BYTES && committed <= 2 * third);
  return { sequence: parent, upload: upload.name, committed };
}

// Goes on after the server was killed.
async function finishUpload(folder, parent, name, acknowledged) {
  const { bytes } = readSequence(folder);
  const before = await getUpload(name);
  assert.ok(before.committed_size >= Number(acknowledged), 'acknowledged bytes are gone');
  const after = await write(name, bytes, before.committed_size, bytes.length, { finish: true });
  assert.equal(after.state, 'STATE_FINISHED');
  await call(sequences, 'CommitSequence', { name: parent });
  const sequence = await awaitValidation(parent);
  assert.equal(sequence.state, 'STATE_READY', JSON.stringify(sequence.violations));
  return { recording: sequence.recording };
}

// Decodes a PNG of one grey channel without interlacing into its integers, little-endian: what ENCODING_RAW carries.
function decodePng(png) {
  let width, height, bits;
  const parts = [];
  for (let at = 8; at < png.length; ) {
    const size = png.readUInt32BE(at);
    const kind = png.toString('latin1', at + 4, at + 8);
    const data = png.subarray(at + 8, at + 8 + size);
    if (kind === 'IHDR') [width, height, bits] = [data.readUInt32BE(0), data.readUInt32BE(4), data[8]];
    if (kind === 'IDAT') parts.push(data);
    at += size + 12;
  }
  const unit = bits / 8;
  const stride = width * unit;
  const packed = zlib.inflateSync(Buffer.concat(parts));
  const raw = Buffer.alloc(stride * height);
  const paeth = (a, b, c) => {
    const [da, db, dc] = [Math.abs(b - c), Math.abs(a - c), Math.abs(a + b - 2 * c)];
    if (da <= db && da <= dc) return a;
    return db <= dc ? b : c;
  };
  for (let y = 0; y < height; ++y) {
    const filter = packed[y * (stride + 1)];
    for (let x = 0; x < stride; ++x) {
      const a = x >= unit ? raw[y * stride + x - unit] : 0;
      const b = y > 0 ? raw[(y - 1) * stride + x] : 0;
      const c = x >= unit && y > 0 ? raw[(y - 1) * stride + x - unit] : 0;
      const predicted = [0, a, b, (a + b) >> 1, paeth(a, b, c)][filter];
      raw[y * stride + x] = packed[y * (stride + 1) + 1 + x] + predicted;
    }
  }
  return { width, height, raw: unit === 2 ? raw.swap16() : raw };
}

// All frames that a stream brings, whole and checked. `onFrame` is told each as it comes.
function streamFrames(request, onFrame = () => {}) {
  return new Promise((resolve, reject) => {
    const frames = [];
    let header, parts;
    const stream = outputs.StreamFrames(request, new grpc.Metadata(), deadline());
    stream.on('data', (chunk) => {
      try {
        if (chunk.header) [header, parts] = [chunk.header, []];
        assert.equal(crc32c(chunk.data), chunk.crc32c);
        assert.equal(chunk.offset, parts.reduce((sum, part) => sum + part.length, 0));
        parts.push(chunk.data);
        if (chunk._next_frame !== 'next_frame') return;
        const bytes = Buffer.concat(parts);
        assert.equal(bytes.length, header.size_bytes);
        assert.equal(crc32c(bytes), header.crc32c);
        frames.push({ index: chunk.frame, next: chunk.next_frame, header, bytes });
        onFrame(frames.at(-1));
      } catch (error) {
        stream.cancel();
        reject(error);
      }
    });
    stream.on('error', reject);
    stream.on('end', () => resolve(frames));
  });
}

// Watches a job to its end, following its frames at the same time.
async function runJob(sequence) {
  const { recording } = await call(sequences, 'GetSequence', { name: sequence });
  const checked = await call(jobs, 'CreateJob', { job: { sequence }, validate_only: true });
  assert.equal(checked.name, '');
  const job = await call(jobs, 'CreateJob', { job: { sequence }, request_id: 'the-one-job' });
  assert.equal((await call(jobs, 'CreateJob', { job: { sequence }, request_id: 'the-one-job' })).name, job.name);
  const otherBody = await failure(
    call(jobs, 'CreateJob', { job: { sequence, options: { method: 'hold' } }, request_id: 'the-one-job' }),
  );
  assert.equal(otherBody.code, grpc.status.ALREADY_EXISTS);

  const watching = new Promise((resolve, reject) => {
    const events = [];
    const stream = jobs.WatchJob({ name: job.name }, new grpc.Metadata(), deadline());
    stream.on('data', (event) => events.push(event));
    stream.on('error', reject);
    stream.on('end', () => resolve(events));
  });
  const depthName = `${job.name}/outputs/depth`;
  let stateAtFirstFrame;
  const depth = await streamFrames({ name: depthName, encoding: 'ENCODING_RAW', follow: true }, () => {
    stateAtFirstFrame ??= call(jobs, 'GetJob', { name: job.name });
  });
  assert.equal((await stateAtFirstFrame).state, 'STATE_RUNNING', 'the first frame came only after the job');
  const events = await watching;
  assert.equal(events[0].event, 'snapshot');
  assert.equal(events.at(-1).state_change.state, 'STATE_SUCCEEDED');
  for (let i = 1; i < events.length; ++i) {
    const step = events[i].event === 'heartbeat' || events[i].event === 'snapshot' ? null : 1;
    if (step !== null) assert.equal(events[i].number, events[i - 1].number + step);
  }

  const { width, height } = recording.camera;
  assert.equal(depth.length, recording.color_frame_count);
  for (const [i, frame] of depth.entries()) {
    assert.equal(frame.index, i);
    assert.equal(frame.next, i + 1);
    assert.equal(frame.bytes.length, width * height * 2);
    assert.deepEqual(frame.header.camera, recording.camera);
    assert.equal(frame.header.units_per_metre, recording.depth_scale);
    assert.equal(frame.header.invalid_value, 0);
    if (i > 0) assert.ok(frame.header.time_ns > depth[i - 1].header.time_ns);
  }

  // Every lossless encoding decodes to the same numbers.
  const png = await streamFrames({ name: depthName, encoding: 'ENCODING_PNG' });
  const floats = await streamFrames({ name: depthName, encoding: 'ENCODING_F32' });
  assert.equal(png.length, depth.length);
  for (const [i, frame] of depth.entries()) {
    const decoded = decodePng(png[i].bytes);
    assert.deepEqual([decoded.width, decoded.height], [width, height]);
    assert.ok(decoded.raw.equals(frame.bytes), `PNG and RAW of frame ${i} differ`);
    for (let pixel = 0; pixel < width * height; ++pixel) {
      const stored = frame.bytes.readUInt16LE(2 * pixel);
      assert.equal(floats[i].bytes.readFloatLE(4 * pixel), Math.fround(stored / recording.depth_scale));
    }
  }

  // From any frame on, and with a stride.
  const tail = await streamFrames({ name: depthName, encoding: 'ENCODING_RAW', start_frame: 5, stride: 3, end_frame: 12 });
  assert.deepEqual(tail.map((frame) => frame.index), [5, 8, 11]);
  assert.ok(tail[1].bytes.equals(depth[8].bytes));

  const provenance = await streamFrames({ name: `${job.name}/outputs/provenance`, encoding: 'ENCODING_RAW' });
  assert.equal(provenance[0].bytes.length, width * height);
  return { job: job.name, stems: depth.map((frame) => frame.header.stem) };
}

// Requests that no honest client makes.
async function misbehave() {
  const { name: parent } = await call(sequences, 'CreateSequence', { sequence: {} });
  const start = (file) => failure(call(sequences, 'StartUpload', { parent, upload: { files: [file] } }));
  for (const name of ['../../escaped', '/etc/passwd', 'rgb/../../x', 'rgb//x', '.hidden', 'a\0b', '', 'a/b/c/d/e/f']) {
    const error = await start({ path: name, size_bytes: 1 });
    assert.equal(error.code, grpc.status.INVALID_ARGUMENT, JSON.stringify(name));
  }
  for (const size of [-1, 1e15]) {
    const error = await start({ path: 'rgb/0.png', size_bytes: size });
    assert.ok([grpc.status.INVALID_ARGUMENT, grpc.status.RESOURCE_EXHAUSTED].includes(error.code), `size ${size}`);
    assert.notEqual(error.details, '');
  }

  // A recording that lacks a frame its list names.
  const files = [
    { name: 'camera.json', bytes: Buffer.from('{"width": 8, "height": 8, "fx": 8, "fy": 8, "cx": 4, "cy": 4, "depth_scale": 1000}') },
    { name: 'rgb.txt', bytes: Buffer.from('0.0 rgb/0.png\n') },
    { name: 'depth.txt', bytes: Buffer.from('0.0 ../../../../etc/passwd\n') },
  ];
  const upload = await announce(parent, files);
  const bytes = Buffer.concat(files.map((file) => file.bytes));
  const { limits } = await call(admin, 'GetServerInfo', {});
  const tooLarge = await failure(
    write(upload.name, Buffer.alloc(bytes.length), 0, 1, {
      spoil: (message) => ({ ...message, data: Buffer.alloc(limits.max_chunk_bytes + 1) }),
    }),
  );
  assert.equal(tooLarge.code, grpc.status.RESOURCE_EXHAUSTED);
  const noCrc = await failure(
    write(upload.name, bytes, 0, 1, { spoil: ({ crc32c: _, ...message }) => message }),
  );
  assert.equal(noCrc.code, grpc.status.INVALID_ARGUMENT);
  const wrongSha = await failure(
    write(upload.name, bytes, 0, bytes.length, {
      finish: true,
      spoil: (message) => {
        const data = Buffer.from(message.data);
        data[0] ^= 1;
        return { ...message, data, crc32c: crc32c(data) };
      },
    }),
  );
  assert.equal(wrongSha.code, grpc.status.DATA_LOSS);
  assert.match(wrongSha.details, /camera\.json/);
  const { committed_size: committed } = await getUpload(upload.name);
  await write(upload.name, bytes, committed, bytes.length, { finish: true });
  await call(sequences, 'CommitSequence', { name: parent });
  const sequence = await awaitValidation(parent);
  assert.equal(sequence.state, 'STATE_INVALID');
  const violated = sequence.violations.map((violation) => violation.file);
  assert.ok(violated.includes('rgb/0.png'), `violations: ${violated}`);
  assert.ok(violated.includes('depth.txt'), `violations: ${violated}`);
  assert.ok(!JSON.stringify(sequence.violations).includes('root:'), 'a file outside the sequence was read');

  const notReady = await failure(call(jobs, 'CreateJob', { job: { sequence: parent } }));
  assert.equal(notReady.code, grpc.status.FAILED_PRECONDITION);
  for (const [client, method] of [[jobs, 'GetJob'], [jobs, 'CancelJob'], [jobs, 'DeleteJob'], [jobs, 'RetryJob']]) {
    assert.equal((await failure(call(client, method, { name: 'jobs/nowhere' }))).code, grpc.status.NOT_FOUND);
    assert.equal((await failure(call(client, method, { name: '../jobs' }))).code, grpc.status.INVALID_ARGUMENT);
  }
  assert.equal((await call(health, 'Check', { service: 'depthtween.v1.SequenceService' })).status, 'SERVING');
  assert.equal((await call(health, 'Check', { service: '' })).status, 'SERVING');
  return {};
}

const steps = { 'start-upload': startUpload, 'finish-upload': finishUpload, 'run-job': runJob, misbehave };
try {
  console.log(JSON.stringify(await steps[step](...args)));
} catch (error) {
  console.error(error);
  process.exitCode = 1;
}
for (const client of [sequences, jobs, outputs, admin, health]) client.close();
