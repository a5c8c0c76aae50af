"""Starting, stopping, cancelling, and running out of disk: what the server promises to those who operate it."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import tempfile
import unittest

import harness
from harness import Server, check

FRAMES = 65  # eight intervals


class LifecycleTest(harness.IntegrationTest):

    @classmethod
    def setUpClass(cls):
        cls.shared = harness.pathlib.Path(tempfile.mkdtemp(prefix="depthtween_lifecycle_"))
        cls.addClassCleanup(shutil.rmtree, cls.shared, ignore_errors=True)
        cls.sequence = cls.shared / "kick"
        harness.synth(cls.sequence, FRAMES, size="240x180")

    def submit_and_wait_until_it_computes(self, server):
        name = check(server.client("submit", self.sequence)).stdout.strip()
        server.wait_for_progress(name, lambda job: job["progress"]["framesDone"] > 0, "frames were finished")
        return name

    def test_cancel_frees_the_processor(self):
        with Server(self.folder / "data") as server:
            name = self.submit_and_wait_until_it_computes(server)
            # The task at work now may end by itself before the cancel; then there is another.
            tasks = harness.wait_for("a task", server.tasks)
            spent_before = sum(task.cpu_seconds() for task in tasks)
            check(server.client("cancel", name))
            spent = spent_before

            def all_gone():
                nonlocal spent
                with contextlib.suppress(OSError):  # gone while it was being read
                    spent = max(spent, sum(task.cpu_seconds() for task in tasks))
                return not any(task.lives() for task in tasks)

            harness.wait_for("the tasks to end", all_gone)
            harness.wait_for("the job to be cancelled", lambda: server.job(name)["state"] == "STATE_CANCELLED")
            self.assertEqual(server.tasks(), [])
            # In processor seconds of its one thread, so that a busy machine does not fail the test.
            self.assertLess(spent - spent_before, 2.0)

            watched = server.client("watch", name)
            self.assertEqual(watched.returncode, harness.EXIT_JOB_CANCELLED)
            fetched = server.client("fetch", name, "-o", self.folder / "out")
            self.assertEqual(fetched.returncode, harness.EXIT_JOB_CANCELLED)
            self.assertGreater(len(list((self.folder / "out" / "depth").glob("*.png"))), 0)

            # The same submit takes it up again.
            again = server.client_json("submit", self.sequence, "-o", str(self.folder / "out"))
            self.assertEqual(again["job"]["name"], name)
            self.assertEqual(len(list((self.folder / "out" / "depth").glob("*.png"))), FRAMES)
            self.assertEqual(check(server.client("delete", name, again["sequence"]["name"])).stdout.split(),
                             [name, again["sequence"]["name"]])
            self.assertEqual(server.client_json("list")["jobs"], [])
            self.assertEqual([path for path in server.data_dir.glob("jobs/*")], [])

    def test_sigterm_stops_gracefully_and_work_goes_on_after_a_restart(self):
        with Server(self.folder / "data") as server:
            name = self.submit_and_wait_until_it_computes(server)
            watcher = server.start_client("watch", name, "--json")
            self.addCleanup(lambda: watcher.poll() is None and watcher.kill())
            self.assertIn("snapshot", watcher.stdout.readline())  # it is there before the server goes
            tasks = server.tasks()
            self.assertEqual(server.stop(), 0, server.log_text())
            self.assertEqual([task.pid for task in tasks if task.lives()], [])
            server.start()
            _, stderr = watcher.communicate(timeout=harness.PATIENCE_S)
            self.assertEqual(watcher.returncode, 0, stderr)
            self.assertEqual(server.job(name)["state"], "STATE_SUCCEEDED")

    def test_draining_with_open_streams_ends_in_time_and_loses_nothing(self):
        local = self.folder / "local"
        harness.upsample(self.sequence, local, "--preset", "fast")
        with Server(self.folder / "data", options=["--drain-seconds", "1"]) as server:
            clients = [server.start_client("submit", str(self.sequence), "--preset", "fast", "-o",
                                           str(self.folder / "out"))]
            self.addCleanup(lambda: clients[0].poll() is None and clients[0].kill())
            # A suspended task outlasts every drain, so the server must not wait for its end.
            harness.wait_for("a finished frame", lambda: any(server.data_dir.glob("jobs/*/out/depth/*.png")))
            tasks = harness.wait_for("a task", server.tasks)
            for task in tasks:
                with contextlib.suppress(OSError):  # it may have ended by itself
                    os.kill(task.pid, signal.SIGSTOP)
            name = server.client_json("list")["jobs"][0]["name"]
            clients.append(server.start_client("watch", name, "--json"))
            self.addCleanup(lambda: clients[1].poll() is None and clients[1].kill())
            self.assertIn("snapshot", clients[1].stdout.readline())
            self.assertEqual(server.stop(), 0, server.log_text())
            self.assertEqual([task.pid for task in tasks if task.lives()], [])
            server.start()
            for client in clients:
                _, stderr = client.communicate(timeout=harness.PATIENCE_S)
                self.assertEqual(client.returncode, 0, stderr)
            self.assertEqual(server.job(name)["state"], "STATE_SUCCEEDED")
            self.assert_same_result(self.folder / "out", local)

    def test_first_contact_waits_for_the_server(self):
        with Server(self.folder / "data") as server:
            name = check(server.client("submit", self.sequence, "--method", "hold", "--wait")).stdout.strip()
            server.kill()
            waiting = [server.start_client("fetch", name, "-o", str(self.folder / "out")),
                       server.start_client("status", name), server.start_client("list")]
            for client in waiting:
                self.addCleanup(lambda client=client: client.poll() is None and client.kill())
                self.assertIn("trying again", client.stderr.readline())
            server.start()
            for client in waiting:
                _, stderr = client.communicate(timeout=harness.PATIENCE_S)
                self.assertEqual(client.returncode, 0, stderr)
            self.assertEqual(len(list((self.folder / "out" / "depth").glob("*.png"))), FRAMES)

    def test_one_data_folder_belongs_to_one_server(self):
        with Server(self.folder / "data") as server:
            second = harness.run("depthtween-server", "serve", "--data-dir", server.data_dir, "--listen", "127.0.0.1:0")
            self.assertEqual(second.returncode, 1)
            self.assertIn(str(server.process.pid), second.stderr)
            self.assertTrue(server.is_serving())

    def test_healthcheck_tells_a_server_from_none(self):
        with Server(self.folder / "data") as server:
            self.assertTrue(server.is_serving())
            server.kill()
            self.assertFalse(server.is_serving())


class LostFilesTest(harness.IntegrationTest):
    """Somebody deletes files of a result on the server's disk: what is left is of use, and what is lost is named."""

    def test_fetch_brings_all_that_is_left(self):
        harness.Recording(color_frames=9).write(self.folder / "recording")
        order = ["submit", self.folder / "recording", "--method", "hold"]
        with Server(self.folder / "data") as server:
            name = check(server.client(*order, "--wait")).stdout.strip()
            out = server.data_dir / name / "out"
            for file in ("depth/000002.png", "depth/000005.png", "depth/000006.png", "provenance/000000.png",
                         "report.json"):
                (out / file).unlink()
            for again in range(2):
                with self.subTest(again=again):
                    fetched = server.client("fetch", name, "-o", self.folder / "out")
                    self.assertEqual(fetched.returncode, harness.EXIT_FAILED)
                    self.assertIn("3 frames of depth (2, 5-6), 1 frame of provenance (0) and report.json are lost",
                                  fetched.stderr)
                    self.assertIn(f"depthtween delete {name}", fetched.stderr)
                    self.assertEqual(harness.result_files(self.folder / "out").keys() - {".fetch.json"},
                                     {file for file in harness.result_files(out) if not file.startswith("interval")})
            told = json.loads(server.client("fetch", name, "-o", self.folder / "out", "--json").stdout)
            self.assertFalse(told["complete"])
            self.assertEqual(told["lost"], [{"output": f"{name}/outputs/depth", "frames": [2, 5, 6]},
                                            {"output": f"{name}/outputs/provenance", "frames": [0]},
                                            {"output": f"{name}/outputs/report"}])
            # What it says to do about it.
            check(server.client("delete", name))
            again = server.client_json(*order, "-o", self.folder / "anew")
            self.assertTrue(again["output"]["complete"])
            self.assertEqual(again["output"]["lost"], [])
            self.assertEqual(len(list((self.folder / "anew" / "depth").glob("*.png"))), 9)

    def test_pictures_say_which_of_their_frames_are_lost(self):
        harness.synth(self.folder / "kick", 17, size="64x48")
        with Server(self.folder / "data") as server:
            name = check(server.client("submit", self.folder / "kick", "--preset", "fast", "--dof", "--wait")).stdout.strip()
            out = server.data_dir / name / "out"
            picture = ["--dof", "-o", self.folder / "picture.png", "--force"]
            (out / "motion" / "000005.npz").unlink()
            check(server.client("render", name, *picture, "--frame", "13"))  # out of its reach
            lost = server.client("render", name, *picture, "--frame", "3")
            self.assertEqual(lost.returncode, harness.EXIT_FAILED)
            self.assertIn(f"the motion of frame 5 of {name} was made, but its file is lost", lost.stderr)
            clip = server.client("render", name, "--stereo", "-o", self.folder / "stereo")
            self.assertEqual(clip.returncode, harness.EXIT_JOB_FAILED)
            self.assertIn(f"the motion of frame 5 of {name} was made, but its file is lost", clip.stderr)
            self.assertIn("DATA_LOSS", clip.stderr)
            (out / "depth" / "000014.png").unlink()
            for frame in ("13", "14"):
                lost = server.client("render", name, *picture, "--frame", frame)
                self.assertEqual(lost.returncode, harness.EXIT_FAILED)
                self.assertIn(f"frame 14 of {name}/outputs/depth was made, but its file is lost", lost.stderr)

            # One that kept no motion has none to lose: pictures do without, as ever.
            bare = check(server.client("submit", self.folder / "kick", "--method", "hold", "--wait")).stdout.strip()
            check(server.client("render", bare, *picture, "--frame", "3"))


