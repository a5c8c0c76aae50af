-- What a job assumes about its recording, or could not make sense of, in words.
ALTER TABLE jobs ADD COLUMN warnings TEXT NOT NULL DEFAULT '[]';  -- JSON array of strings; filled by the plan
