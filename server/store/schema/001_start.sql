-- Times are microseconds since 1970, UTC. `number` ascends in the order of creation and pages the lists;
-- AUTOINCREMENT, because a number must never name two things.

CREATE TABLE sequences (
  number         INTEGER PRIMARY KEY AUTOINCREMENT,
  id             TEXT    NOT NULL UNIQUE,
  display_name   TEXT    NOT NULL,
  state          INTEGER NOT NULL CHECK (state BETWEEN 1 AND 4),
  create_time_us INTEGER NOT NULL,
  update_time_us INTEGER NOT NULL,
  size_bytes     INTEGER NOT NULL DEFAULT 0,
  file_count     INTEGER NOT NULL DEFAULT 0,
  validation     TEXT    -- JSON of ValidationResult, once READY or INVALID
) STRICT;

CREATE TABLE uploads (
  number         INTEGER PRIMARY KEY AUTOINCREMENT,
  id             TEXT    NOT NULL UNIQUE,
  sequence       INTEGER NOT NULL REFERENCES sequences (number) ON DELETE CASCADE,
  size_bytes     INTEGER NOT NULL,
  committed_size INTEGER NOT NULL DEFAULT 0 CHECK (committed_size BETWEEN 0 AND size_bytes),
  finished       INTEGER NOT NULL DEFAULT 0,
  create_time_us INTEGER NOT NULL
) STRICT;
CREATE INDEX uploads_by_sequence ON uploads (sequence);

CREATE TABLE files (
  sequence   INTEGER NOT NULL REFERENCES sequences (number) ON DELETE CASCADE,
  path       TEXT    NOT NULL,
  upload     INTEGER NOT NULL REFERENCES uploads (number) ON DELETE CASCADE,
  position   INTEGER NOT NULL,  -- in the upload's manifest
  size_bytes INTEGER NOT NULL CHECK (size_bytes >= 0),
  sha256     BLOB    NOT NULL CHECK (length(sha256) IN (0, 32)),
  PRIMARY KEY (sequence, path)
) STRICT, WITHOUT ROWID;
CREATE INDEX files_by_upload ON files (upload, position);

CREATE TABLE jobs (
  number           INTEGER PRIMARY KEY AUTOINCREMENT,
  id               TEXT    NOT NULL UNIQUE,
  display_name     TEXT    NOT NULL,
  sequence_id      TEXT    NOT NULL,  -- not a reference: a job that has ended outlives its sequence
  recording        TEXT    NOT NULL,  -- JSON of Recording
  kind             INTEGER NOT NULL CHECK (kind BETWEEN 1 AND 2),  -- JobKind
  options          TEXT    NOT NULL,  -- JSON document, as core/options/job_options.h has it
  threads          INTEGER NOT NULL,  -- 0: the server decides
  depth_from       TEXT    NOT NULL DEFAULT '',  -- id of the job whose depth is taken over
  state            INTEGER NOT NULL CHECK (state BETWEEN 1 AND 6),
  attempt          INTEGER NOT NULL DEFAULT 1,
  error_code       INTEGER NOT NULL DEFAULT 0,
  error_message    TEXT    NOT NULL DEFAULT '',
  error_info       TEXT,  -- JSON of ErrorInfo, if there is one
  create_time_us   INTEGER NOT NULL,
  start_time_us    INTEGER,
  end_time_us      INTEGER,
  intervals_total  INTEGER NOT NULL DEFAULT 0,
  intervals_done   INTEGER NOT NULL DEFAULT 0,
  frames_total     INTEGER NOT NULL DEFAULT 0,
  frames_done      INTEGER NOT NULL DEFAULT 0,
  interval_seconds REAL    NOT NULL DEFAULT 0,
  self_check       TEXT,  -- JSON of SelfCheck, once it was measured
  clock_estimate   TEXT   -- JSON of ClockEstimate, once there is a plan
) STRICT;
CREATE INDEX jobs_by_state ON jobs (state, number);
CREATE INDEX jobs_by_sequence ON jobs (sequence_id, number);

