-- What a job measures on its own recording before it computes.

ALTER TABLE jobs ADD COLUMN self_check INTEGER NOT NULL DEFAULT 0;  -- whether it was asked for
ALTER TABLE jobs ADD COLUMN self_check_result TEXT;                 -- JSON of SelfCheck, once it was measured

-- Tasks of kind 6, which measure, need the table anew; as in 002, its numbers go on where they were.
CREATE TABLE new_tasks (
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
INSERT INTO sqlite_sequence (name, seq) SELECT 'new_tasks', seq FROM sqlite_sequence WHERE name = 'tasks';
INSERT INTO new_tasks (number, kind, sequence, job, running, failures, first_interval, interval_count, render)
  SELECT number, kind, sequence, job, running, failures, first_interval, interval_count, render FROM tasks;
DROP TABLE tasks;
ALTER TABLE new_tasks RENAME TO tasks;
CREATE INDEX tasks_by_job ON tasks (job);
