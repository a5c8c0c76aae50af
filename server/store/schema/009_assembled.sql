-- Which frames have a file of what is made for each frame at the end of a job, so that one that is lost is missed.

ALTER TABLE frames ADD COLUMN assembled INTEGER;  -- NULL: the job ends with no such files, has not ended, or is older
