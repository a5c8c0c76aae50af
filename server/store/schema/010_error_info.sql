-- The machine-readable reason of a job's error, which its code and message alone do not hold.

ALTER TABLE jobs ADD COLUMN error_info TEXT;  -- JSON of ErrorInfo; NULL: no error, none was given, or it is older
