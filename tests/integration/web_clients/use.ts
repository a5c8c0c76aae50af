// A client's code against the types that openapi-typescript makes of /openapi.json (types.d.ts beside this file).
import type { components, operations, paths } from './types';

const order: components['schemas']['Job'] = { sequence: 'sequences/s', options: { preset: 'fast' } };
const listed: paths['/v1/jobs']['get']['responses']['200']['content']['application/json'] = { jobs: [order] };
const frame: operations['Files_GetFrame']['parameters']['path'] = { job: 'j', output: 'depth', frame: 7, format: 'png' };
const upload: operations['Uploads_TusPatch']['parameters']['header']['Upload-Offset'] = '0';
export const used = [listed.jobs?.[0]?.state === 'STATE_QUEUED', frame.frame, upload];

// @ts-expect-error: a job has no such field
export const wrong: components['schemas']['Job'] = { sequence: 'sequences/s', colour: 'red' };
// @ts-expect-error: a job is of a sequence
export const lacking: components['schemas']['Job'] = {};
