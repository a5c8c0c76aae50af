-- Higher goes first, among the jobs of one tenant.
ALTER TABLE jobs ADD COLUMN priority INTEGER NOT NULL DEFAULT 0;

-- When each tenant was last given a worker, so that tenants take turns: the number of its task.
CREATE TABLE tenants (
  name      TEXT    NOT NULL PRIMARY KEY,
  last_task INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
