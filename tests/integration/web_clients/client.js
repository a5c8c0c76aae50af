// Programs that are not of this project, on the server's HTTP listener. web_clients_test.py runs it.
// Usage: node client.js STEP ...; prints what it found as JSON.
//   calls URL DESCRIPTORS TOKEN SEQUENCE   @connectrpc/connect-web: runs a job by gRPC-Web, and fails on purpose
//   lint FILE                              @redocly/openapi-core: what is wrong with an OpenAPI document

import crypto from 'node:crypto';
import fs from 'node:fs';
import { createFileRegistry, fromBinary } from '@bufbuild/protobuf';
import { FileDescriptorSetSchema } from '@bufbuild/protobuf/wkt';
import { Code, ConnectError, createClient } from '@connectrpc/connect';
import { createGrpcWebTransport } from '@connectrpc/connect-web';
import { createConfig, lint } from '@redocly/openapi-core';

const DEADLINE_MS = 120_000; // for everything: a busy machine may be slow, a hang must end
setTimeout(() => {
  console.error('deadline exceeded');
  process.exit(1);
}, DEADLINE_MS).unref();

async function calls(baseUrl, descriptors, token, sequence) {
  const registry = createFileRegistry(fromBinary(FileDescriptorSetSchema, fs.readFileSync(descriptors)));
  const authorize = (next) => (request) => {
    request.header.set('Authorization', `Bearer ${token}`);
    return next(request);
  };
  const client = (service, interceptors = [authorize]) =>
    createClient(registry.getService(`depthtween.v1.${service}`), createGrpcWebTransport({ baseUrl, interceptors }));
  const failure = async (call) => {
    try {
      await call();
      return null;
    } catch (thrown) {
      const error = ConnectError.from(thrown);
      const [info] = error.findDetails(registry.getMessage('google.rpc.ErrorInfo'));
      const [request] = error.findDetails(registry.getMessage('google.rpc.BadRequest'));
      return {
        code: Code[error.code],
        reason: info?.reason,
        fields: request?.fieldViolations.map((violation) => violation.field),
      };
    }
  };

  const jobs = client('JobService');
  const failures = {
    stranger: await failure(() => client('JobService', []).listJobs({})),
    missing: await failure(() => jobs.getJob({ name: 'jobs/none' })),
    malformed: await failure(() => jobs.getJob({ name: 'none' })),
    stream: await failure(async () => {
      for await (const event of jobs.watchJob({ name: 'jobs/none' })) void event;
    }),
  };
  const job = await jobs.createJob({ job: { sequence } });
  let events = 0;
  for await (const event of jobs.watchJob({ name: job.name })) {
    void event;
    events += 1;
  }
  const { state } = await jobs.getJob({ name: job.name });
  // One PNG after another, each cut into chunks.
  const frames = [];
  const request = { name: `${job.name}/outputs/depth`, encoding: registry.getEnum('depthtween.v1.Encoding').value.ENCODING_PNG };
  for await (const chunk of client('OutputService').streamFrames(request)) {
    if (chunk.header !== undefined) frames.push(crypto.createHash('sha256'));
    frames.at(-1).update(chunk.data);
  }
  const { jobs: listed } = await jobs.listJobs({});
  return {
    failures,
    job: job.name,
    listed: listed.map((one) => one.name),
    events,
    state,
    frames: frames.map((hash) => hash.digest('hex')),
  };
}

async function lintDocument(file) {
  const problems = await lint({ ref: file, config: await createConfig({ extends: ['spec'] }) });
  return { problems: problems.map((one) => `${one.severity} ${one.ruleId}: ${one.message} (${one.location[0]?.pointer})`) };
}

const [step, ...words] = process.argv.slice(2);
console.log(JSON.stringify(await { calls, lint: lintDocument }[step](...words)));
process.exit(0);
