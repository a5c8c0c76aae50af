"""Work that would never end is refused before it costs anything: too many pixels, too many threads."""

import shutil
import tempfile

import harness
from harness import Server

SIDE = 4000  # 16 megapixels: a second or so to decode


class TaskLimitsTest(harness.IntegrationTest):

    @classmethod
    def setUpClass(cls):
        cls.shared = harness.pathlib.Path(tempfile.mkdtemp(prefix="depthtween_task_limits_"))
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

    def test_pixels_of_a_recording_are_bounded(self):
        with Server(self.folder / "data", options=["--max-sequence-pixels", "900000000"]) as server:
            refused = server.client("submit", self.bombs)
            self.assertEqual(refused.returncode, harness.EXIT_INPUT_REJECTED, refused.stderr)
            self.assertIn("62 frames of 4000 x 4000 pixels", refused.stdout + refused.stderr)

    def test_threads_beyond_those_of_the_operator_are_refused(self):
        with Server(self.folder / "data", options=["--max-threads-per-task", "2"]) as server:
            refused = server.client("submit", self.sequence, "--threads", "3")
            self.assertNotEqual(refused.returncode, 0)
            self.assertIn("must be at most 2", refused.stdout + refused.stderr)


if __name__ == "__main__":
    harness.main()
