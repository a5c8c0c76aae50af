"""Scene flow as a job: the same bits as on this machine, whatever happens to the server on the way. The truth is what
`depthtween-core sceneflow` writes."""

import json

import harness
from harness import Server, check

FRAMES = 9


def synth(folder, depth_fps):
    check(harness.run("depthtween-core", "synth", "kick", "-o", folder, "--frames", FRAMES, "--size", "160x120",
                      "--color-fps", 60, "--depth-fps", depth_fps, "--no-truth"))


class SceneFlowTest(harness.IntegrationTest):

    def test_killed_server_goes_on_to_the_same_bits(self):
        sequence, local, out = (self.folder / name for name in ("in", "local", "out"))
        synth(sequence, 60)
        options = ["--format", "npz,flo,kitti", "--baseline", "0.5"]
        check(harness.run("depthtween-core", "sceneflow", sequence, "-o", local, *options))
        with Server(self.folder / "data") as server:
            client = server.start_client("sceneflow", str(sequence), "-o", str(out), *options)
            self.addCleanup(lambda: client.poll() is None and client.kill())
            job_name = harness.wait_for(
                "the job", lambda: [job["name"] for job in server.client_json("list")["jobs"]])[0]
            server.wait_for_progress(job_name, lambda job: 1 <= job["progress"]["framesDone"] < FRAMES - 1,
                                     "some but not all pairs were finished")
            tasks = server.tasks()
            server.kill()
            for task in tasks:
                harness.wait_for(f"task {task.pid} to die with its server", lambda: not task.lives())
            finished = self.written(server)
            self.assertGreater(len(finished), 0)
            server.start()
            done = server.job(job_name)["progress"]["framesDone"]
            self.assertGreaterEqual(done, 1)
            _, stderr = client.communicate(timeout=harness.PATIENCE_S)
            self.assertEqual(client.returncode, 0, stderr)
            after = self.written(server)
            self.assertGreaterEqual(len([name for name in finished if after.get(name) == finished[name]]), done,
                                    "finished pairs were computed again")
            self.assert_same_result(out, local)
            self.assert_names_nothing_of(server, out)
            ours, theirs = (json.loads((folder / "report.json").read_text()) for folder in (out, local))
            for report in (ours, theirs):
                for pair in report["pairs"]:
                    del pair["seconds"]
            self.assertEqual(ours, theirs)
            render = server.client("render", job_name, "--dof", "-o", self.folder / "x.mp4")
            self.assertEqual(render.returncode, harness.EXIT_FAILED)
            self.assertIn("no depth", render.stderr)

    def test_what_cannot_be_is_said(self):
        slow, short = self.folder / "slow", self.folder / "short"
        synth(slow, 30)
        synth(short, 60)
        with Server(self.folder / "data") as server:
            failed = server.client("sceneflow", slow)
            self.assertEqual(failed.returncode, harness.EXIT_FAILED)
            self.assertIn("colour and depth are not at the same rate", failed.stderr)
            self.assertIn("rgb/000001.jpg", failed.stderr)
            self.assertIn("--scene-flow", failed.stderr)
            failed = server.client("sceneflow", short, "--every", FRAMES)
            self.assertEqual(failed.returncode, harness.EXIT_FAILED)
            self.assertIn(f"must have at least {FRAMES + 1}", failed.stderr)
            self.assertEqual(server.client_json("list")["jobs"], [], "a job was made that could only fail")
            self.assertEqual(server.client("sceneflow", short, "--method", "luck").returncode, harness.EXIT_USAGE)

    @staticmethod
    def written(server):
        """Scene flow in the job's own folder: name -> (inode, time of writing)."""
        found = {}
        for path in server.data_dir.glob("jobs/*/out/sceneflow/*.npz"):
            info = path.stat()
            found[str(path)] = (info.st_ino, info.st_mtime_ns)
        return found


if __name__ == "__main__":
    harness.main()
