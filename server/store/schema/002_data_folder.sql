-- The folder that this database belongs to, by the id in its marker: one row, once they have met.
CREATE TABLE data_folder (
  id TEXT NOT NULL
) STRICT;
