-- Choices of the paper that are taken as printed.

ALTER TABLE jobs ADD COLUMN literal TEXT NOT NULL DEFAULT '';  -- names with commas between them
