"""Tasks that are stopped, killed or hang get another attempt, and not for ever; a cancel frees the processor whatever is
at work. The tasks are the real ones, held in a known state by a program that begins them. The truth of a result is what
`depthtween-core upsample` writes."""

import contextlib
import os
import pathlib
import shutil
import signal
import tempfile

import harness
from harness import Server, check

FRAMES = 33  # four intervals
STALL = ["--task-stall-seconds", "2"]

# Programs in place of depthtween-core. Each task is to be started by them, and not forked by a host.
#
# Its tasks of one kind hang, the first TIMES times: they sleep and say nothing. It stands beside the folder that counts
# them.
HANGING_CORE = """#!/bin/sh
[ "$1" = task-host ] && exit 2
if [ "$1" = task ] && [ "$2" = {kind} ] && [ $(ls {counts} | wc -l) -lt {times} ]; then
  touch {counts}/$$
  exec sleep 100000
fi
exec {core} "$@"
"""
# The first task of each of these kinds suspends itself before it begins.
HOLDING_CORE = """#!/bin/sh
[ "$1" = task-host ] && exit 2
case "$2" in {kinds})
  if [ "$1" = task ] && [ ! -e {held}/$2 ]; then
    touch {held}/$2
    kill -STOP $$
  fi
esac
exec {core} "$@"
"""


def kind_of(process):
    """What a task does: "validate", "prepare", "intervals", "assemble"; "" for another process, or one that is gone."""
    with contextlib.suppress(OSError):
        words = pathlib.Path(f"/proc/{process.pid}/cmdline").read_bytes().decode().split("\0")
        if "task" in words:
            return words[words.index("task") + 1]
    return ""


