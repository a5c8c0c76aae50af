-- How depth frames come onto the colour camera's clock, and whether frames may look ahead.

ALTER TABLE jobs ADD COLUMN causal INTEGER NOT NULL DEFAULT 0;
ALTER TABLE jobs ADD COLUMN clock TEXT NOT NULL DEFAULT 'stamps';
ALTER TABLE jobs ADD COLUMN clock_estimate TEXT;  -- JSON of ClockEstimate, once there is a plan