-- One row for one attempt at one piece of work; deleted when it ends. A batch of intervals gets its row when it is claimed.
CREATE TABLE tasks (
  number         INTEGER PRIMARY KEY AUTOINCREMENT,
  kind           INTEGER NOT NULL CHECK (kind BETWEEN 1 AND 6),
  sequence       INTEGER REFERENCES sequences (number) ON DELETE CASCADE,  -- of a validate task
  job            INTEGER REFERENCES jobs (number) ON DELETE CASCADE,       -- of every other
  running        INTEGER NOT NULL DEFAULT 0,
  failures       INTEGER NOT NULL DEFAULT 0,
  first_interval INTEGER NOT NULL DEFAULT 0,
  interval_count INTEGER NOT NULL DEFAULT 0,
  render         INTEGER NOT NULL DEFAULT 0,
  CHECK ((kind = 1) = (sequence IS NOT NULL) AND (kind = 1) = (job IS NULL))
) STRICT;
CREATE INDEX tasks_by_job ON tasks (job);

CREATE TABLE intervals (
  job         INTEGER NOT NULL REFERENCES jobs (number) ON DELETE CASCADE,
  idx         INTEGER NOT NULL,
  first_frame INTEGER NOT NULL,
  frame_count INTEGER NOT NULL,
  held        INTEGER NOT NULL,
  task        INTEGER,  -- that is computing it now
  done        INTEGER NOT NULL DEFAULT 0,
  seconds     REAL,
  failures    INTEGER NOT NULL DEFAULT 0,
  PRIMARY KEY (job, idx)
) STRICT, WITHOUT ROWID;
CREATE INDEX intervals_to_do ON intervals (job, idx) WHERE done = 0 AND task IS NULL;
CREATE INDEX intervals_by_task ON intervals (task, idx) WHERE task IS NOT NULL;

CREATE TABLE frames (
  job       INTEGER NOT NULL REFERENCES jobs (number) ON DELETE CASCADE,
  idx       INTEGER NOT NULL,
  time_ns   INTEGER NOT NULL,
  stem      TEXT    NOT NULL,
  interval  INTEGER NOT NULL,
  assembled INTEGER,  -- whether it has a file of what is made for each frame at the end; NULL: not ended, or no such files
  PRIMARY KEY (job, idx)
) STRICT, WITHOUT ROWID;

-- Pictures made of finished frames. A job has any number of renders, each cut into the job's intervals.
CREATE TABLE renders (
  job         INTEGER NOT NULL REFERENCES jobs (number) ON DELETE CASCADE,
  idx         INTEGER NOT NULL,
  plan        TEXT    NOT NULL,  -- JSON of RenderRecord
  frames_done INTEGER NOT NULL DEFAULT 0,
  seconds     REAL    NOT NULL DEFAULT 0,
  PRIMARY KEY (job, idx)
) STRICT, WITHOUT ROWID;

-- The pictures of one interval for one render.
CREATE TABLE render_parts (
  job         INTEGER NOT NULL REFERENCES jobs (number) ON DELETE CASCADE,
  interval    INTEGER NOT NULL,
  render      INTEGER NOT NULL,
  needs_first INTEGER NOT NULL,  -- the intervals that must be done before, so that its neighbours can be looked at
  needs_last  INTEGER NOT NULL,
  task        INTEGER,           -- that is rendering it now
  done        INTEGER NOT NULL DEFAULT 0,
  failures    INTEGER NOT NULL DEFAULT 0,
  PRIMARY KEY (job, interval, render)
) STRICT, WITHOUT ROWID;
CREATE INDEX render_parts_to_do ON render_parts (job, interval, render) WHERE done = 0 AND task IS NULL;
CREATE INDEX render_parts_by_task ON render_parts (task, interval) WHERE task IS NOT NULL;

-- Parts that can be rendered now.
CREATE VIEW ready_parts AS
  SELECT p.job, p.interval, p.render, p.failures FROM render_parts p
  WHERE p.done = 0 AND p.task IS NULL
    AND NOT EXISTS (SELECT 1 FROM intervals i
                    WHERE i.job = p.job AND i.idx BETWEEN p.needs_first AND p.needs_last AND i.done = 0);

-- What a client's request_id made, so that asking again makes nothing new.
CREATE TABLE requests (
  scope       TEXT NOT NULL,  -- the kind of thing made, and for uploads the sequence
  request_id  TEXT NOT NULL,
  fingerprint TEXT NOT NULL,  -- SHA-256 of the arguments
  made_id     TEXT NOT NULL,
  PRIMARY KEY (scope, request_id)
) STRICT, WITHOUT ROWID;
CREATE INDEX requests_by_made ON requests (made_id);
