-- Whose they are: what a call of another tenant asks for does not exist.
ALTER TABLE sequences ADD COLUMN tenant TEXT NOT NULL DEFAULT 'default';
ALTER TABLE jobs ADD COLUMN tenant TEXT NOT NULL DEFAULT 'default';
CREATE INDEX sequences_by_tenant ON sequences (tenant, number);
CREATE INDEX jobs_by_tenant ON jobs (tenant, number);

-- Request ids of different tenants have nothing to do with one another.
UPDATE requests SET scope = scope || '/default' WHERE scope IN ('sequence', 'job');
