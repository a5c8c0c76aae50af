"""Tasks that stop working, and work that would never end: what the server does about real ones. Processes are suspended
and killed from outside, as an operator or the kernel does."""

import os
import shutil
import signal
import tempfile

import harness
from harness import Server, check

SIDE = 4000  # 16 megapixels: a second or so to decode


class WatchOverTasksTest(harness.IntegrationTest):

    @classmethod
    def setUpClass(cls):
        cls.shared = harness.pathlib.Path(tempfile.mkdtemp(prefix="depthtween_watch_over_tasks_"))
        cls.addClassCleanup(shutil.rmtree, cls.shared, ignore_errors=True)
        cls.sequence = cls.shared / "kick"
        harness.synth(cls.sequence, 33)
        # Frames of zeros: small files, large pictures.
        cls.bombs = cls.shared / "bombs"
        recording = harness.Recording(color_frames=2)
        recording.camera.update(width=SIDE, height=SIDE, fx=float(SIDE), fy=float(SIDE), cx=SIDE / 2, cy=SIDE / 2)
        colour = harness.png(SIDE, SIDE, bits=8, value=0)
        recording.color_times = [0.02 * i for i in range(60)]
        recording.depth_times = [0.0, recording.color_times[-1]]
        depth = harness.png(SIDE, SIDE, value=1500)
        recording.files = {f"rgb/{i:06}.png": colour for i in range(60)}
        recording.files |= {f"depth/{i:06}.png": depth for i in range(2)}
        recording.write(cls.bombs)

    def test_suspended_and_killed_tasks_are_tried_again(self):
        with Server(self.folder / "data", options=["--task-stall-seconds", "5"]) as server:
            name = check(server.client("submit", self.sequence)).stdout.strip()
            for number in (signal.SIGSTOP, signal.SIGKILL):
                server.wait_for_progress(name, lambda job: job["progress"]["intervalsTotal"] > 0, "it was prepared")
                task = harness.wait_for("a task", server.tasks)[0]
                os.kill(task.pid, number)
                harness.wait_for("it to be gone", lambda: not task.lives())
            check(server.client("watch", name))
            self.assertEqual(server.job(name)["attempt"], 1, "its tasks were tried again, not the job")
            self.assertIn("no progress for 5 s", server.log_text())
            self.assertIn("SIGKILL", server.log_text())

    def test_pixels_of_a_recording_are_bounded(self):
        with Server(self.folder / "data", options=["--max-sequence-pixels", "900000000"]) as server:
            refused = server.client("submit", self.bombs)
            self.assertEqual(refused.returncode, harness.EXIT_INPUT_REJECTED, refused.stderr)
            self.assertIn("62 frames of 4000 x 4000 pixels", refused.stdout + refused.stderr)

    def test_deleting_a_recording_ends_its_validation(self):
        with Server(self.folder / "data", http=True) as server:
            submitting = server.start_client("submit", self.bombs)
            task = harness.wait_for("the validation", server.tasks)[0]
            sequences = server.http("GET", "/v1/sequences")[1]["sequences"]
            self.assertEqual([sequence["state"] for sequence in sequences], ["STATE_VALIDATING"])
            self.assertEqual(server.http("DELETE", f"/v1/{sequences[0]['name']}")[0], 200)
            harness.wait_for("the process to be gone", lambda: not task.lives())
            self.assertEqual(list((server.data_dir / "sequences").iterdir()), [])
            self.assertNotEqual(submitting.wait(timeout=harness.PATIENCE_S), 0)
            submitting.communicate()
            check(server.client("submit", self.sequence, "--wait"))

    def test_threads_beyond_those_of_the_operator_are_refused(self):
        with Server(self.folder / "data", options=["--max-threads-per-task", "2"]) as server:
            refused = server.client("submit", self.sequence, "--threads", "3")
            self.assertNotEqual(refused.returncode, 0)
            self.assertIn("must be at most 2", refused.stdout + refused.stderr)


if __name__ == "__main__":
    harness.main()
