"""Renders: the same pictures and videos on this machine and through the server, whatever happens to the server on the
way. The truth is what `depthtween-core render` writes."""

import json
import os
import pathlib
import shutil
import signal
import tempfile

import harness
from harness import Server, check, run

FRAMES = 25  # 240 fps colour, 30 fps depth: four depth frames, three intervals of eight frames
DOF = ["--dof", "--fstop", "1.4", "--focus-track", "12,80,60"]
STEREO = ["--stereo", "--format", "half-sbs", "--metadata"]


def pictures(folder):
    return {path.name: path.read_bytes() for path in sorted(pathlib.Path(folder).glob("*.png"))}


class RenderTest(harness.IntegrationTest):

    @classmethod
    def setUpClass(cls):
        cls.shared = pathlib.Path(tempfile.mkdtemp(prefix="depthtween_render_"))
        cls.addClassCleanup(shutil.rmtree, cls.shared, ignore_errors=True)
        cls.sequence = cls.shared / "kick"
        harness.synth(cls.sequence, FRAMES)
        cls.result = cls.shared / "result"
        harness.upsample(cls.sequence, cls.result, "--keep-motion")
        cls.pictures = {}
        for name, options in (("dof", DOF), ("stereo", STEREO)):
            check(run("depthtween-core", "render", cls.result, *options, "-o", cls.shared / name))
            cls.pictures[name] = pictures(cls.shared / name)
            assert len(cls.pictures[name]) == FRAMES
            check(run("depthtween-core", "render", cls.result, *options, "-o", cls.shared / f"{name}.mp4"))

    def assert_local_pictures(self, out):
        for name, expected in self.pictures.items():
            got = pictures(pathlib.Path(out) / name)
            self.assertEqual(sorted(got), sorted(expected))
            self.assertEqual([file for file in got if got[file] != expected[file]], [], f"{name}: pictures that differ")
        self.assertEqual((pathlib.Path(out) / "dof.mp4").read_bytes(), (self.shared / "dof.mp4").read_bytes())
        self.assertEqual((pathlib.Path(out) / "stereo_LR.mp4").read_bytes(),
                         (self.shared / "stereo_LR.mp4").read_bytes())

    def test_threads_and_batches_do_not_show(self):
        for threads in (1, 3):
            out = self.folder / f"dof{threads}"
            check(run("depthtween-core", "render", self.result, *DOF, "--threads", threads, "-o", out))
            self.assertEqual(pictures(out), self.pictures["dof"])

    def test_a_recording_is_upsampled_on_the_way(self):
        out = self.folder / "dof"
        check(run("depthtween-core", "render", self.sequence, *DOF, "-o", out))
        self.assertEqual(pictures(out), self.pictures["dof"])
        # The depth in between is gone, and what is there is not replaced unasked.
        self.assertEqual([path.name for path in self.folder.iterdir()], ["dof"])
        refused = run("depthtween-core", "render", self.sequence, *DOF, "-o", out)
        self.assertEqual(refused.returncode, 1)
        self.assertIn("--force", refused.stderr)
        self.assertEqual(pictures(out), self.pictures["dof"])

    def test_same_bits_with_one_worker_and_with_two(self):
        for workers in (1, 2):
            with self.subTest(workers=workers), Server(self.folder / f"data{workers}", workers) as server:
                out = self.folder / f"out{workers}"
                check(server.client("submit", self.sequence, *DOF, *STEREO, "--video", "mp4", "-o", out))
                self.assert_local_pictures(out)
                report = json.loads((out / "report.json").read_text())
                self.assertEqual([render["name"] for render in report["renders"]], ["dof", "stereo"])
                self.assertEqual(report["renders"][1]["comfort"]["frames"], FRAMES)
                # Depth does not depend on what is made of it.
                for path in (self.result / "depth").iterdir():
                    self.assertEqual((out / "depth" / path.name).read_bytes(), path.read_bytes())

    def test_killed_server_renders_nothing_twice(self):
        with Server(self.folder / "data") as server:
            client = server.start_client("submit", str(self.sequence), *DOF, *STEREO, "--video", "mp4", "-o",
                                         str(self.folder / "out"), "--json")
            self.addCleanup(lambda: client.poll() is None and client.kill())
            name = harness.wait_for("the job", lambda: [j["name"] for j in server.client_json("list")["jobs"]])[0]
            server.wait_for_progress(name, lambda job: 1 <= job["progress"]["renderedFramesDone"] < 2 * FRAMES,
                                     "some but not all pictures were rendered")
            server.kill()
            out = server.data_dir / "jobs" / name.removeprefix("jobs/") / "out"
            finished = {path: path.stat().st_mtime_ns for kind in ("dof", "stereo") for path in (out / kind).iterdir()}
            server.start()
            done = server.job(name)["progress"]["renderedFramesDone"]
            self.assertGreaterEqual(done, 1)
            _, stderr = client.communicate(timeout=harness.PATIENCE_S)
            self.assertEqual(client.returncode, 0, stderr)
            untouched = [path for path, time in finished.items() if path.stat().st_mtime_ns == time]
            self.assertGreaterEqual(len(untouched), done, "finished pictures were rendered again")
            self.assert_local_pictures(self.folder / "out")

    def test_pictures_leave_and_a_frame_is_rendered_while_the_job_runs(self):
        with Server(self.folder / "data") as server:
            name = server.client_json("submit", self.sequence, *DOF, *STEREO)["job"]["name"]
            server.wait_for_progress(name, lambda job: job["progress"]["renderedFramesDone"] > 0, "a picture was there")
            # The one worker's task stands still, so that nothing below is a race with the job's end.
            held = harness.wait_for("a task", server.tasks)
            for task in held:
                os.kill(task.pid, signal.SIGSTOP)
            self.addCleanup(lambda: [os.kill(task.pid, signal.SIGCONT) for task in held if task.lives()])
            self.assertEqual(server.job(name)["state"], "STATE_RUNNING")

            fetched = server.client("fetch", name, "-o", self.folder / "out")
            self.assertEqual(fetched.returncode, harness.EXIT_NOT_FINISHED)
            early = {kind: pictures(self.folder / "out" / kind) for kind in self.pictures}
            self.assertGreater(sum(len(files) for files in early.values()), 0)
            for kind, files in early.items():
                for file, bytes_ in files.items():
                    self.assertEqual(bytes_, self.pictures[kind][file])
            picture = self.folder / "frame.png"
            check(server.client("render", name, "--dof", "--focus-depth", "2.5", "--frame", "3", "-o", picture))
            self.assertEqual(picture.read_bytes()[:4], b"\x89PNG")
            unfinished = server.client("render", name, "--dof", "--frame", str(FRAMES), "-o", self.folder / "x.png")
            self.assertIn(f"the job has {FRAMES} frames", unfinished.stderr)

            for task in held:
                os.kill(task.pid, signal.SIGCONT)
            check(server.client("fetch", name, "-o", self.folder / "out", "--follow"))
            for kind, expected in self.pictures.items():
                self.assertEqual(pictures(self.folder / "out" / kind), expected)

    def test_finished_depth_is_rendered_without_computing_it_again(self):
        with Server(self.folder / "data") as server:
            check(server.client("submit", self.sequence, *DOF, "--wait"))
            name = server.client_json("list")["jobs"][0]["name"]
            before = server.log_text().count("kind=intervals")
            out = self.folder / "pair.mp4"
            check(server.client("render", name, *STEREO, "-o", out))
            self.assertEqual(server.log_text().count("kind=intervals"), before)
            self.assertEqual((self.folder / "pair_LR.mp4").read_bytes(), (self.shared / "stereo_LR.mp4").read_bytes())
            check(server.client("render", name, *DOF, "-o", self.folder / "images"))
            self.assertEqual(pictures(self.folder / "images"), self.pictures["dof"])
            # One frame on demand is the frame of the whole clip.
            check(server.client("render", name, *DOF, "--frame", "20", "-o", self.folder / "one.png"))
            self.assertEqual((self.folder / "one.png").read_bytes(), self.pictures["dof"]["000020.png"])

    def test_wrong_parameters_name_their_field(self):
        wrong = {
            "depth_of_field.fstop": ["--dof", "--fstop", "-1"],
            "depth_of_field.focus.depth_m": ["--dof", "--focus-depth", "0.001"],
            "depth_of_field.focus.keys.keys[1].depth_m": ["--dof", "--focus-keys", "0:2,9:-3"],
            "depth_of_field.focus.track.frame": ["--dof", "--focus-track", "400,3,3"],
            "depth_of_field.max_radius_px": ["--dof", "--max-radius", "500"],
            "stereo.baseline_m": ["--stereo", "--baseline", "-0.1"],
            "stereo.divergence_percent": ["--stereo", "--divergence", "90"],
        }
        with Server(self.folder / "data") as server:
            check(server.client("submit", self.sequence, "--method", "hold", "--wait"))
            name = server.client_json("list")["jobs"][0]["name"]
            for field, options in wrong.items():
                with self.subTest(field=field):
                    refused = server.client("submit", self.sequence, *options)
                    self.assertEqual(refused.returncode, harness.EXIT_FAILED)
                    self.assertIn(f"job.renders[0].{field} ", refused.stderr)
                    refused = server.client("render", name, *options, "--frame", "0", "-o", self.folder / "x.png")
                    self.assertIn(f"render.{field} ", refused.stderr)
                    local = run("depthtween-core", "render", self.result, *options, "-o", self.folder / "x")
                    self.assertEqual(local.returncode, harness.EXIT_FAILED)
                    self.assertIn(f"options.{field} ", local.stderr)
            self.assertEqual(len(server.client_json("list")["jobs"]), 1)
            usage = server.client("submit", self.sequence, "--stereo", "--format", "imax")
            self.assertEqual(usage.returncode, harness.EXIT_USAGE)


if __name__ == "__main__":
    harness.main()