class TaskFaultsTest(harness.IntegrationTest):

    @classmethod
    def setUpClass(cls):
        cls.shared = pathlib.Path(tempfile.mkdtemp(prefix="depthtween_task_faults_"))
        cls.addClassCleanup(shutil.rmtree, cls.shared, ignore_errors=True)
        cls.sequence = cls.shared / "kick"
        cls.local = cls.shared / "local"
        harness.synth(cls.sequence, FRAMES)
        harness.upsample(cls.sequence, cls.local)

    def catch(self, server, kind):
        """The task of this kind that has suspended itself, see holding()."""

        def caught():
            for task in server.tasks():
                with contextlib.suppress(OSError):
                    if kind_of(task) == kind and task.state() == "T":
                        return task
            return None

        return harness.wait_for(f"a task of kind {kind}", caught)

    def submit_and_catch(self, server, kind, *options):
        """Returns the job's name and its task."""
        name = check(server.client("submit", self.sequence, *options)).stdout.strip()
        return name, self.catch(server, kind)

    def holding(self, *kinds):
        """Options of a server that suspends the first task of each of these kinds."""
        held = pathlib.Path(tempfile.mkdtemp(dir=self.folder))
        text = HOLDING_CORE.format(kinds="|".join(kinds), held=held, core=harness.BIN / "depthtween-core")
        return ["--core-binary", self.program(text, held.name + "_core")]

    def program(self, text, name="core"):
        program = self.folder / name
        program.write_text(text)
        program.chmod(0o755)
        return program

    def wait_until_gone(self, task):
        harness.wait_for(f"the end of task {task.pid}", lambda: not task.lives())

    def test_a_stopped_and_a_killed_task_get_another_attempt(self):
        with Server(self.folder / "data", options=STALL + self.holding("prepare", "intervals")) as server:
            name, stopped = self.submit_and_catch(server, "prepare")
            self.wait_until_gone(stopped)  # by the watchdog
            killed = self.catch(server, "intervals")
            os.kill(killed.pid, signal.SIGKILL)
            watched = server.client("watch", name)
            self.assertEqual(watched.returncode, 0, watched.stderr)
            check(server.client("fetch", name, "-o", self.folder / "out"))
            self.assert_same_result(self.folder / "out", self.local)
            self.assertIn("task ended", server.log_text())
            self.assertEqual(list((server.data_dir / "tasks").iterdir()), [])

    def test_a_hanging_task_gets_another_attempt(self):
        counts = self.folder / "counts"
        counts.mkdir()
        with Server(self.folder / "data", options=[*STALL, "--core-binary", self.hanging_core(counts, 2)]) as server:
            check(server.client("submit", self.sequence, "-o", self.folder / "out"))
            self.assertEqual(len(list(counts.iterdir())), 2)
            self.assert_same_result(self.folder / "out", self.local)

    def test_attempts_are_bounded_and_the_last_error_is_kept(self):
        counts = self.folder / "counts"
        counts.mkdir()
        with Server(self.folder / "data", options=[*STALL, "--core-binary", self.hanging_core(counts, 1000)]) as server:
            submitted = server.client("submit", self.sequence, "-o", self.folder / "out")
            self.assertEqual(submitted.returncode, harness.EXIT_JOB_FAILED, submitted.stderr)
            self.assertEqual(len(list(counts.iterdir())), 3)
            job = server.client_json("list")["jobs"][0]
            self.assertEqual(job["state"], "STATE_FAILED")
            self.assertIn("no progress for 2 s", job["error"]["message"])
            # The worker is free again, for what does not hang.
            self.assertEqual(server.tasks(), [])
            other = self.folder / "other"
            harness.synth(other, 9, size="64x48")
            ready = server.client("submit", other)
            self.assertEqual(ready.returncode, 0, ready.stderr)

    def hanging_core(self, counts, times, kind="prepare"):
        return self.program(HANGING_CORE.format(kind=kind, counts=counts, times=times,
                                                core=harness.BIN / "depthtween-core"))

    def test_cancel_frees_the_processor_in_every_state(self):
        for kind, options in (("prepare", []), ("self-check", ["--self-check"]), ("intervals", ["--key-every", "2"]),
                              ("assemble", ["--scene-flow"])):
            with self.subTest(kind), Server(self.folder / f"data_{kind}", options=self.holding(kind)) as server:
                name, task = self.submit_and_catch(server, kind, *options)
                self.assertEqual(server.job(name)["state"], "STATE_RUNNING")
                os.kill(task.pid, signal.SIGCONT)
                self.ends_soon(task, lambda server=server, name=name: check(server.client("cancel", name)))
                harness.wait_for("the job to be cancelled", lambda server=server, name=name:
                                 server.job(name)["state"] == "STATE_CANCELLED")
                self.assertEqual(server.tasks(), [])

    def test_cancel_of_a_queued_job_begins_nothing(self):
        with Server(self.folder / "data", options=self.holding("prepare")) as server:
            first, busy = self.submit_and_catch(server, "prepare")
            queued = check(server.client("submit", self.sequence, "--method", "hold")).stdout.strip()
            self.assertEqual(server.job(queued)["state"], "STATE_QUEUED")
            check(server.client("cancel", queued))
            self.assertEqual(server.job(queued)["state"], "STATE_CANCELLED")
            self.assertEqual([task.pid for task in server.tasks()], [busy.pid])
            # A suspended task ends, too.
            self.ends_soon(busy, lambda: check(server.client("cancel", first)))
            harness.wait_for("the job to be cancelled", lambda: server.job(first)["state"] == "STATE_CANCELLED")

    def test_deleting_a_recording_ends_its_validation(self):
        with Server(self.folder / "data", options=self.holding("validate")) as server:
            client = server.start_client("submit", str(self.sequence))
            self.addCleanup(lambda: client.poll() is None and client.kill())
            task = self.catch(server, "validate")
            sequence = server.client_json("list", "--sequences")["sequences"][0]
            self.assertEqual(sequence["state"], "STATE_VALIDATING")
            # It stays suspended, and ends all the same.
            self.ends_soon(task, lambda: check(server.client("delete", sequence["name"])))
            _, stderr = client.communicate(timeout=harness.PATIENCE_S)
            self.assertNotEqual(client.returncode, 0, stderr)
            self.assertEqual(server.client_json("list", "--sequences")["sequences"], [])
            harness.wait_for("its files to be gone", lambda: not any((server.data_dir / "sequences").iterdir()))
            self.assertEqual(server.tasks(), [])

    def ends_soon(self, task, act):
        """`task` is gone soon after act(). In processor seconds of its one thread, so that a busy machine does not fail
        the test."""
        before = last = task.cpu_seconds()
        act()

        def gone():
            nonlocal last
            with contextlib.suppress(OSError):  # gone while it was being read
                last = max(last, task.cpu_seconds())
            return not task.lives()

        harness.wait_for("the task to end", gone)
        self.assertLess(last - before, 2.0)


if __name__ == "__main__":
    harness.main()
