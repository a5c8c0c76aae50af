-- Checksums of files at rest: 4 bytes for each block, as server/store/checksums.h makes them.

-- NULL until the file is complete, and for what was uploaded before there were any.
ALTER TABLE files ADD COLUMN checksums BLOB;

-- When bytes of an upload were last recorded; of older ones, when it began.
ALTER TABLE uploads ADD COLUMN progress_time_us INTEGER NOT NULL DEFAULT 0;
UPDATE uploads SET progress_time_us = create_time_us;
CREATE INDEX uploads_unfinished ON uploads (finished) WHERE finished = 0;

-- Recorded in the transaction that announces them.
CREATE TABLE job_files (
  job        INTEGER NOT NULL REFERENCES jobs (number) ON DELETE CASCADE,
  path       TEXT    NOT NULL,  -- relative to the job's folder: "out/depth/000001.png"
  size_bytes INTEGER NOT NULL CHECK (size_bytes >= 0),
  checksums  BLOB    NOT NULL,
  PRIMARY KEY (job, path)
) STRICT, WITHOUT ROWID;

-- How far the scrub is: one row, once it has begun.
CREATE TABLE scrub (
  start_time_us INTEGER NOT NULL,  -- of this round
  cursor        TEXT    NOT NULL   -- of the last file checked in it; 'end': the round is over
) STRICT;
