-- What accuracy may cost, and what is left out.

ALTER TABLE jobs ADD COLUMN preset TEXT NOT NULL DEFAULT 'balanced';
ALTER TABLE jobs ADD COLUMN without TEXT NOT NULL DEFAULT '';  -- names with commas between them
