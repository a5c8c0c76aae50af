-- Renders: pictures made of finished frames. A job has any number of them, each cut into the job's intervals.

ALTER TABLE jobs ADD COLUMN depth_from TEXT NOT NULL DEFAULT '';  -- id of the job whose depth is taken over

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

-- SQLite cannot change a CHECK: tasks of kind 5, which render, need the table anew. Its numbers go on where they were.
CREATE TABLE new_tasks (
  number         INTEGER PRIMARY KEY AUTOINCREMENT,
  kind           INTEGER NOT NULL CHECK (kind BETWEEN 1 AND 5),
  sequence       INTEGER REFERENCES sequences (number) ON DELETE CASCADE,  -- of a validate task
  job            INTEGER REFERENCES jobs (number) ON DELETE CASCADE,       -- of every other
  running        INTEGER NOT NULL DEFAULT 0,
  failures       INTEGER NOT NULL DEFAULT 0,
  first_interval INTEGER NOT NULL DEFAULT 0,
  interval_count INTEGER NOT NULL DEFAULT 0,
  render         INTEGER NOT NULL DEFAULT 0,
  CHECK ((kind = 1) = (sequence IS NOT NULL) AND (kind = 1) = (job IS NULL))
) STRICT;
INSERT INTO sqlite_sequence (name, seq) SELECT 'new_tasks', seq FROM sqlite_sequence WHERE name = 'tasks';
INSERT INTO new_tasks (number, kind, sequence, job, running, failures, first_interval, interval_count)
  SELECT number, kind, sequence, job, running, failures, first_interval, interval_count FROM tasks;
DROP TABLE tasks;
ALTER TABLE new_tasks RENAME TO tasks;
CREATE INDEX tasks_by_job ON tasks (job);

-- Parts that can be rendered now.
CREATE VIEW ready_parts AS
  SELECT p.job, p.interval, p.render, p.failures FROM render_parts p
  WHERE p.done = 0 AND p.task IS NULL
    AND NOT EXISTS (SELECT 1 FROM intervals i
                    WHERE i.job = p.job AND i.idx BETWEEN p.needs_first AND p.needs_last AND i.done = 0);
