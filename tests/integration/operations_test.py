"""What an operator tells a running server: limits, workers, drain, retention, pins and scrub, with the real programs."""

import unittest

import harness
from harness import Server, check

FRAMES = 17


class OperationsTest(harness.IntegrationTest):

    def test_an_operator_drains_collects_and_changes_limits(self):
        sequence = self.folder / "kick"
        harness.synth(sequence, FRAMES, size="160x120")
        # Of a recording that nobody has used for a moment, a job that ended a moment ago goes too.
        options = ("--keep-succeeded-days", "0.00001", "--max-run-hours", "10")
        with Server(self.folder / "data", options=options) as server:
            check(server.client("submit", sequence, "--preset", "best", "--wait"))  # the recording is READY
            check(server.client("admin", "drain"))
            first = server.client_json("submit", sequence)["job"]["name"]
            pinned = server.client_json("submit", sequence, "--pin", "--preset", "fast", "--run-limit", "1h")["job"]
            self.assertEqual(pinned["runTimeLimit"], "3600s")
            self.assertEqual(server.job(first)["state"], "STATE_QUEUED")
            drained = server.client_json("admin", "drain")
            self.assertEqual((drained["draining"], drained["runningTasks"]), (True, 0))
            self.assertIn("drained", check(server.client("admin", "drain")).stdout)
            workers = server.client_json("admin", "workers")
            self.assertEqual(workers["workers"], [])

            check(server.client("admin", "limits", "max_queued_jobs=2"))
            refused = server.client("submit", sequence, "--causal")
            self.assertNotEqual(refused.returncode, 0)
            self.assertIn("the queue is full with 2 jobs", refused.stderr)
            wrong = server.client("admin", "limits", "max_jobs=2")
            self.assertEqual(wrong.returncode, harness.EXIT_USAGE)
            self.assertIn("max_queued_jobs", wrong.stderr)
            self.assertIn("max_queued_jobs", check(server.client("admin", "limits")).stdout)

            check(server.client("admin", "drain", "--resume"))
            for name in (first, pinned["name"]):
                check(server.client("watch", name))
            job = server.job(pinned["name"])
            self.assertTrue(job["pinned"])
            self.assertNotIn("expireTime", {key for key, value in job.items() if value})

            def collectable():
                return server.client_json("admin", "collect", "--dry-run")["collected"]

            harness.wait_for("both jobs to be old enough", lambda: len(collectable()) == 2)
            self.assertEqual(collectable()[1]["resource"], first)
            shown = check(server.client("admin", "collect")).stdout
            self.assertIn(first, shown)
            self.assertIn("expired", shown)
            listed = [one["name"] for one in server.client_json("list")["jobs"]]
            self.assertEqual(listed, [pinned["name"]])
            self.assertFalse((self.folder / "data" / first).exists())

            check(server.client("unpin", pinned["name"]))
            harness.wait_for("the other job to be old enough", collectable)
            check(server.client("pin", "sequences/" + job["sequence"].split("/")[1]))
            self.assertEqual(collectable()[0]["resource"], pinned["name"])

            check(server.client("admin", "scrub", "--start"))
            harness.wait_for("the round to end", lambda: not server.client_json("admin", "scrub")["running"])
            self.assertIn("0 damaged files", check(server.client("admin", "scrub")).stdout)

    def test_a_job_beyond_its_time_fails_and_says_so(self):
        sequence = self.folder / "kick"
        harness.synth(sequence, FRAMES, size="160x120")
        with Server(self.folder / "data") as server:
            check(server.client("submit", sequence, "--preset", "fast", "--wait"))  # the recording is READY
            check(server.client("admin", "drain"))
            waited = server.client("submit", sequence, "--wait", "--queue-limit", "1s")
            self.assertEqual(waited.returncode, harness.EXIT_JOB_FAILED)
            self.assertIn("queue_time_limit", waited.stderr)


if __name__ == "__main__":
    unittest.main()
