// Uploads a file by tus-js-client, a client of tus that is not of this project.
// Usage: node client.js STEP URL FILE PATH [UPLOAD_URL]; prints what it found as JSON. tus_js_test.py runs it.
//   whole     creates an upload and sends all of it
//   cut       creates an upload and goes away in the middle
//   resume    goes on with UPLOAD_URL
//   terminate creates an upload, and in the middle takes it back

import fs from 'node:fs';
import tus from 'tus-js-client';

const CHUNK_BYTES = 256 * 1024;
const DEADLINE_MS = 120_000; // for everything: a busy machine may be slow, a hang must end
setTimeout(() => {
  console.error('deadline exceeded');
  process.exit(1);
}, DEADLINE_MS).unref();

const [step, endpoint, file, path, uploadUrl] = process.argv.slice(2);
const statuses = [];
let firstOffset = null;
let expires = null;

const upload = new tus.Upload(fs.createReadStream(file), {
  endpoint,
  uploadUrl: uploadUrl ?? null,
  uploadSize: fs.statSync(file).size,
  chunkSize: CHUNK_BYTES,
  retryDelays: null,
  storeFingerprintForResuming: false,
  uploadDataDuringCreation: step === 'whole',
  metadata: { path },
  onAfterResponse: (request, response) => {
    statuses.push(`${request.getMethod()} ${response.getStatus()}`);
    expires = response.getHeader('Upload-Expires') ?? expires;
    if (firstOffset === null && response.getHeader('Upload-Offset') !== undefined) {
      firstOffset = Number(response.getHeader('Upload-Offset'));
    }
  },
  onChunkComplete: (chunkBytes, acceptedBytes) => {
    if ((step === 'cut' || step === 'terminate') && acceptedBytes >= 2 * CHUNK_BYTES) {
      upload.abort(step === 'terminate').then(() => finish({ acceptedBytes }));
    }
  },
  onError: (error) => {
    console.error(String(error));
    process.exit(1);
  },
  onSuccess: () => finish({}),
});

function finish(more) {
  console.log(JSON.stringify({ url: upload.url, statuses, firstOffset, expires, ...more }));
  process.exit(0);
}

upload.start();