class SmallDisk:
    """A file system of a few megabytes, filled and emptied at will."""

    def __init__(self, folder, size_mb):
        self.folder = folder
        folder.mkdir()
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size_mb}m", "none", folder],
                                 capture_output=True, text=True)
        if mounted.returncode != 0:
            raise RuntimeError("cannot mount a tmpfs: run as root, in a container with --cap-add SYS_ADMIN: "
                               + mounted.stderr.strip())

    def fill(self, leave_bytes):
        with open(self.folder / "filler", "ab", buffering=0) as filler:
            try:
                while True:
                    free = os.statvfs(self.folder)
                    missing = free.f_bavail * free.f_bsize - leave_bytes
                    if missing <= 0:
                        return
                    filler.write(b"\0" * min(missing, 1 << 16))
            except OSError:
                return

    def empty(self):
        (self.folder / "filler").unlink()

    def remove(self):
        subprocess.run(["umount", "--lazy", self.folder], check=True)


class FullDiskTest(harness.IntegrationTest):

    def setUp(self):
        super().setUp()
        self.sequence = self.folder / "kick"
        harness.synth(self.sequence, frames=33)
        self.disk = SmallDisk(self.folder / "disk", size_mb=48)
        self.addCleanup(self.disk.remove)

    def server(self):
        return Server(self.disk.folder / "data", options=["--reserved-disk-bytes", "0"])

    def test_upload_fails_clearly_and_goes_on_when_there_is_room(self):
        with self.server() as server:
            harness.Recording().write(self.folder / "small")
            check(server.client("submit", self.folder / "small", "--wait"))
            self.disk.fill(leave_bytes=256 << 10)
            failed = server.client("submit", self.sequence)
            self.assertEqual(failed.returncode, harness.EXIT_FAILED, failed.stderr)
            self.assertRegex(failed.stderr, "disk|room|space")
            self.assertTrue(server.is_serving())
            states = {job["state"] for job in server.client_json("list")["jobs"]}
            self.assertEqual(states, {"STATE_SUCCEEDED"})
            self.disk.empty()
            check(server.client("submit", self.sequence))

    def test_a_full_disk_is_made_room_on_by_deleting(self):
        with self.server() as server:
            name = check(server.client("submit", self.sequence, "--method", "hold", "--wait")).stdout.strip()
            harness.Recording().write(self.folder / "small")
            self.disk.fill(leave_bytes=0)
            refused = server.client("submit", self.folder / "small", "--wait", patience_s=1)
            self.assertEqual(refused.returncode, harness.EXIT_FAILED)
            self.assertRegex(refused.stderr, "delete old jobs and sequences")
            check(server.client("delete", name))
            self.assertEqual(server.client_json("list")["jobs"], [])
            check(server.client("submit", self.folder / "small", "--wait"))

    def test_task_fails_clearly_and_goes_on_when_there_is_room(self):
        local = self.folder / "local"
        harness.upsample(self.sequence, local)
        with self.server() as server:
            name = check(server.client("submit", self.sequence)).stdout.strip()
            server.wait_for_progress(name, lambda job: job["progress"]["intervalsDone"] >= 1, "an interval was finished")
            # Less than an interval's frames, more than it takes to record that they could not be written.
            self.disk.fill(leave_bytes=128 << 10)
            watched = server.client("watch", name)
            self.assertEqual(watched.returncode, harness.EXIT_JOB_FAILED, watched.stderr)
            self.assertIn("RESOURCE_EXHAUSTED", watched.stderr)
            self.assertTrue(server.is_serving())
            self.disk.empty()
            check(server.client("submit", self.sequence, "-o", self.folder / "out"))
            self.assert_same_result(self.folder / "out", local)


if __name__ == "__main__":
    harness.main()
