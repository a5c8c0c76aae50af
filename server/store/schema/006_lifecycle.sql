-- How long a job may wait and run, microseconds; 0: as long as the server lets it. The wait begins anew with a retry.
ALTER TABLE jobs ADD COLUMN queue_limit_us INTEGER NOT NULL DEFAULT 0;
ALTER TABLE jobs ADD COLUMN run_limit_us INTEGER NOT NULL DEFAULT 0;
ALTER TABLE jobs ADD COLUMN queue_time_us INTEGER NOT NULL DEFAULT 0;
UPDATE jobs SET queue_time_us = create_time_us;

-- What is pinned is never collected.
ALTER TABLE jobs ADD COLUMN pinned INTEGER NOT NULL DEFAULT 0;
ALTER TABLE sequences ADD COLUMN pinned INTEGER NOT NULL DEFAULT 0;
