"""More connections than the server may have open files: no job fails, and when they end the server accepts others."""

import contextlib
import resource
import socket

import harness
from harness import Server, check, wait_for

LIMIT = 256
CONNECTIONS = 300  # of nobody: they say nothing
JOBS = 6


class FileLimitTest(harness.IntegrationTest):

    def test_idle_connections_fail_no_job(self):
        harness.synth(self.folder / "clip", 33)
        with Server(self.folder / "data", workers=2) as server, contextlib.ExitStack() as connections:
            # The same recording, and orders that differ.
            jobs = [check(server.client("submit", self.folder / "clip", "--priority", str(i))).stdout.strip()
                    for i in range(JOBS)]
            resource.prlimit(server.process.pid, resource.RLIMIT_NOFILE, (LIMIT, LIMIT))
            for _ in range(CONNECTIONS):
                connections.enter_context(socket.create_connection(("127.0.0.1", server.port)))
            wait_for("the alarm", lambda: "too many connections" in server.log_text())
            connections.close()
            for job in jobs:
                wait_for(f"{job} to end", lambda job=job: server.job(job)["state"] == "STATE_SUCCEEDED")
                self.assertEqual(server.job(job)["attempt"], 1)


if __name__ == "__main__":
    harness.main()
