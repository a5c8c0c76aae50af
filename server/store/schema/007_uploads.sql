-- What a client wishes to remember with an upload: tus' Upload-Metadata.
ALTER TABLE uploads ADD COLUMN metadata TEXT NOT NULL DEFAULT '';

-- The name of the zip archive that its files came out of.
ALTER TABLE sequences ADD COLUMN archive TEXT NOT NULL DEFAULT '';
