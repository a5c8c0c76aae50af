-- Where the end of a job is told, and how far that is: a row for each job that asks for it.
CREATE TABLE webhooks (
  job          INTEGER PRIMARY KEY REFERENCES jobs (number) ON DELETE CASCADE,
  url          TEXT    NOT NULL,
  state        INTEGER NOT NULL DEFAULT 1 CHECK (state BETWEEN 1 AND 4),  -- WebhookState
  event_id     TEXT    NOT NULL DEFAULT '',  -- of the end that is told; '': there is none yet
  attempts     INTEGER NOT NULL DEFAULT 0,
  next_time_us INTEGER,                      -- of the next attempt, while there is to be one
  last_error   TEXT    NOT NULL DEFAULT ''
) STRICT;
CREATE INDEX webhooks_to_send ON webhooks (next_time_us) WHERE state = 2;
CREATE INDEX webhooks_by_event ON webhooks (event_id) WHERE event_id <> '';
