"""The main job: the same recording gives the same bits on this machine and through the server, whatever happens to the
server on the way. The truth is what `depthtween-core upsample` writes."""

import json
import shutil
import tempfile

import harness
from harness import Server, check

FRAMES = 33  # 240 fps colour, 30 fps depth: five depth frames, four intervals of eight frames


class MainJobTest(harness.IntegrationTest):

    @classmethod
    def setUpClass(cls):
        cls.shared = harness.pathlib.Path(tempfile.mkdtemp(prefix="depthtween_main_job_"))
        cls.addClassCleanup(shutil.rmtree, cls.shared, ignore_errors=True)
        cls.sequence = cls.shared / "kick"
        cls.local = cls.shared / "local"
        harness.synth(cls.sequence, FRAMES)
        harness.upsample(cls.sequence, cls.local)

    def test_same_bits_with_one_worker_and_with_two(self):
        for workers in (1, 2):
            with self.subTest(workers=workers), Server(self.folder / f"data{workers}", workers) as server:
                out = self.folder / f"out{workers}"
                check(server.client("submit", self.sequence, "--wait", "-o", out))
                self.assert_same_result(out, self.local)
                report = json.loads((out / "report.json").read_text())
                local_report = json.loads((self.local / "report.json").read_text())
                self.assert_names_nothing_of(server, out)
                self.assertEqual(sorted(report), sorted(local_report))

    def test_options_are_those_of_the_local_command(self):
        asked = {"linear": ["--method", "linear", "--key-every", "2", "--clock", "2,300"],
                 "causal": ["--causal", "--clock", "estimate"],
                 "printed": ["--preset", "reference", "--literal", "short,rigid", "--key-every", "4"]}
        with Server(self.folder / "data") as server:
            for name, options in asked.items():
                with self.subTest(name):
                    local, out = self.folder / f"local_{name}", self.folder / f"out_{name}"
                    harness.upsample(self.sequence, local, *options)
                    submitted = server.client_json("submit", self.sequence, "-o", str(out), *options)
                    self.assert_same_result(out, local)
                    reports = [json.loads((folder / "report.json").read_text()) for folder in (out, local)]
                    self.assertEqual(reports[0]["options"], reports[1]["options"])
                    clock = json.loads((local / "report.json").read_text())["clock"]
                    self.assertEqual(clock, json.loads((out / "report.json").read_text())["clock"])
                    self.assertEqual("estimate" in clock, name == "causal")
                    if "estimate" in clock:
                        # Five depth frames are too few to tell clocks by: the job says so.
                        estimate = submitted["job"]["clockEstimate"]
                        self.assertEqual(estimate["reason"], clock["estimate"]["reason"])
                        self.assertIn("too few", estimate["reason"])
                        status = check(server.client("status", submitted["job"]["name"])).stdout
                        self.assertIn(clock["estimate"]["summary"], status)

    def test_scene_flow_is_that_of_the_local_command_whenever_the_server_is_killed(self):
        local, out = self.folder / "local", self.folder / "out"
        harness.upsample(self.sequence, local, "--scene-flow")
        # Motion is what scene flow is made from; a job does not hand it out.
        shutil.rmtree(local / "motion")
        with Server(self.folder / "data") as server:
            client = server.start_client("submit", str(self.sequence), "--scene-flow", "-o", str(out))
            self.addCleanup(lambda: client.poll() is None and client.kill())
            job_name = harness.wait_for("the job", lambda: self.job_names(server))[0]
            server.wait_for_progress(job_name, lambda job: 1 <= job["progress"]["intervalsDone"],
                                     "an interval was finished")
            server.kill()
            server.start()
            # Once more while the motion of all frames is put together.
            harness.wait_for("some scene flow", lambda: any(server.data_dir.glob("jobs/*/out/sceneflow/*.npz")))
            server.kill()
            server.start()
            _, stderr = client.communicate(timeout=harness.PATIENCE_S)
            self.assertEqual(client.returncode, 0, stderr)
        self.assertEqual(len(list((out / "sceneflow").iterdir())), FRAMES - 1)
        self.assert_same_result(out, local)

    def test_self_check_is_that_of_the_local_command(self):
        local = self.folder / "local"
        printed = harness.check(harness.run("depthtween-core", "upsample", self.sequence, "-o", local, "--self-check"))
        with Server(self.folder / "data") as server:
            out = self.folder / "out"
            submitted = check(server.client("submit", self.sequence, "--self-check", "-o", out))
            table = [line for line in printed.stdout.splitlines() if line.startswith(("ours ", "flow-warp ", "hold "))]
            self.assertEqual(len(table), 3, printed.stdout)
            for line in table:
                self.assertIn(line, submitted.stderr.splitlines())
            self.assertIn("self-check", server.log_text())
            self.assert_same_result(out, local)
            ours, theirs = (json.loads((folder / "report.json").read_text()) for folder in (out, local))
            self.assertEqual(sorted(ours), sorted(theirs))
            for report in (ours, theirs):
                del report["self_check"]["seconds"]
            self.assertEqual(ours["self_check"], theirs["self_check"])

            # It is stored with the job.
            server.kill()
            server.start()
            job_name = submitted.stdout.strip()
            status = check(server.client("status", job_name)).stdout.splitlines()
            for line in table:
                self.assertIn(line, status)
            measured = server.job(job_name)["selfCheck"]
            self.assertEqual([method["rmseMm"] for method in measured["methods"]],
                             [method["rmse_mm"] for method in ours["self_check"]["methods"]])

    def test_same_command_again_repeats_nothing(self):
        with Server(self.folder / "data") as server:
            first = server.client_json("submit", self.sequence, "--wait")
            again = server.client_json("submit", self.sequence, "--wait", "-o", str(self.folder / "out"))
            self.assertEqual(again["job"]["name"], first["job"]["name"])
            self.assertEqual(again["upload"]["foundBytes"], again["upload"]["totalBytes"])
            self.assertEqual(len(server.client_json("list")["jobs"]), 1)
            self.assert_same_result(self.folder / "out", self.local)

    def test_killed_server_loses_nothing_that_was_finished(self):
        with Server(self.folder / "data") as server:
            client = server.start_client("submit", str(self.sequence), "-o", str(self.folder / "out"), "--json")
            self.addCleanup(lambda: client.poll() is None and client.kill())
            job_name = harness.wait_for("the job", lambda: self.job_names(server))[0]
            server.wait_for_progress(job_name, lambda job: 1 <= job["progress"]["intervalsDone"] < 4,
                                     "some but not all intervals were finished")
            tasks = server.tasks()
            server.kill()
            for task in tasks:
                harness.wait_for(f"task {task.pid} to die with its server", lambda: not task.lives())
            # What is recorded as finished, and when it was written.
            finished = self.frame_files(server)
            self.assertGreater(len(finished), 0)

            server.start()
            before = server.job(job_name)
            self.assertGreaterEqual(before["progress"]["intervalsDone"], 1)
            sequence_state = server.client_json("list", "--sequences")["sequences"][0]["state"]
            self.assertEqual(sequence_state, "STATE_READY")

            stdout, stderr = client.communicate(timeout=harness.PATIENCE_S)
            self.assertEqual(client.returncode, 0, stderr)
            self.assertEqual(json.loads(stdout)["job"]["state"], "STATE_SUCCEEDED")
            self.assert_same_result(self.folder / "out", self.local)
            after = self.frame_files(server)
            done = before["progress"]["framesDone"]
            untouched = [name for name in finished if after.get(name) == finished[name]]
            # Three files a frame. An interval whose files were in place but not yet recorded may be written again.
            self.assertGreaterEqual(len(untouched), 3 * done, "finished intervals were computed again")

    def test_killed_client_goes_on_where_it_stopped(self):
        with Server(self.folder / "data") as server:
            client = server.start_client("submit", str(self.sequence), "-o", str(self.folder / "out"))
            harness.wait_for("the job", lambda: self.job_names(server))
            client.kill()
            client.communicate()
            check(server.client("submit", self.sequence, "-o", self.folder / "out"))
            self.assertEqual(len(self.job_names(server)), 1)
            self.assert_same_result(self.folder / "out", self.local)

    def test_follow_brings_frames_while_the_job_runs(self):
        with Server(self.folder / "data") as server:
            job_name = check(server.client("submit", self.sequence)).stdout.strip()
            follower = server.start_client("fetch", job_name, "-o", str(self.folder / "out"), "--follow")
            self.addCleanup(lambda: follower.poll() is None and follower.kill())
            fetched = self.folder / "out" / "depth"
            harness.wait_for("a frame", lambda: fetched.is_dir() and any(fetched.glob("*.png")))
            # Asked after the frame was seen: the job had not ended when it arrived.
            self.assertEqual(server.job(job_name)["state"], "STATE_RUNNING")
            _, stderr = follower.communicate(timeout=harness.PATIENCE_S)
            self.assertEqual(follower.returncode, 0, stderr)
            self.assert_same_result(self.folder / "out", self.local)

    @staticmethod
    def job_names(server):
        return [job["name"] for job in server.client_json("list")["jobs"]]

    @staticmethod
    def frame_files(server):
        """Frames in the job's own folder: name -> (inode, time of writing)."""
        found = {}
        for path in server.data_dir.glob("jobs/*/out/*/*.png"):
            info = path.stat()
            found[str(path)] = (info.st_ino, info.st_mtime_ns)
        return found


if __name__ == "__main__":
    harness.main()
