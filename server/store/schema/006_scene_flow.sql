-- Whether a job gives the 3-D motion of its frames too.

ALTER TABLE jobs ADD COLUMN scene_flow INTEGER NOT NULL DEFAULT 0;
